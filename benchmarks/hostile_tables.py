"""Tables made to hurt their reader, as CSV and as Parquet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow
from pyarrow import parquet

from benchmarks.hostile_bags import Maker


def good_csv(path: Path, size: int) -> Path:
    """An ordinary table."""
    rows = [f"{n},{n * 0.1},{n * 0.2},{20 + n * 0.01}" for n in range(size)]
    return _text(path, "\n".join(["time [s],angle [deg],torque [mNm],temperature [K]", *rows]))


def many_columns(path: Path, size: int) -> Path:
    """A line of names and hardly any row."""
    return _text(path, ",".join(f"c{n}" for n in range(size)) + "\n1,2\n")


def long_cell(path: Path, size: int) -> Path:
    """One cell of `size` characters."""
    return _text(path, 'time,position,torque\n1,2,"' + "9" * size + '"\n')


def blanks(path: Path, size: int) -> Path:
    """A name of blanks between two letters."""
    return _text(path, "t" + " " * size + "(a,position,torque\n1,2,3\n2,3,4\n")


def digits(path: Path, size: int) -> Path:
    """Numbers of `size` digits and exponents."""
    return _text(path, "time,position,torque\n" + f"1,{'9' * size},1e{'9' * size}\n" * 3)


def good_parquet(path: Path, size: int) -> Path:
    """An ordinary Parquet file, with times of its own type."""
    columns = {
        "time": pyarrow.array(np.arange(size), pyarrow.timestamp("ms")),
        "position [rad]": np.arange(size) * 0.1,
        "torque [N m]": np.arange(size) * 0.2,
    }
    return _parquet(path, columns)


def flood(path: Path, size: int) -> Path:
    """Columns of zeros, which take no room."""
    zeros = np.zeros(size)
    return _parquet(path, {"time": np.arange(size), "position": zeros, "torque": zeros, "more": zeros})


def texts(path: Path, size: int) -> Path:
    """The same long text again and again."""
    return _parquet(path, {"time": np.arange(size), "position": np.zeros(size), "torque": ["x" * 1000] * size})


def _text(path: Path, text: str) -> Path:
    path = path.with_suffix(".csv")
    path.write_text(text)
    return path


def _parquet(path: Path, columns: dict[str, object]) -> Path:
    path = path.with_suffix(".parquet")
    parquet.write_table(pyarrow.table(columns), path)
    return path


CASES: dict[Maker, tuple[int, int]] = {
    good_csv: (1, 2000), many_columns: (1, 1_000_000), long_cell: (1, 10_000_000), blanks: (1, 1_000_000),
    digits: (1, 100_000), good_parquet: (1, 2000), flood: (1, 5_000_000), texts: (1, 20_000),
}  # fmt: skip
"""Makers, each with the least and the largest size to draw."""
