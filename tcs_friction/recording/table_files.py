"""CSV and Parquet files: columns of numbers by name, out and in."""

from __future__ import annotations

import array
import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError, JobError
from tcs_friction.recording.allowance import EXPANSION, FREE_BYTES
from tcs_friction.recording.recording import Column

MAX_COLUMNS = 4096
"""Columns of a table; a drive's logger has tens."""

MAX_NAME = 256
"""Characters of a column's name."""

RUN_BY_SPREADSHEETS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""What a text cell begins with that a spreadsheet runs as a formula (OWASP, CSV injection)."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns by name. seconds: those whose type is a time, which are in s from their earliest. notes: what was left out."""

    columns: Mapping[str, Column]
    seconds: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


def write_csv(columns: Mapping[str, np.ndarray], path: Path) -> None:
    """A text table with a line of names; names that a spreadsheet would run get an apostrophe in front."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([f"'{name}" if name.startswith(RUN_BY_SPREADSHEETS) else name for name in columns])
        count = len(next(iter(columns.values())))
        for start in range(0, count, 1 << 16):
            writer.writerows(zip(*(values[start : start + (1 << 16)].tolist() for values in columns.values()), strict=True))


def write_parquet(columns: Mapping[str, np.ndarray], path: Path) -> None:
    """A Parquet file. Raises JobError if pyarrow is not installed."""
    parquet = _parquet(path)
    import pyarrow

    parquet.write_table(pyarrow.table({name: pyarrow.array(values) for name, values in columns.items()}), path)


def _parquet(path: Path) -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise JobError(str(path), "Parquet needs the package pyarrow", "pip install pyarrow, or .csv") from None
    return pyarrow.parquet


def read_parquet(path: Path) -> Table:
    """Columns of numbers and times. Raises InputError for what is no Parquet file, or unpacks to too much."""
    parquet = _parquet(path)
    import pyarrow

    try:
        file = parquet.ParquetFile(path)
        groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
        rows = max(file.metadata.num_rows, sum(group.num_rows for group in groups))
        names = _checked(file.schema_arrow.names, path)
        if 8 * rows * len(names) > FREE_BYTES + EXPANSION * path.stat().st_size:
            found = f"{rows} rows of {len(names)} columns in {path.stat().st_size} bytes"
            raise InputError(str(path), found, f"a file that unpacks to at most {EXPANSION} times its size")
        return _arrow_table({name: file.read(columns=[name])[name] for name in names if _numeric(file, name)}, file)
    except (OSError, ValueError, TypeError, KeyError, MemoryError, OverflowError, pyarrow.ArrowException) as error:
        raise InputError(str(path), f"cannot be read ({' '.join(str(error).split())})", "a Parquet file of numbers") from None


def _numeric(file: Any, name: str) -> bool:
    """Whether a column holds numbers or times; a text in it could unpack to anything."""
    from pyarrow import types

    kind = file.schema_arrow.field(name).type
    return bool(
        types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
        or (types.is_temporal(kind) and not types.is_interval(kind))
    )  # fmt: skip


def _arrow_table(columns: Mapping[str, Any], file: Any) -> Table:
    left_out = [name for name in file.schema_arrow.names if name not in columns]
    notes = tuple(f"column {name!r} holds no numbers ({file.schema_arrow.field(name).type}), left out" for name in left_out)
    times = {name: _seconds(column) for name, column in columns.items() if _temporal(column)}
    numbers = {name: column.to_numpy().astype(np.float64) for name, column in columns.items() if name not in times}
    return Table({name: times[name] if name in times else numbers[name] for name in columns}, frozenset(times), notes)


def _temporal(column: Any) -> bool:
    from pyarrow import types

    return bool(types.is_temporal(column.type))


def _seconds(column: Any) -> Column:
    """A column of dates, times or durations in s from the earliest; NaN where it has none."""
    import pyarrow
    from pyarrow import compute, types

    if types.is_date(column.type):
        column = column.cast(pyarrow.timestamp("ms"))
    step = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.type.unit]
    whole = pyarrow.int32() if column.type.bit_width == 32 else pyarrow.int64()
    counts = column.cast(whole).cast(pyarrow.int64())
    from_first = compute.subtract(counts, compute.min(counts))  # before floats round it
    return np.asarray(from_first.to_numpy(), dtype=np.float64) * step


def read_csv(path: Path) -> Table:
    """Columns of a text table; , ; or tab between cells, decimal comma with the last two; cells that are no number are NaN.

    Lines that are blank or begin with # are passed over. Raises InputError naming the row that does not fit.
    """
    try:
        with path.open(encoding="utf-8-sig") as stream:
            lines = (line.rstrip("\r\n") for line in stream)
            return _csv_table((line for line in lines if line.strip() and not line.startswith("#")), path)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read ({error})", "a text table") from None


def _csv_table(lines: Iterator[str], path: Path) -> Table:
    head = next(lines, "")
    delimiter = max(",;\t", key=head.count)
    names = [_unquoted(name.strip()) for name in next(csv.reader([head], delimiter=delimiter), [])]
    _checked(names, path)
    cells = array.array("d")
    count = 0
    rows = csv.reader((line.replace(",", ".") if delimiter != "," else line for line in lines), delimiter=delimiter)
    for count, row in enumerate(rows, start=1):
        if len(row) != len(names):
            raise InputError(f"{path}: row {count + 1}", f"{len(row)} cells", f"{len(names)} as in the first line")
        cells.extend(map(_number, row))
    if not count:
        raise InputError(str(path), f"{int(bool(head))} lines", "a line of column names and rows of numbers")
    table = np.frombuffer(cells).reshape(count, len(names))
    return Table({name: np.ascontiguousarray(table[:, place]) for place, name in enumerate(names) if name})


def _checked(names: Sequence[str], path: Path) -> Sequence[str]:
    """The names of the columns. Raises InputError when two are equal, or there are too many or too long ones."""
    if len(names) > MAX_COLUMNS or any(len(name) > MAX_NAME for name in names):
        found = f"{len(names)} columns, the longest name of {max(map(len, names))} characters"
        raise InputError(str(path), found, f"at most {MAX_COLUMNS} columns and {MAX_NAME} characters")
    twin = next((name for name, count in Counter(names).items() if count > 1), None)
    if twin is not None:
        raise InputError(str(path), f"{names.count(twin)} columns with the same name {twin!r}", "a name for each column")
    return names


def _unquoted(name: str) -> str:
    """The name without the apostrophe that `write_csv` puts in front of some."""
    return name[1:] if name.startswith("'") and name[1:].startswith(RUN_BY_SPREADSHEETS) else name


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan
