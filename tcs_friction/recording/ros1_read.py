"""Messages of a ROS 1 bag (format 2.0), whole or damaged, in the order they lie there.

The file is read once from front to back and needs no index (http://wiki.ros.org/Bags/Format/2.0).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tcs_friction.recording import kernels
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.decode import Batch
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.storage import (
    BLOCK,
    MAX_CHUNK,
    MAX_TOPICS,
    Damage,
    UnpackError,
    Window,
    by_number,
    unpack,
)

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, CHUNK, CHUNK_INFO, CONNECTION = 2, 5, 6, 7
MAX_HEADER = 1 << 20
MAX_CHUNK_HEADER = 300
"""Bytes of a chunk's header: three short fields."""

CHUNK_FIELD = b"\x04\x00\x00\x00op=\x05"
"""The field of a record's header that makes it a chunk, behind its length."""

ROWS = 1 << 15

STEPS_NOTE = 20
STEPS_RUN = 50
"""Steps (see Allowance) of reading a connection, or of looking for a header once, and of passing on messages of one topic."""


class Ros1Scan:
    """One pass over one .bag file. After `batches` has ended, `damage` and `channels` are complete."""

    def __init__(self, path: Path, damage: Damage, allowance: Allowance) -> None:
        self.path = path
        self.damage = damage
        self.allowance = allowance
        self.channels: dict[int, Channel] = {}
        self.read = 0
        self.stated: int | None = None
        self._announced = 0

    def batches(self) -> Iterator[Batch]:
        """Every whole message, in batches of one channel each."""
        with self.path.open("rb") as stream:
            window = Window(stream, self.path.stat().st_size)
            if window.peek(len(MAGIC)) == MAGIC:
                window.skip(len(MAGIC))
            else:
                self.damage.add("no bag magic at the start", lost_messages=0)
            while window.remaining:
                yield from self._record(window)
        self.stated = self._announced or None
        if self.damage and self.stated is not None and self.stated >= self.read:
            self.damage.lost_messages, self.damage.unsure = self.stated - self.read, False

    def _record(self, window: Window) -> Iterator[Batch]:
        lengths = self._lengths(window)
        if lengths is None:
            yield from self._broken(window)
            return
        header_length, data_length = lengths
        head = _header(window.peek(4 + header_length)[4:])
        operation = head.get("op", b"\xff")[0]
        window.skip(8 + header_length)
        if operation not in (CHUNK, CONNECTION, CHUNK_INFO, MESSAGE):
            window.skip(data_length)
            return
        data = window.peek(data_length)
        window.skip(data_length)
        if operation == CHUNK:
            yield from self._chunk(head, data)
        elif operation == CONNECTION:
            self._connect(head, data)
        elif operation == CHUNK_INFO:
            counts = np.frombuffer(data[: len(data) // 8 * 8], dtype="<u4")[1::2]
            self._announced += int(counts.sum())
        elif operation == MESSAGE and len(head.get("time", b"")) == 8 and len(head.get("conn", b"")) == 4:
            seconds, nanoseconds = struct.unpack("<II", head["time"])
            number = int.from_bytes(head["conn"], "little")
            table = np.array([[MESSAGE, number, seconds * 10**9 + nanoseconds, 0, 0, data_length]])
            yield from self._messages(np.frombuffer(data, np.uint8), table)

    def _lengths(self, window: Window) -> tuple[int, int] | None:
        """Header and data length of the record that begins here, None if none whole does."""
        if not window.have(8):
            return None
        (header_length,) = struct.unpack_from("<I", window.data, window.start)
        if header_length > MAX_HEADER or not window.have(8 + header_length):
            return None
        if b"op=" not in window.data[window.start + 4 : window.start + 4 + header_length]:
            return None
        (data_length,) = struct.unpack_from("<I", window.data, window.start + 4 + header_length)
        return (header_length, data_length) if data_length <= min(window.remaining - 8 - header_length, MAX_CHUNK) else None

    def _broken(self, window: Window) -> Iterator[Batch]:
        """Take what a cut chunk still holds, or go on at the next chunk header."""
        begin = window.offset
        cut = self._cut_chunk(window)
        window.skip(1)
        while window.remaining:
            window.have(min(BLOCK, window.remaining))
            block, start = window.data, window.start
            at = block.find(CHUNK_FIELD, start)
            while at >= 0 and not self._begins(window, block, start, at):
                at = block.find(CHUNK_FIELD, at + 1)
            if at >= 0:
                break
            here = len(block) - start
            window.skip(here if here == window.remaining else here - 4096)
        if cut is not None and not window.remaining:
            self.damage.add("the last chunk is cut")
            yield from self._content(cut, cut=True)
        else:
            self.damage.add("stretches that are no records", window.offset - begin)

    def _begins(self, window: Window, block: bytes, start: int, at: int) -> bool:
        """Move the window to the chunk record whose header has its `op` field's length at `at`, if one does."""
        for begin in range(at - 4, max(start, at - MAX_CHUNK_HEADER) - 1, -1):
            self.allowance.spend(1)
            length = int.from_bytes(block[begin : begin + 4], "little")
            if at + 4 + len(b"op=\x05") <= begin + 4 + length <= begin + 4 + MAX_CHUNK_HEADER:
                self.allowance.spend(STEPS_NOTE)
                head = _header(block[begin + 4 : begin + 4 + length])
                if head.get("op") == b"\x05" and "compression" in head and "size" in head:
                    window.skip(begin - start)
                    return True
        return False

    def _cut_chunk(self, window: Window) -> bytes | None:
        head_bytes = window.peek(4096)
        if len(head_bytes) < 12:
            return None
        (length,) = struct.unpack_from("<I", head_bytes)
        head = _header(head_bytes[4 : 4 + length]) if length < 4096 - 8 else {}
        if head.get("op") != b"\x05" or window.remaining > MAX_CHUNK or not self.allowance.unpack(window.remaining):
            return None
        packed = window.peek(window.remaining)[8 + length :]
        try:
            return self._unpacked(head, packed)
        except UnpackError as error:
            return error.partial

    def _chunk(self, head: dict[str, bytes], data: bytes) -> Iterator[Batch]:
        try:
            raw = self._unpacked(head, data)
        except UnpackError as error:
            self.damage.add(f"chunks that cannot be unpacked: {error}", len(data))
            raw = error.partial
        yield from self._content(raw, cut=False)

    def _unpacked(self, head: dict[str, bytes], data: bytes) -> bytes:
        size = int.from_bytes(head.get("size", b"")[:4], "little")
        compression = head.get("compression", b"").decode(errors="replace")
        return unpack(data, "" if compression == "none" else compression, size, self.allowance)

    def _content(self, raw: bytes, cut: bool) -> Iterator[Batch]:
        buffer = np.frombuffer(raw, np.uint8)
        flat = np.empty(6 * ROWS, dtype=np.int64)
        at = 0
        while True:
            rows = kernels.list_ros1_records(buffer, at, len(raw), flat)
            table = flat[: 6 * rows].reshape(-1, 6).copy()
            for _, _, _, header_at, data_at, length in table[table[:, 0] == CONNECTION].tolist():
                self._connect(_header(raw[header_at : data_at - 4]), raw[data_at : data_at + length])
            yield from self._messages(buffer, table[(table[:, 0] == MESSAGE) & (table[:, 1] >= 0) & (table[:, 2] >= 0)])
            if rows:
                at = int(table[-1, 4] + table[-1, 5])
            if rows < ROWS:
                break
        if at < len(raw) and not cut:
            self.damage.add("chunks with broken records", len(raw) - at)

    def _messages(self, buffer: kernels.Buffer, table: kernels.Longs) -> Iterator[Batch]:
        for number, places in by_number(table[:, 1]):
            self.allowance.spend(STEPS_RUN)
            rows = table[places]
            if number not in self.channels:
                self.damage.add("messages whose connection is unknown", int(rows[:, 5].sum()), len(rows))
                continue
            self.read += len(rows)
            times, starts, lengths = (np.ascontiguousarray(rows[:, column]) for column in (2, 4, 5))
            yield Batch(self.channels[number], buffer, times, starts, lengths)

    def _connect(self, head: dict[str, bytes], data: bytes) -> None:
        self.allowance.spend(STEPS_NOTE)
        inner = _header(data)
        if len(head.get("conn", b"")) != 4 or "type" not in inner:
            self.damage.add("broken connection records", len(data), 0)
            return
        topic = head.get("topic", inner.get("topic", b"")).decode(errors="replace")
        msgtype = inner["type"].decode(errors="replace")
        definition = inner.get("message_definition", b"").decode(errors="replace")
        known = self.damage.channel(topic, msgtype, "ros1", definition, "ros1msg")
        if known is not None and len(self.channels) < MAX_TOPICS:
            self.channels.setdefault(int.from_bytes(head["conn"], "little"), known)


def _header(data: bytes) -> dict[str, bytes]:
    """Fields `name=value`, each behind its length; what is not one ends the list."""
    fields: dict[str, bytes] = {}
    at = 0
    while at + 4 <= len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        name, separator, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not separator or at + 4 + length > len(data):
            break
        fields[name.decode(errors="replace")] = value
        at += 4 + length
    return fields
