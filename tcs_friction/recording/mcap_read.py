"""Messages of an mcap file, whole or damaged, in the order they lie there.

The file is read once from front to back, record by record (https://mcap.dev/spec), and needs neither summary nor
index. Where a record cannot be one, reading goes on at the next bytes that surely begin one.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

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

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
CHUNK_INDEX, STATISTICS, DATA_END = 8, 0x0B, 0x0F
KNOWN = range(1, 0x10)

_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_LIKELY = re.compile(rb"(?=[\x03-\x0f].{3}[\x00-\x7f]\x00{4})", re.DOTALL)
"""An opcode and a length below 2^31; `_surely` then looks whether a record really begins there."""

TAIL = 37
"""Bytes of the footer record and the closing magic."""

MAX_SUMMARY = 1 << 26
MAX_NOTED = 1 << 24
"""Bytes of a schema, channel, index or statistics record."""

STEPS_NOTE = 5
STEPS_RUN = 50
"""Steps (see Allowance) of keeping what a record says, and of finding and passing on a run of messages."""

MESSAGE_MIN = 22
CHUNK_MIN = 40
ODD_RECORDS = {DATA_END: range(4, 5), FOOTER: range(20, 21), STATISTICS: range(46, 1 << 20), SCHEMA: range(14, 1 << 24),
               CHANNEL: range(16, 1 << 24)}
"""Lengths that records other than messages, chunks and indexes can have."""


class McapScan:
    """One pass over one mcap file. After `batches` has ended, `damage` and `counted` are complete."""

    def __init__(self, path: Path, damage: Damage, allowance: Allowance) -> None:
        self.path = path
        self.damage = damage
        self.allowance = allowance
        self.channels: dict[int, Channel] = {}
        self.read = 0
        self.stated: int | None = None  # messages by the file's own statistics
        self.files = 1  # mcap files one behind the other in this one
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._uncounted = False
        self._lost_chunk = False  # the last chunk was lost and no index has said yet how many messages it had
        self._ended = False
        self._cut_bytes = 0
        self._before = 0  # messages that files in front of this one state, and their topics
        self.earlier: list[Channel] = []

    def batches(self) -> Iterator[Batch]:
        """Every whole message, in batches of one channel each."""
        size = self.path.stat().st_size
        with self.path.open("rb") as stream:
            self._read_summary(stream, size)
            window = Window(stream, size)
            if window.peek(8) == MAGIC:
                window.skip(8)
            else:
                self.damage.add("no mcap magic at the start", lost_messages=0)
            while window.remaining and not self._ended:
                yield from self._record(window)
                if self._ended:
                    self._look_behind(window)
        if not self._ended:
            self.damage.add("the end of the file is missing", self._cut_bytes)
        self._reckon()

    def _look_behind(self, window: Window) -> None:
        """Behind the end: the closing magic, and then another file, which is read as well, or what is no recording."""
        if window.peek(8) == MAGIC:
            window.skip(8)
        if window.peek(8) == MAGIC and window.remaining > 8:
            window.skip(8)
            self.files += 1
            self._ended = False
            self._before += self.stated or 0
            self.earlier.extend(self.channels.values())
            self.channels, self._schemas = {}, {}
            self.stated = None
        elif window.remaining:
            self.damage.add("bytes behind the end of the file, not read", window.remaining, 0)

    def record(self, record: bytes) -> Iterator[Batch]:
        """The whole messages of one record that lies in `record` alone, a chunk mostly."""
        window = Window(io.BytesIO(record), len(record))
        while window.remaining:
            yield from self._record(window)

    def _read_summary(self, stream: BinaryIO, size: int) -> None:
        """Topics and count from the end of the file, if it has a whole end: the chunk that has them may be lost."""
        if size > TAIL:
            stream.seek(-TAIL, 2)
            tail = stream.read(TAIL)
            operation, length, start = struct.unpack_from("<BQQ", tail)
            if tail.endswith(MAGIC) and (operation, length) == (FOOTER, 20) and 0 < start < size - TAIL:
                stream.seek(start)
                self.note_summary(stream.read(min(size - TAIL - start, MAX_SUMMARY)))
        stream.seek(0)

    def note_summary(self, summary: bytes) -> None:
        """Keep the topics and the count that the records of a summary say."""
        at = 0
        while at + 9 <= len(summary):
            self.allowance.spend(1)
            operation, length = _HEAD.unpack_from(summary, at)
            if length > len(summary) - at - 9 or operation not in KNOWN or operation == FOOTER:
                break  # of a file behind another it may lie anywhere
            if operation in (SCHEMA, CHANNEL, STATISTICS):
                self._note(operation, summary[at + 9 : at + 9 + length])
            at += 9 + length

    def _reckon(self) -> None:
        """Say how much was lost; the statistics at the end of the file know best."""
        self.damage.unsure |= self._uncounted
        if self.files > 1:
            self.stated = None if self.stated is None else self._before + self.stated
        if self.stated is None or not self.read <= self.stated <= self.read + self.path.stat().st_size:
            return  # a message takes more than a byte
        if self.damage:
            self.damage.lost_messages = self.stated - self.read
            self.damage.unsure = False
        elif self.stated > self.read:
            self.damage.add("fewer messages than the file's own count", lost_messages=self.stated - self.read)

    def _record(self, window: Window) -> Iterator[Batch]:
        head = window.peek(9)
        operation, length = _HEAD.unpack(head) if len(head) == 9 else (0, 0)
        if operation == MESSAGE and MESSAGE_MIN <= length <= min(window.remaining - 9, MAX_CHUNK):
            yield from self._loose_messages(window, length)
        elif operation == CHUNK and CHUNK_MIN <= length <= min(window.remaining - 9, MAX_CHUNK):
            yield from self._chunk(window, length)
        elif operation in KNOWN and operation not in (MESSAGE, CHUNK) and length <= window.remaining - 9:
            noted = operation in (SCHEMA, CHANNEL, MESSAGE_INDEX, STATISTICS) and length <= MAX_NOTED
            if noted and window.have(9 + length):
                content = window.data[window.start + 9 : window.start + 9 + length]
                self._note(operation, content)
            self._ended = operation == FOOTER
            window.skip(9 + length)
        elif head[:8] == MAGIC and window.remaining == 8:
            self._ended = True
            window.skip(8)
        else:
            yield from self._resume(window, operation)

    def _loose_messages(self, window: Window, length: int) -> Iterator[Batch]:
        window.have(min(max(9 + length, BLOCK), window.remaining))
        buffer = np.frombuffer(window.data, np.uint8)
        stop, batches = self._messages(buffer, window.start, len(buffer))
        window.skip(stop - window.start)
        yield from batches

    def _chunk(self, window: Window, length: int) -> Iterator[Batch]:
        window.have(9 + length)
        record = memoryview(window.data)[window.start + 9 : window.start + 9 + length]
        parts = _chunk_head(bytes(record[: CHUNK_MIN + 4]), length)
        if parts is None:
            if self._surely(window, 9 + length):
                self._lose_chunk("chunks with a broken head", length)
                window.skip(9 + length)
            else:
                yield from self._resume(window, 0)
            return
        size, crc, compression, at = parts
        try:
            raw = unpack(record[at:], compression, size, self.allowance)
        except UnpackError as error:
            self._lose_chunk(f"chunks that cannot be unpacked: {error}", length)
        else:
            if crc and zlib.crc32(raw) != crc:
                self._lose_chunk("chunks with a wrong CRC", length)
            else:
                yield from self._content(raw)
        window.skip(9 + length)

    def _content(self, raw: bytes, cut: bool = False) -> Iterator[Batch]:
        """The records inside a chunk; `cut` if it is known to end early."""
        buffer = np.frombuffer(raw, np.uint8)
        at = 0
        while at + 9 <= len(raw):
            self.allowance.spend(1)
            operation, length = _HEAD.unpack_from(raw, at)
            if not operation or length > len(raw) - at - 9 or (operation == MESSAGE and length < MESSAGE_MIN):
                break
            if operation == MESSAGE:
                at, batches = self._messages(buffer, at, len(raw))
                yield from batches
                continue
            if operation in (SCHEMA, CHANNEL):
                self._note(operation, raw[at + 9 : at + 9 + length])
            at += 9 + length
        if at < len(raw) and not cut:
            self.damage.add("chunks with broken records", len(raw) - at)

    def _messages(self, buffer: kernels.Buffer, start: int, stop: int) -> tuple[int, Iterator[Batch]]:
        """The run of messages at `start`: where it ends, and its batches."""
        self.allowance.spend(STEPS_RUN)
        count, end = kernels.count_mcap_messages(buffer, start, stop)
        channels, log_times, starts, lengths = np.empty((4, count), dtype=np.int64)
        kernels.list_mcap_messages(buffer, start, channels, log_times, starts, lengths)
        return end, self._by_channel(buffer, channels, log_times, starts, lengths)

    def _by_channel(self, buffer, channels, log_times, starts, lengths) -> Iterator[Batch]:  # type: ignore[no-untyped-def]
        for number, chosen in by_number(channels):
            self.allowance.spend(STEPS_RUN)
            batch_starts = starts[chosen]
            known = self.channels.get(number)
            if known is None:
                self.damage.add("messages whose channel is unknown", int(lengths[chosen].sum()), len(batch_starts))
                continue
            self.read += len(batch_starts)
            yield Batch(known, buffer, log_times[chosen], batch_starts, lengths[chosen])

    def _note(self, operation: int, content: bytes) -> None:
        """Keep what a record other than a message or chunk says."""
        self.allowance.spend(STEPS_NOTE)
        try:
            if operation == SCHEMA:
                self._add_schema(_Fields(content))
            elif operation == CHANNEL:
                self._add_channel(_Fields(content))
            elif operation == STATISTICS:
                self.stated = int(struct.unpack_from("<Q", content)[0])
            elif self._lost_chunk:
                self.damage.lost_messages += int(struct.unpack_from("<I", content, 2)[0]) // 16
                self._uncounted = False
        except (struct.error, UnicodeDecodeError):
            self.damage.add("broken schema, channel or index records", len(content))
        if operation != MESSAGE_INDEX:
            self._lost_chunk = False

    def _add_schema(self, fields: _Fields) -> None:
        number = fields.u16()
        self._schemas[number] = (fields.text(), fields.text(), fields.text())

    def _add_channel(self, fields: _Fields) -> None:
        number, schema = fields.u16(), fields.u16()
        topic, encoding = fields.text(), fields.text()
        name, definition_encoding, definition = self._schemas.get(schema, ("", "", ""))
        known = self.damage.channel(topic, name, encoding, definition, definition_encoding, _qos(fields.raw()))
        if known is None or (number not in self.channels and len(self.channels) >= MAX_TOPICS):
            return
        self.channels[number] = known

    def _lose_chunk(self, what: str, length: int) -> None:
        self.damage.add(what, length, 0)
        self.damage.unsure |= self._uncounted
        self._lost_chunk = self._uncounted = True

    def _resume(self, window: Window, operation: int) -> Iterator[Batch]:
        """Go on after bytes that are no record: at the next sure one, or not at all."""
        if operation == CHUNK and (cut := self._cut_chunk(window)) is not None:
            yield from self._content(cut, cut=True)
            window.skip(window.remaining)
            return
        begin = window.offset
        window.skip(1)
        while window.remaining:
            window.have(min(BLOCK, window.remaining))
            data, start = window.data, window.start
            last = len(data) if len(data) - start == window.remaining else start + (len(data) - start) // 2
            likely = (match.start() for match in _LIKELY.finditer(data, start, last))
            at = next((place for place in likely if self._surely(window, place - start)), last)
            window.skip(at - start)
            if at < last:
                break
        if window.remaining:
            self.damage.add("stretches that are no records", window.offset - begin)
        else:
            self._cut_bytes = window.offset - begin

    def _cut_chunk(self, window: Window) -> bytes | None:
        """What can be unpacked of a chunk that the end of the file cuts; None if it is not that."""
        head = window.peek(9 + CHUNK_MIN + 4)
        length = _HEAD.unpack_from(head)[1] if len(head) >= 9 else 0
        parts = _chunk_head(head[9:], length) if length > window.remaining - 9 else None
        if parts is None or window.remaining > MAX_CHUNK or not self.allowance.unpack(window.remaining):
            return None
        size, _, compression, at = parts
        packed = window.peek(window.remaining)[9 + at :]
        try:
            return unpack(packed, compression, size, self.allowance)
        except UnpackError as error:
            return error.partial

    def _surely(self, window: Window, at: int) -> bool:
        """Whether a record begins `at` bytes into the window: a whole chunk, or two likely records in a row."""
        self.allowance.spend(STEPS_NOTE)
        data, start, sure = window.data, window.start + at, 0
        while sure < 2:
            room = window.remaining - (start - window.start)
            if room == len(MAGIC) and data[start : start + 8] == MAGIC:
                return sure > 0
            if start + 9 > len(data):
                return sure > 0 and room == 0
            operation, length = _HEAD.unpack_from(data, start)
            if length > room - 9 or not self._likely(data, start, operation, length):
                return False
            if operation == CHUNK:
                return True
            sure += 1
            start += 9 + length
        return True

    def _likely(self, data: bytes, start: int, operation: int, length: int) -> bool:
        if operation == CHUNK:
            return _chunk_head(data[start + 9 : start + 9 + CHUNK_MIN + 4], length) is not None
        if operation == MESSAGE:
            number = int.from_bytes(data[start + 9 : start + 11], "little")
            return length >= MESSAGE_MIN and (number in self.channels or not self.channels)
        if operation == MESSAGE_INDEX:
            return length >= 6 and length % 16 == 6
        return length in ODD_RECORDS.get(operation, range(8, 1 << 24)) and operation in KNOWN


class _Fields:
    """The fields of a record one after the other. Raises struct.error past the end."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.at = 0

    def u16(self) -> int:
        self.at += 2
        return int(struct.unpack_from("<H", self.content, self.at - 2)[0])

    def raw(self) -> bytes:
        (length,) = struct.unpack_from("<I", self.content, self.at)
        self.at += 4 + length
        if self.at > len(self.content):
            raise struct.error("string past the end of the record")
        return self.content[self.at - length : self.at]

    def text(self) -> str:
        return self.raw().decode()


def _chunk_head(head: bytes, length: int) -> tuple[int, int, str, int] | None:
    """Unpacked size, CRC, compression and where the packed bytes begin; None if the sizes do not agree."""
    if len(head) < CHUNK_MIN:
        return None
    _, _, size, crc, text = _CHUNK_HEAD.unpack_from(head)
    if text > 4 or len(head) < CHUNK_MIN + text:
        return None
    compression = head[32 : 32 + text]
    (packed,) = struct.unpack_from("<Q", head, 32 + text)
    if compression not in (b"", b"lz4", b"zstd") or CHUNK_MIN + text + packed != length:
        return None
    return size, crc, compression.decode(), CHUNK_MIN + text


def _qos(metadata: bytes) -> str:
    """The quality-of-service profiles among a channel's metadata."""
    fields = _Fields(metadata)
    try:
        while fields.at < len(metadata):
            key, value = fields.text(), fields.text()
            if key == "offered_qos_profiles":
                return value
    except (struct.error, UnicodeDecodeError):
        pass
    return ""
