"""What is kept of each recording: one row of a Parquet data set.

The files lie in `OUT/rows/axis=NAME/month=YYYY-MM/*.parquet`; axis and month stand in the path only. A run that is over leaves
one row for each recording or, of long ones, for each piece. While one goes on, or after it was killed, a row of an older
version may still lie beside its successor: who reads meanwhile keeps the last of each (`recording`, `piece`) by file time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from typing import Any

import pyarrow
from pyarrow import dataset

DONE, FAILED = "done", "failed"
NO_AXIS = "_none"
"""The axis of recordings that belong to none."""

NO_MONTH = "_none"
"""The month of recordings whose time nobody knows; their `start` is 0."""

NAN = math.nan


@dataclass(frozen=True)
class Row:
    """One recording, or one piece of a long one. Units and meaning: docs/fleet.md.

    status: `done` when the identification worked. reason: one line why it did not, or, of a row that is done, why there is no
    diagnosis. parameter_*: in the same order; the covariance has one number for each pair, row by row, NaN where one of the
    two is not determined.
    """

    axis: str
    month: str
    recording: str
    piece: int
    start: int
    duration: float
    input_hash: str
    version: str
    status: str
    reason: str | None = None
    law: str | None = None
    parameter_names: tuple[str, ...] = ()
    parameter_values: tuple[float, ...] = ()
    parameter_stds: tuple[float, ...] = ()
    parameter_determined: tuple[bool, ...] = ()
    parameter_units: tuple[str, ...] = ()
    parameter_covariance: tuple[float, ...] = ()
    verdict: str | None = None
    statement: str | None = None
    effects: str = "[]"
    noise_floor: float = NAN
    residual_believed: float = NAN
    residual_retuned: float = NAN
    residual_improved: float = NAN
    temperature: float = NAN
    temperature_change: float = NAN
    travel: float = NAN
    position_from: float = NAN
    position_to: float = NAN
    speed_rms: float = NAN
    speed_max: float = NAN
    reversals: int = 0


_LISTS = {
    "parameter_names": pyarrow.string(),
    "parameter_values": pyarrow.float64(),
    "parameter_stds": pyarrow.float64(),
    "parameter_determined": pyarrow.bool_(),
    "parameter_units": pyarrow.string(),
    "parameter_covariance": pyarrow.float64(),
}
_WHOLE = {"piece": pyarrow.int32(), "start": pyarrow.int64(), "reversals": pyarrow.int32()}
_TEXTS = (
    "axis", "month", "recording", "input_hash", "version", "status", "reason", "law", "verdict", "statement", "effects"
)  # fmt: skip


def _type(name: str) -> Any:
    if name in _LISTS:
        return pyarrow.list_(_LISTS[name])
    return pyarrow.string() if name in _TEXTS else _WHOLE.get(name, pyarrow.float64())


KEYS = pyarrow.schema([(name, pyarrow.string()) for name in ("axis", "month")])
PARTITIONING = dataset.partitioning(KEYS, flavor="hive")
SCHEMA = pyarrow.schema([(field.name, _type(field.name)) for field in fields(Row)])
"""Of a table of rows; in files without axis and month."""

FILE_SCHEMA = pyarrow.schema([field for field in SCHEMA if field.name not in KEYS.names])


def month_of(start: int) -> str:
    """The month in which something began, from ns since 1970; NO_MONTH where that is unknown (0) or no date.

    >>> month_of(1_771_000_000_000_000_000)
    '2026-02'
    """
    try:
        return datetime.fromtimestamp(start // 10**9, UTC).strftime("%Y-%m") if start > 0 else NO_MONTH
    except (ValueError, OverflowError, OSError):
        return NO_MONTH


def to_table(rows: Iterable[Row]) -> Any:
    """A pyarrow table of the rows, with SCHEMA."""
    return pyarrow.Table.from_pylist([asdict(row) for row in rows], schema=SCHEMA)


def from_table(table: Any) -> list[Row]:
    """The rows of a table; columns that it lacks are as of a row of which nothing is known, others are passed over."""
    names = [field.name for field in fields(Row) if field.name in table.column_names]
    return [Row(**{name: _plain(name, row[name]) for name in names}) for row in table.select(names).to_pylist()]


def _plain(name: str, value: Any) -> Any:
    if name in _LISTS:
        return tuple(value or ())
    return NAN if value is None and _type(name) == pyarrow.float64() else value
