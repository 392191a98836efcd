"""The stored results of a fleet, axis by axis: the one file of this room that opens anything."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import unquote

import pyarrow
from pyarrow import dataset

from tcs_friction.errors import InputError
from tcs_friction.trends.rows import PROGRAMME, SURROUNDINGS, AxisRows, Effect, rows_of, unreadable

NO_AXIS = "_none"
TEXTS = ("recording", "input_hash", "version", "status", "reason", "law", "verdict", "effects")
LISTS = ("parameter_names", "parameter_values", "parameter_stds", "parameter_determined", "parameter_units")
NEEDED = (*TEXTS, *LISTS, "piece", "start", *SURROUNDINGS, *PROGRAMME)
MOST = 1e19
"""Of any number: more than all ns since 1970 that 64 bits hold."""
_KEYS = pyarrow.schema([("axis", pyarrow.string()), ("month", pyarrow.string())])


def read_axes(out: str, filesystem: Any = None) -> Iterator[AxisRows]:
    """The recordings of each axis by name; only one axis is in memory at a time. filesystem: pyarrow's, None: the local one.

    An axis of which a file cannot be read has no recordings and says why. Raises InputError when there are no results.
    """
    where = f"{out.rstrip('/')}/rows"
    try:
        hive = dataset.partitioning(_KEYS, flavor="hive")
        every = dataset.dataset(where, _KEYS, "parquet", filesystem, hive)
        files = [part for part in every.get_fragments() if part.path.endswith(".parquet")]
    except (OSError, pyarrow.ArrowInvalid):
        files = []
    if not files:
        raise InputError(out, "holds no results of a fleet", "the OUT of ./tcs fleet PATHS... -o OUT")
    by_axis: dict[str, list[Any]] = {}
    for part in files:
        by_axis.setdefault(str(dataset.get_partition_keys(part.partition_expression).get("axis")), []).append(part)
    for name in sorted(set(by_axis) - {NO_AXIS, "None"}):
        try:
            content = [row for part in by_axis[name] for row in _rows_in(part)]
            yield rows_of(unquote(name), content)
        except InputError as error:
            yield unreadable(unquote(name), str(error))


def _rows_in(part: Any) -> list[dict[str, Any]]:
    """Raises InputError naming the file that cannot be read, or lacks a column."""
    try:
        if missing := [name for name in NEEDED if name not in part.physical_schema.names]:
            raise InputError(part.path, f"column {missing[0]} is missing", "rows that ./tcs fleet wrote")
        return [_plain(row, part.path) for row in part.to_table(columns=list(NEEDED)).to_pylist()]
    except (OSError, pyarrow.ArrowException) as error:
        raise InputError(part.path, f"cannot be read ({error})", "rows that ./tcs fleet wrote") from None


def _plain(row: Mapping[str, Any], where: str) -> dict[str, Any]:
    """A row with NaN for numbers that are not there, and effects as records. Raises InputError for values of another kind."""
    content = dict(row)
    for name in row:
        if not _fits(name, row[name]):
            raise InputError(where, f"{name} is {str(row[name])[:40]!r}", "rows that ./tcs fleet wrote")
    if len({len(row[name] or []) for name in LISTS}) > 1:
        raise InputError(where, f"parameters of {row['recording']} of different number", "one value, std and unit of each")
    for name in (*SURROUNDINGS, *PROGRAMME):
        content[name] = float("nan") if row[name] is None else row[name]
    for name in LISTS:
        content[name] = row[name] or []
    content["start"], content["piece"] = row["start"] or 0, row["piece"] or 0
    try:
        content["effects"] = [_effect(entry) for entry in json.loads(row["effects"] or "[]")]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        found = f"effects of {row['recording']} cannot be read ({error!r})"
        raise InputError(where, found, "JSON as in diagnosis.json") from None
    return content


def _fits(name: str, value: Any) -> bool:
    """Whether a value is of the kind that its column has."""
    if value is None:
        return True
    if name in LISTS:
        inner = {"parameter_names": str, "parameter_units": str}.get(name, int | float)
        return isinstance(value, list) and all(one is None or isinstance(one, inner) for one in value)
    return isinstance(value, str) if name in TEXTS else isinstance(value, int | float) and not abs(value) >= MOST


def _effect(entry: Mapping[str, Any]) -> Effect:
    def number(value: Any) -> float:
        return float("nan") if value is None else float(value)

    parameters = {
        str(name): (number(values.get("value")), number(values.get("std")), str(values.get("unit") or ""))
        for name, values in (entry.get("parameters") or {}).items()
    }
    place = entry.get("where") or {}
    return Effect(
        str(entry["effect"]),
        parameters,
        tuple(str(name) for name in entry.get("equivalent") or ()),
        str(place.get("coordinate") or ""),
        float(entry.get("torque_rms") or 0.0),
    )
