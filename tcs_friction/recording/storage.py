"""What every storage reader shares: the count of what was lost, bounded decompression, a window on a file."""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np
from lz4.frame import LZ4FrameDecompressor
from numpy.typing import NDArray

from tcs_friction.errors import printable
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.columns import counted
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.mending import DAMAGED

if sys.version_info >= (3, 14):
    from compression import zstd as zstd
else:
    from backports import zstd as zstd

BLOCK = 1 << 22
"""Bytes read from a file at a time."""

MAX_CHUNK = 1 << 28
"""Bytes of a chunk or message, packed or not; `ros2 bag` writes chunks of a few MB."""

MAX_TOPICS = 2048
"""Topics of one file; large robots have some hundreds."""

MAX_NAME = 256
"""Characters of a topic's and of a type's name; DDS takes no longer ones."""

MAX_QOS = 1 << 16
"""Characters of a topic's quality of service; a publisher takes about 300."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

DECODERS: dict[str, Callable[[], Any]] = {
    "lz4": LZ4FrameDecompressor, "zstd": zstd.ZstdDecompressor, "bz2": bz2.BZ2Decompressor
}  # fmt: skip
BROKEN = (RuntimeError, zstd.ZstdError, ValueError, EOFError, OSError)
"""What decoders raise for bytes that they cannot have made."""


@dataclass
class Damage:
    """What a reader could not read, counted while it goes on."""

    kinds: dict[str, int] = field(default_factory=dict)
    lost_messages: int = 0
    lost_bytes: int = 0
    unsure: bool = False

    def add(self, what: str, lost_bytes: int = 0, lost_messages: int | None = None) -> None:
        """Note one more of a kind of damage; messages None means that nobody can say how many."""
        self.kinds[what] = self.kinds.get(what, 0) + 1
        self.lost_bytes += lost_bytes
        if lost_messages is None:
            self.unsure = True
        else:
            self.lost_messages += lost_messages

    def channel(
        self, topic: str, msgtype: str, encoding: str, definition: str, definition_encoding: str, qos: str = ""
    ) -> Channel | None:
        """A topic as a file describes it, with control characters shown; None for names that no topic can have."""
        if max(map(len, (topic, msgtype, encoding, definition_encoding))) > MAX_NAME:
            self.add(f"names of topics or types longer than {MAX_NAME} characters")
            return None
        topic, msgtype, encoding = map(printable, (topic, msgtype, encoding))
        return Channel(topic, msgtype, encoding, definition, definition_encoding, qos if len(qos) <= MAX_QOS else "")

    def __bool__(self) -> bool:
        return bool(self.kinds)

    def __str__(self) -> str:
        what = "; ".join(f"{kind} ({count} times)" if count > 1 else kind for kind, count in self.kinds.items())
        lost = []
        if self.lost_messages:
            lost.append(f"{'at least ' if self.unsure else ''}{counted(self.lost_messages, 'message')}")
        elif self.unsure:
            lost.append("an unknown number of messages")
        if self.lost_bytes:
            lost.append(counted(self.lost_bytes, "byte"))
        return f"{DAMAGED}{what}; lost: {' and '.join(lost) or 'nothing'}"


def by_number(numbers: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Each number met, with the places where it stands."""
    order = np.argsort(numbers, kind="stable")
    edges = np.flatnonzero(np.diff(numbers[order])) + 1
    for places in np.split(order, edges) if len(order) else []:
        yield int(numbers[places[0]]), places


class UnpackError(Exception):
    """A compressed block that is broken; `partial` is what came out before the break."""

    def __init__(self, reason: str, partial: bytes = b"") -> None:
        super().__init__(reason)
        self.partial = partial


def unpack(data: bytes | memoryview, compression: str, size: int, allowance: Allowance) -> bytes:
    """Decompress a block (`lz4`, `zstd`, `bz2` or "") that says it becomes `size` bytes, never allocating much more.

    Raises UnpackError, with what could be had, when it does not or the allowance has no such room left.
    """
    if compression == "":
        if len(data) != size:
            raise UnpackError("wrong size", bytes(data))
        return bytes(data)
    if compression not in DECODERS:
        raise UnpackError(f"unknown compression {compression!r}")
    if size > MAX_CHUNK or not allowance.unpack(size):
        raise UnpackError("impossible size")
    whole = _in_one(DECODERS[compression]().decompress, data, size)
    return whole if whole is not None else _in_pieces(data, compression, size)


def _in_one(decompress: Callable[..., bytes], data: bytes | memoryview, size: int) -> bytes | None:
    try:
        raw = decompress(data, size + 1)
    except BROKEN:
        return None
    return raw if len(raw) == size else None


def _in_pieces(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """The slow way for damaged blocks, which keeps what comes out before the damage."""
    decoder = DECODERS[compression]()
    parts: list[bytes] = []
    total = 0
    for at in range(0, len(data), 1 << 14):
        piece = data[at : at + (1 << 14)]
        try:
            while total <= size and not decoder.eof:
                part = decoder.decompress(piece, size + 1 - total)
                parts.append(part)
                total += len(part)
                piece = b""
                if decoder.needs_input or not part:
                    break
        except BROKEN:
            break
    raise UnpackError("broken compression", b"".join(parts)[:size])


def unpack_file(packed: BinaryIO, out: BinaryIO, allowance: Allowance) -> bool:
    """Unpack a zstd file of one or more frames; False if it is cut, broken or unpacks to too much, with what came in `out`."""
    decoder, piece = zstd.ZstdDecompressor(), packed.read(1 << 16)
    try:
        while piece or not decoder.needs_input:
            if not allowance.unpack(out.write(decoder.decompress(piece, BLOCK))):
                return False
            if decoder.eof:
                piece = decoder.unused_data or packed.read(1 << 16)
                if not piece:
                    return True
                decoder = zstd.ZstdDecompressor()
            else:
                piece = packed.read(1 << 16) if decoder.needs_input else b""
    except zstd.ZstdError:
        pass
    return False


class Window:
    """A file read forward: `data[start:]` is what has been read and not yet passed; `offset` where `start` is."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self.stream = stream
        self.size = size
        self.data = b""
        self.start = 0
        self.offset = 0

    @property
    def remaining(self) -> int:
        """Bytes of the file from `start` on."""
        return self.size - self.offset

    def have(self, count: int) -> bool:
        """Whether `count` bytes follow, which are then in `data`. Never reads more than the file has."""
        if count > self.remaining:
            return False
        here = len(self.data) - self.start
        if here < count:
            more = self.stream.read(min(max(count - here, BLOCK), self.remaining - here))
            self.data = self.data[self.start :] + more
            self.start = 0
        return len(self.data) - self.start >= count

    def peek(self, count: int) -> bytes:
        """Up to `count` bytes from `start`, fewer at the end of the file."""
        self.have(min(count, self.remaining))
        return self.data[self.start : self.start + count]

    def skip(self, count: int) -> None:
        """Pass `count` bytes, which need not have been read."""
        self.offset += count
        here = len(self.data) - self.start
        if count <= here:
            self.start += count
        else:
            self.stream.seek(count - here, 1)
            self.data, self.start = b"", 0
