"""Files of tables: which reader one needs, CSV and Parquet out, Parquet in."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError, JobError
from tcs_friction.plain_files import read_plain
from tcs_friction.recording.allowance import EXPANSION, FREE_BYTES
from tcs_friction.recording.recording import Column
from tcs_friction.recording.table import RUN_BY_SPREADSHEETS, Table, checked
from tcs_friction.recording.table_arrays import columns_of, read_mat, read_npz
from tcs_friction.recording.table_text import read_text

TEXTS = (".csv", ".tsv", ".txt")
TABLES = (*TEXTS, *(f"{suffix}.gz" for suffix in TEXTS), ".parquet", ".mat", ".npz")
"""Endings of the files that are tables."""

READABLE = "a table (.csv, .tsv, .txt, .gz of these, .parquet, .mat, .npz)"

LEROBOT = {
    "observation.state": "position", "observation.position": "position", "observation.velocity": "velocity",
    "observation.effort": "torque", "action": "reference",
}  # fmt: skip
"""Lists of a LeRobot data set, one number a joint, and the signals that they are."""

MOST_INFO = 1 << 20  # bytes of the info.json of a LeRobot data set


def is_table(path: Path) -> bool:
    """Whether a file is a table by its name."""
    return path.name.lower().endswith(TABLES)


def read_table(path: Path) -> Table:
    """The columns of a table. Raises InputError for a file that is none, saying what is read instead of a known other kind."""
    refuse_foreign(path, read_plain(path, 1024, READABLE))
    readers: dict[str, Callable[[Path], Table]] = {".parquet": read_parquet, ".mat": read_mat, ".npz": read_npz}
    return readers.get(path.suffix.lower(), read_text)(path)


FOREIGN: dict[bytes, tuple[str, str]] = {
    b"ULog\x01\x12\x35": ("is a ULog of PX4", "one of the .csv files that `ulog2csv` (package pyulog) makes of it"),
    b"\x89HDF\r\n\x1a\n": ("is an HDF5 file", f"{READABLE}; h5py or MATLAB's `save -v7` make one"),
    b"\xd0\xcf\x11\xe0": ("is an old spreadsheet", "the same saved as .csv"),
    b"\xa3\x95": ("is a log of ArduPilot", "the .csv that `mavlogdump.py --format csv` makes of it"),
    b"TDSm": ("is a TDMS file of LabVIEW", "the same exported as .csv"),
    b"MDF ": ("is an MDF file", "the same exported as .csv or .mat"),
}
"""First bytes of files that people have recordings in and that are not read: what they are, what is read instead."""


def refuse_foreign(path: Path, head: bytes) -> None:
    """Raises InputError for a file of a kind that is known and not read, saying what is read instead."""
    for magic, (found, expected) in FOREIGN.items():
        if head.startswith(magic):
            raise InputError(str(path), found, expected)
    if head.startswith(b"PK\x03\x04") and path.suffix.lower() != ".npz":
        found = "is a spreadsheet or archive" if b"[Content_Types].xml" in head or b"mimetype" in head else "is a zip archive"
        raise InputError(str(path), found, "the same saved as .csv, or the files in it")
    if head.startswith(b"MATLAB 7.3 MAT-file") or head[512:520] == b"\x89HDF\r\n\x1a\n":
        raise InputError(str(path), "is a .mat file of version 7.3", "the same by `save -v7`, or .csv")


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
        names = checked(file.schema_arrow.names, path)
        numbers = sum(group.column(place).num_values for group in groups for place in range(group.num_columns))
        if 8 * max(rows * len(names), numbers) > FREE_BYTES + EXPANSION * path.stat().st_size:
            found = f"{rows} rows of {len(names)} columns in {path.stat().st_size} bytes"
            raise InputError(str(path), found, f"a file that unpacks to at most {EXPANSION} times its size")
        columns = {name: _read_column(file, name) for name in names if _numeric(file.schema_arrow.field(name).type)}
        return _arrow_table(columns, file, path)
    except (OSError, ValueError, TypeError, KeyError, MemoryError, OverflowError, pyarrow.ArrowException) as error:
        raise InputError(str(path), f"cannot be read ({' '.join(str(error).split())})", "a Parquet file of numbers") from None


def _read_column(file: Any, name: str) -> Any:
    """One column; those of a list come as `NAME.list.element`, by the name of the whole."""
    return file.read(columns=[name])[name]


def _numeric(kind: Any) -> bool:
    """Whether a column holds numbers, times or lists of numbers; a text in it could unpack to anything."""
    from pyarrow import types

    if types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind):
        return bool(types.is_integer(kind.value_type) or types.is_floating(kind.value_type))
    return bool(
        types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
        or (types.is_temporal(kind) and not types.is_interval(kind))
    )  # fmt: skip


def _arrow_table(columns: Mapping[str, Any], file: Any, path: Path) -> Table:
    from pyarrow import types

    left_out = [name for name in file.schema_arrow.names if name not in columns]
    notes = [f"column {name!r} holds no numbers ({file.schema_arrow.field(name).type}), left out" for name in left_out]
    arrays: dict[str, np.ndarray] = {}
    starts: dict[str, int] = {}
    for name, column in columns.items():
        if types.is_temporal(column.type):
            arrays[name], starts[name] = _seconds(column)
        elif types.is_nested(column.type):
            arrays[name] = _matrix(column, name, path)
        else:
            arrays[name] = column.to_numpy().astype(np.float64)
    found = columns_of(arrays, path, notes, _joint_names(arrays, path))
    return Table(found, dict.fromkeys(starts, "s"), starts, tuple(notes))


def _matrix(column: Any, name: str, path: Path) -> np.ndarray:
    """(n, k) from a column of lists. Raises InputError where they are not equally long."""
    from pyarrow import compute

    lengths = set(compute.unique(compute.list_value_length(column)).to_pylist())
    if len(lengths) != 1 or None in lengths:
        raise InputError(str(path), f"column {name!r} holds lists of different length", "one number for each joint in every row")
    flat = compute.list_flatten(column).to_numpy().astype(np.float64)
    return np.asarray(flat.reshape(len(column), -1))


def _joint_names(arrays: Mapping[str, np.ndarray], path: Path) -> dict[str, tuple[str, ...]]:
    """What the columns of the lists of a LeRobot data set are called: joint and signal."""
    names: dict[str, tuple[str, ...]] = {}
    if not any(name.startswith("observation.") for name in arrays):
        return names
    for name, signal in LEROBOT.items():
        if name in arrays and arrays[name].ndim == 2:
            count = arrays[name].shape[1]
            joints = _told_joints(path, name)
            joints = joints if len(set(joints)) == count else [str(number) for number in range(count)]
            names[name] = tuple(f"{joint}/{signal}" for joint in joints)
    return names


def _told_joints(path: Path, feature: str) -> list[str]:
    """The names that meta/info.json of the data set around a file has for a feature, none where it has not."""
    info = next((folder / "meta" / "info.json" for folder in path.absolute().parents[:4] if (folder / "meta").is_dir()), None)
    try:
        if info is None or not info.is_file() or info.stat().st_size > MOST_INFO:
            return []
        names = json.loads(info.read_text())["features"][feature]["names"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
    names = next(iter(names.values()), []) if isinstance(names, dict) else names
    return [str(name).removesuffix(".pos") for name in names] if isinstance(names, list) else []


def _seconds(column: Any) -> tuple[Column, int]:
    """Dates, times or durations in s from the earliest, NaN where there is none; and that, ns since 1970, 0 if no date."""
    import pyarrow
    from pyarrow import compute, types

    if types.is_date(column.type):
        column = column.cast(pyarrow.timestamp("ms"))
    step = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.type.unit]
    whole = pyarrow.int32() if column.type.bit_width == 32 else pyarrow.int64()
    counts = column.cast(whole).cast(pyarrow.int64())
    first = compute.min(counts)
    from_first = compute.subtract(counts, first)  # before floats round it
    start = (first.as_py() or 0) * round(step * 1e9) if types.is_timestamp(column.type) else 0
    return np.asarray(from_first.to_numpy(), dtype=np.float64) * step, start
