"""Arrays by name as columns: .mat files of MATLAB and .npz files of numpy."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.recording import Column
from tcs_friction.recording.table import Table, checked

BLOCK = 1 << 20
MAT_HEADER, MAT_TAG, MAT_COMPRESSED = 128, 8, 15  # MAT-File Format, version 5: bytes of the header, of a tag; miCOMPRESSED
NPY_VERSIONS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def columns_of(
    arrays: Mapping[str, np.ndarray], path: Path, notes: list[str], called: Mapping[str, tuple[str, ...]] | None = None
) -> dict[str, Column]:
    """Arrays of one length as columns, those of a matrix as NAME[0], ... or as `called`; the rest is left out and noted."""
    sizes = [max(array.shape) for array in arrays.values() if array.ndim and array.size]
    length = max(sizes, key=lambda size: (sizes.count(size), size), default=0)
    columns: dict[str, Column] = {}
    for name, array in arrays.items():
        matrix = np.atleast_2d(array.squeeze()) if array.size else array
        if matrix.ndim == 2 and matrix.shape[0] != length and matrix.shape[1] == length:
            matrix = matrix.T
        if matrix.ndim != 2 or matrix.shape[0] != length or not length:
            notes.append(f"{name!r} of shape {array.shape} is no column of {length} numbers, left out")
            continue
        width = matrix.shape[1]
        names = (called or {}).get(name) or ((name,) if width == 1 else tuple(f"{name}[{k}]" for k in range(width)))
        columns.update(zip(names, np.ascontiguousarray(matrix.T, dtype=np.float64), strict=True))
    checked(list(columns), path)
    return columns


def read_npz(path: Path) -> Table:
    """The arrays of a .npz file; none is unpickled. Raises InputError for what is none, or claims or unpacks to too much."""
    allowance = Allowance(str(path), path.stat().st_size)
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                with archive.open(entry) as stream:
                    _refuse_claims(stream, entry, allowance)
        with np.load(path, allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(str(path), f"cannot be read ({error})", "an .npz file of numbers") from None
    return _table(arrays, path)


def _refuse_claims(stream: Any, entry: zipfile.ZipInfo, allowance: Allowance) -> None:
    """Raises InputError for an array that is larger than what its file unpacks to, or that takes too much."""
    read = NPY_VERSIONS.get(np.lib.format.read_magic(stream))
    if read is None:
        raise ValueError(f"{entry.filename} is of an unknown version")
    shape, _, kind = read(stream)
    size = int(np.prod([int(side) for side in shape], dtype=object)) * kind.itemsize
    if size > entry.file_size or not allowance.unpack(max(size, entry.file_size)):
        raise InputError(allowance.where, f"{entry.filename} claims {size} bytes", "arrays that are in the file")


def read_mat(path: Path) -> Table:
    """Numbers of a .mat file up to version 7, also in structures. Raises InputError for what is none or unpacks to too much."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    allowance = Allowance(str(path), path.stat().st_size)
    try:
        with path.open("rb") as stream:
            _measure(stream, path.stat().st_size, allowance)
        found = loadmat(path, squeeze_me=True, struct_as_record=True)
    except (OSError, ValueError, TypeError, LookupError, MemoryError, MatReadError, zlib.error, NotImplementedError) as error:
        raise InputError(str(path), f"cannot be read ({' '.join(str(error).split())})", "a .mat file of numbers") from None
    arrays: dict[str, np.ndarray] = {}
    for name, value in found.items():
        if not name.startswith("__"):
            _numbers(name, value, arrays, allowance)
    return _table(arrays, path)


def _measure(stream: BinaryIO, size: int, allowance: Allowance) -> None:
    """What the compressed parts of a file unpack to, without keeping it. Raises InputError when it is too much."""
    place = MAT_HEADER
    order = "big" if stream.read(MAT_HEADER)[-2:] == b"MI" else "little"
    while place + MAT_TAG <= size:
        stream.seek(place)
        tag = stream.read(MAT_TAG)
        kind, length = (int.from_bytes(part, "big" if order == "big" else "little") for part in (tag[:4], tag[4:]))
        if kind == MAT_COMPRESSED:
            decoder, left = zlib.decompressobj(), min(length, size - place - MAT_TAG)
            while left > 0 and (piece := stream.read(min(BLOCK, left))):
                left -= len(piece)
                while piece:
                    if not allowance.unpack(len(decoder.decompress(piece, BLOCK))):
                        raise InputError(allowance.where, "unpacks to far more than its size", "a .mat file of numbers")
                    piece = decoder.unconsumed_tail
        allowance.spend(1)
        place += MAT_TAG + length


def _numbers(name: str, value: Any, arrays: dict[str, np.ndarray], allowance: Allowance, depth: int = 0) -> None:
    """The arrays of numbers in a variable; those of a structure as NAME.FIELD."""
    allowance.spend(1)
    array = np.asarray(value)
    if array.dtype.names and array.size == 1 and depth < 8:
        for field in array.dtype.names:
            _numbers(f"{name}.{field}", array[field].ravel()[0], arrays, allowance, depth + 1)
    elif array.dtype.kind in "fiub":
        arrays[name] = array


def _table(arrays: Mapping[str, np.ndarray], path: Path) -> Table:
    notes: list[str] = []
    numbers = {name: array for name, array in arrays.items() if array.dtype.kind in "fiub"}
    notes += [f"{name!r} holds no numbers, left out" for name in arrays if name not in numbers]
    columns = columns_of({name: array for name, array in numbers.items() if array.ndim}, path, notes)
    if not columns:
        raise InputError(str(path), "no arrays of numbers", "one for time, position and torque each")
    return Table(columns, notes=tuple(notes))
