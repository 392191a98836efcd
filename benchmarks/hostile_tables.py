"""Tables made to hurt their reader: text, Parquet, arrays of numpy and MATLAB."""

from __future__ import annotations

import gzip
import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pyarrow
from pyarrow import parquet
from scipy.io import savemat

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


def no_line_ends(path: Path, size: int) -> Path:
    """Numbers without an end of a line."""
    return _text(path, "1.5," * size)


def ragged(path: Path, size: int) -> Path:
    """Rows with more and more empty cells behind their numbers."""
    return _text(path, "time [s],position [deg],torque [A]\n" + "".join(f"{n},{n},{n}{',' * n}\n" for n in range(size)))


def dates(path: Path, size: int) -> Path:
    """Times in words, of which some are none."""
    rows = (f"2026-01-01T00:{n // 60 % 70:02d}:{n % 60:02d}.{n}+00:00,{n},{n}" for n in range(size))
    return _text(path, "\n".join(["time,position [deg],torque [%]", *rows]))


def packed(path: Path, size: int) -> Path:
    """A packed text of equal rows."""
    path = path.with_suffix(".csv.gz")
    path.write_bytes(gzip.compress(b"time,position,torque\n" + b"1,2,3\n" * size))
    return path


def arrays(path: Path, size: int) -> Path:
    """Arrays of numpy: of zeros, which take no room, and of one that claims more than there is."""
    path = path.with_suffix(".npz")
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (size * size,)})
    np.savez_compressed(path, time=np.arange(size), position=np.zeros(size))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("torque.npy", header.getvalue() + bytes(8 * size))
    return path


def matlab(path: Path, size: int) -> Path:
    """Variables of MATLAB, one in a structure, packed."""
    path = path.with_suffix(".mat")
    savemat(path, {"log": {"time": np.arange(size), "position": np.zeros(size)}, "torque": np.zeros(size)}, do_compression=True)
    return path


def lists(path: Path, size: int) -> Path:
    """Rows that hold lists of numbers."""
    row = pyarrow.array([[0.0] * 100] * size)
    return _parquet(path, {"timestamp": np.arange(size), "observation.state": row, "observation.effort": row})


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


def pipe(path: Path, _: int) -> Path:
    """A pipe into which nobody writes."""
    path = path.with_suffix(".csv")
    os.mkfifo(path)
    return path


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
    no_line_ends: (1, 5_000_000), ragged: (1, 3000), dates: (1, 20_000), packed: (1, 30_000_000), arrays: (1, 3_000_000),
    matlab: (1, 5_000_000), lists: (1, 50_000),
    digits: (1, 100_000), pipe: (1, 1), good_parquet: (1, 2000), flood: (1, 5_000_000), texts: (1, 20_000),
}  # fmt: skip
"""Makers, each with the least and the largest size to draw."""
