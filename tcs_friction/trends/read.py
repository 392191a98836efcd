"""The stored results of a fleet, axis by axis: the one file of this room that opens anything."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import unquote

import pyarrow
from pyarrow import dataset

from tcs_friction.errors import InputError
from tcs_friction.trends.rows import PROGRAMME, SURROUNDINGS, AxisRows, Effect, rows_of

NO_AXIS = "_none"
TEXTS = ("recording", "input_hash", "version", "status", "reason", "law", "verdict", "effects")
LISTS = ("parameter_names", "parameter_values", "parameter_stds", "parameter_determined", "parameter_units")
NEEDED = (*TEXTS, *LISTS, "piece", "start", *SURROUNDINGS, *PROGRAMME)
_KEYS = pyarrow.schema([("axis", pyarrow.string()), ("month", pyarrow.string())])


def read_axes(out: str, filesystem: Any = None) -> Iterator[AxisRows]:
    """The recordings of each axis by name; only one axis is in memory at a time. filesystem: pyarrow's, None: the local one.

    Raises InputError when there are no results, or a column is missing, or an effect cannot be read.
    """
    where = f"{out.rstrip('/')}/rows"
    try:
        hive = dataset.partitioning(_KEYS, flavor="hive")
        rows = dataset.dataset(
            where, filesystem=filesystem, format="parquet", partitioning=hive, exclude_invalid_files=True
        )
    except (OSError, pyarrow.ArrowInvalid):
        raise InputError(
            out, "holds no results of a fleet", "the OUT of ./tcs fleet PATHS... -o OUT"
        ) from None
    missing = [name for name in NEEDED if name not in rows.schema.names]
    if missing:
        raise InputError(where, f"column {missing[0]} is missing", "rows that ./tcs fleet wrote")
    names = sorted({str(_axis_of(part)) for part in rows.get_fragments()} - {NO_AXIS, "None"})
    for name in names:
        try:
            table = rows.to_table(columns=list(NEEDED), filter=dataset.field("axis") == name)
        except (OSError, pyarrow.ArrowException) as error:
            raise InputError(where, f"cannot be read ({error})", "rows that ./tcs fleet wrote") from None
        yield rows_of(unquote(name), [_plain(row, where) for row in table.to_pylist()])


def _axis_of(fragment: Any) -> Any:
    return dataset.get_partition_keys(fragment.partition_expression).get("axis")


def _plain(row: Mapping[str, Any], where: str) -> dict[str, Any]:
    """A row with NaN for numbers that are not there, and effects as records."""
    content = dict(row)
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
