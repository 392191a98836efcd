"""What every storage reader shares: the count of what was lost, bounded decompression, a window on a file."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import BinaryIO

from lz4.frame import LZ4FrameDecompressor

from tcs_friction.recording.columns import counted

if sys.version_info >= (3, 14):
    from compression import zstd as zstd
else:
    from backports import zstd as zstd

BLOCK = 1 << 22
"""Bytes read from a file at a time."""

MAX_CHUNK = 1 << 28
"""Bytes a chunk may claim to unpack to; `ros2 bag` writes chunks of a few MB."""

MAX_RATIO = 1000
"""Small chunks may not claim to unpack to more than this many times their size; real ones reach 20."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


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
        return f"damaged: {what}; lost: {' and '.join(lost) or 'nothing'}"


class UnpackError(Exception):
    """A compressed block that is broken; `partial` is what came out before the break."""

    def __init__(self, reason: str, partial: bytes = b"") -> None:
        super().__init__(reason)
        self.partial = partial


def unpack(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Decompress a block (`lz4`, `zstd` or "") that says it becomes `size` bytes, never allocating much more.

    Raises UnpackError, with what could be had, when it does not.
    """
    if compression == "":
        if len(data) != size:
            raise UnpackError("wrong size", bytes(data))
        return bytes(data)
    if compression not in ("lz4", "zstd"):
        raise UnpackError(f"unknown compression {compression!r}")
    if size > MAX_CHUNK or size > MAX_RATIO * len(data) + BLOCK:
        raise UnpackError("impossible size")
    decoder = LZ4FrameDecompressor() if compression == "lz4" else zstd.ZstdDecompressor()
    whole = _in_one(decoder.decompress, data, size)
    return whole if whole is not None else _in_pieces(data, compression, size)


def _in_one(decompress: Callable[..., bytes], data: bytes | memoryview, size: int) -> bytes | None:
    try:
        raw = decompress(data, size + 1)
    except (RuntimeError, zstd.ZstdError, ValueError):
        return None
    return raw if len(raw) == size else None


def _in_pieces(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """The slow way for damaged blocks, which keeps what comes out before the damage."""
    decoder = LZ4FrameDecompressor() if compression == "lz4" else zstd.ZstdDecompressor()
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
        except (RuntimeError, zstd.ZstdError, ValueError, EOFError):
            break
    raise UnpackError("broken compression", b"".join(parts)[:size])


def unpack_file(packed: BinaryIO, out: BinaryIO) -> bool:
    """Unpack a zstd file of one or more frames; False if it is cut or broken, with what came before that in `out`."""
    decoder, piece = zstd.ZstdDecompressor(), packed.read(1 << 16)
    try:
        while piece or not decoder.needs_input:
            if out.write(decoder.decompress(piece, BLOCK)) and out.tell() > MAX_RATIO * packed.tell() + BLOCK:
                return False  # no recording shrinks like that
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
