"""Where the wanted numbers stand in one serialised message, and which of its bytes say so.

Two messages whose structure bytes (array and string lengths, joint names) are equal have their numbers at the
same offsets, so one message's layout serves all that look like it. Serialisation: OMG CDR 1 (formal/02-06-51,
15.3) behind the four-byte encapsulation of DDS, little or big endian; or ROS 1, which is packed.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.definitions import TIMES, Types
from tcs_friction.recording.targets import Path, Target

CODES = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip


MAX_STRUCTURE = 1 << 19
"""Bytes of lengths and joint names in one message: 20,000 joints with names of 18 letters."""

STEPS_WALK = 80
"""Steps (see Allowance) of a walk over a message besides one for each field."""


class MalformedError(Exception):
    """The bytes do not fit the message type."""


@dataclass(frozen=True, eq=False)
class Layout:
    """size: bytes a message must have. offsets, content: (k,) structure bytes, where and which.

    columns: offset and numpy dtype of each target, None where the message does not have it. stamp: offset of the
    seconds, None without a header; nanoseconds follow. names: the joint names met, for messages to people.
    """

    size: int
    offsets: NDArray[np.int64]
    content: NDArray[np.uint8]
    columns: tuple[tuple[int, str] | None, ...]
    stamp: int | None
    order: str
    names: tuple[str, ...]

    def fits(self, raw: bytes) -> bool:
        """Whether a message has this layout; the compiled kernel does the same for many."""
        return len(raw) >= self.size and bool(np.all(np.frombuffer(raw, np.uint8)[self.offsets] == self.content))


class _CompleteError(Exception):
    """Everything wanted has been met; the rest of the message does not matter."""


@dataclass
class _Walk:
    """One pass over a message, noting offsets of wanted paths and the bytes that decide them."""

    raw: bytes
    types: Types
    order: str
    aligned: bool
    numbers: set[Path]
    lists: set[Path]
    allowance: Allowance
    position: int = 0
    structure: int = 0
    marks: list[tuple[int, int]] = field(default_factory=list)
    found: dict[Path, tuple[int, int, str]] = field(default_factory=dict)  # offset, count, dtype
    names: dict[Path, list[str]] = field(default_factory=dict)

    def take(self, size: int, count: int = 1) -> int:
        """Offset of `count` numbers of `size` bytes, which are passed."""
        if self.aligned and count:
            self.position += -(self.position - 4) % size
        offset = self.position
        self.position += size * count
        if self.position > len(self.raw):
            raise MalformedError(f"needs {self.position} bytes, has {len(self.raw)}")
        return offset

    def length(self) -> int:
        offset = self.take(4)
        self._mark(offset, 4)
        (count,) = struct.unpack_from(f"{self.order}I", self.raw, offset)
        if count > len(self.raw) - self.position:
            raise MalformedError(f"claims {count} elements in {len(self.raw) - self.position} bytes")
        return int(count)

    def _mark(self, offset: int, size: int) -> None:
        self.marks.append((offset, size))
        self.structure += size
        if self.structure > MAX_STRUCTURE:
            raise MalformedError(f"has more than {MAX_STRUCTURE} bytes of lengths and names")

    def text(self, wide: bool, marked: bool) -> str:
        size = self.length() * (4 if wide else 1)
        offset = self.take(1, size)
        if not marked:
            return ""
        self._mark(offset, size)
        return self.raw[offset : offset + size].rstrip(b"\0").decode(errors="replace")

    def met(self, path: Path, offset: int, count: int, code: str) -> None:
        if path in self.numbers:
            self.found[path] = (offset, count, code)
            self._finish()

    def _finish(self) -> None:
        if len(self.found) == len(self.numbers) and len(self.names) == len(self.lists):
            raise _CompleteError

    def struct(self, name: str, path: Path) -> None:
        if name in TIMES:
            self.met(path, self.take(4), 1, "i4")
            self.take(4)
            return
        for field_name, desc in self.types[name]:
            self.field(desc, (*path, field_name))

    def field(self, desc: FieldDesc, path: Path) -> None:
        self.allowance.spend(1)
        if desc[0] == Nodetype.BASE:
            self.base(str(desc[1][0]), path)
        elif desc[0] == Nodetype.NAME:
            self.struct(str(desc[1]), path)
        else:
            inner, count = desc[1]
            if desc[0] == Nodetype.SEQUENCE:
                count = self.length()
            self.elements(inner, count, path)

    def base(self, kind: str, path: Path) -> None:
        if kind in ("string", "wstring"):
            self.text(kind == "wstring", False)
        else:
            size = int(CODES[kind][1])
            self.met(path, self.take(size), 1, CODES[kind])

    def elements(self, inner: FieldDesc, count: int, path: Path) -> None:
        if inner[0] == Nodetype.BASE and inner[1][0] not in ("string", "wstring"):
            code = CODES[inner[1][0]]
            offset = self.take(int(code[1]), count)
            self.met(path, offset, count, code)
            for wanted in [number for number in self.numbers if number[:-1] == path and isinstance(number[-1], int)]:
                if int(wanted[-1]) < count:
                    self.met(wanted, offset + int(code[1]) * int(wanted[-1]), 1, code)
            return
        if path in self.lists:
            self.allowance.spend(count)
            self.names[path] = [self.text(False, True) for _ in range(count)]
            self._finish()
            return
        for index in range(count):
            before = self.position
            self.field(inner, (*path, index))
            if self.position == before:  # an element without content: claiming many costs nothing, so stop
                break


def layout(
    raw: bytes, types: Types, msgtype: str, ros1: bool, targets: Sequence[Target], stamp: Path | None, allowance: Allowance
) -> Layout:
    """The layout of one message. Raises MalformedError if the bytes do not fit the type."""
    allowance.spend(STEPS_WALK)
    order = "<"
    if not ros1:
        if len(raw) < 4 or raw[0] != 0 or raw[1] not in (0, 1):
            raise MalformedError("no plain CDR encapsulation")
        order = "<" if raw[1] else ">"
    numbers = {item.path for item in targets} | ({stamp} if stamp is not None else set())
    lists = {item.names for item in targets if item.names is not None}
    walk = _Walk(raw, types, order, not ros1, numbers, lists, allowance, 0 if ros1 else 4)
    try:
        walk.struct(msgtype, ())
    except _CompleteError:
        pass
    except (RecursionError, KeyError) as error:
        raise MalformedError(f"cannot be walked: {error}") from None
    if not ros1:
        walk.marks.insert(0, (0, 2))
    return _layout(walk, targets, stamp)


def _layout(walk: _Walk, targets: Sequence[Target], stamp: Path | None) -> Layout:
    columns = tuple(_column(walk, item) for item in targets)
    starts, sizes = np.array(walk.marks, dtype=np.int64).reshape(-1, 2).T
    before = np.cumsum(sizes) - sizes
    offsets = np.arange(sizes.sum()) + np.repeat(starts - before, sizes)
    content = np.frombuffer(walk.raw, np.uint8)[offsets]
    names = tuple(name for found in walk.names.values() for name in found)
    at = walk.found[stamp][0] if stamp in walk.found else None
    return Layout(walk.position, offsets, content, columns, at, walk.order, names)


def _column(walk: _Walk, item: Target) -> tuple[int, str] | None:
    if item.path not in walk.found:
        return None
    offset, count, code = walk.found[item.path]
    if item.names is not None:
        names = walk.names.get(item.names, [])
        if item.joint not in names or names.index(item.joint) >= count:
            return None
        offset += int(code[1]) * names.index(item.joint)
    return offset, walk.order + code
