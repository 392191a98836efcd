"""A small mcap writer (https://mcap.dev/spec) that loses at most the open chunk when its process is killed or the disk is full.

Each chunk carries the schemas and channels it needs, so a file without an end is readable up to its last chunk. A chunk that
the system does not take whole is cut off again: what is in the file stays readable.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import numpy as np
from lz4.frame import compress as lz4_compress

from tcs_friction.recording import kernels
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.mcap_read import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    SCHEMA,
    STATISTICS,
)
from tcs_friction.recording.storage import zstd

SUMMARY_OFFSET = 0x0E
CHUNK_BYTES = 1 << 20
MESSAGE_RECORD = np.dtype(
    [("operation", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_MESSAGE = struct.Struct("<BQHIQQ")
INDEX_ENTRY = struct.Struct("<QQ")


@dataclass
class _Chunk:
    """The records since the last chunk was written."""

    parts: list[bytes] = field(default_factory=list)
    size: int = 0
    start: int = 2**63 - 1
    end: int = 0
    index: dict[int, list[bytes]] = field(default_factory=dict)
    channels: set[int] = field(default_factory=set)


class McapWriter:
    """Writes messages to a new file. `flush` puts everything so far into the hands of the operating system."""

    def __init__(self, path: Path, compression: str = "") -> None:
        """compression of chunks: "", lz4 or zstd. Raises FileExistsError if the file exists, OSError if it cannot be written."""
        self.path = path
        self.compression = compression
        self.channels: list[tuple[Channel, str]] = []
        self.counts: list[int] = []
        self.start, self.end = 2**63 - 1, 0
        self._schemas: dict[tuple[str, str], int] = {}
        self._chunk = _Chunk()
        self._chunk_indexes: list[bytes] = []
        self._file = path.open("xb", buffering=0)  # chunks are the buffer, and what a failed write leaves has to be known
        self.size = 0
        try:
            self._put(MAGIC + _record(HEADER, _text("ros2") + _text("tcs_friction")))
        except OSError:
            self._file.close()
            path.unlink(missing_ok=True)
            raise

    @property
    def pending_size(self) -> int:
        """Bytes written and waiting."""
        return self.size + self._chunk.size

    @property
    def closed(self) -> bool:
        """Whether the file is finished, or given up."""
        return self._file.closed

    def add_channel(self, channel: Channel, type_hash: str = "") -> int:
        """Announce a topic; the number to write its messages with."""
        key = (channel.msgtype, channel.definition)
        self._schemas.setdefault(key, len(self._schemas) + 1)
        self.channels.append((channel, type_hash))
        self.counts.append(0)
        return len(self.channels) - 1

    def write(self, number: int, log_time: int, payload: bytes) -> None:
        """One message; log time in ns."""
        chunk = self._chunk
        self._use(number)
        chunk.index.setdefault(number, []).append(INDEX_ENTRY.pack(log_time, chunk.size))
        head = _MESSAGE.pack(MESSAGE, 22 + len(payload), number, self.counts[number] & 0xFFFFFFFF, log_time, log_time)
        chunk.parts += (head, payload)
        chunk.size += len(head) + len(payload)
        chunk.start, chunk.end = min(chunk.start, log_time), max(chunk.end, log_time)
        self.counts[number] += 1
        if chunk.size >= CHUNK_BYTES:
            self.flush()

    def write_chunk(self, numbers: Sequence[int], log_times: Sequence[kernels.Longs], payloads: Sequence[kernels.Buffer]) -> None:
        """One chunk of many messages, given per channel.

        numbers: (k,) channels. log_times: per channel (n,) ns. payloads: per channel (n, size) uint8.
        """
        self.flush()
        self._write_many(list(zip(numbers, log_times, payloads, strict=True)))
        self.flush()

    def flush(self) -> None:
        """Write the open chunk and its index, and hand all to the operating system. Raises OSError when that does not take it."""
        chunk, self._chunk = self._chunk, _Chunk()
        if not chunk.parts:
            return
        raw = b"".join(chunk.parts)
        packed = _packed(raw, self.compression)
        head = struct.pack("<QQQI", chunk.start, chunk.end, len(raw), zlib.crc32(raw))
        at = self.size
        content = head + _text(self.compression) + struct.pack("<Q", len(packed)) + packed
        record = _record(CHUNK, content)
        indexes, offsets = [], []
        position = at + len(record)
        for number, entries in chunk.index.items():
            data = b"".join(entries)
            index = _record(MESSAGE_INDEX, struct.pack("<HI", number, len(data)) + data)
            offsets.append(struct.pack("<HQ", number, position))
            position += len(index)
            indexes.append(index)
        body = b"".join(indexes)
        try:
            self._put(record + body)
        except OSError:
            for number, entries in chunk.index.items():
                self.counts[number] -= sum(map(len, entries)) // INDEX_ENTRY.size
            raise
        self._chunk_indexes.append(
            struct.pack("<QQQQ", chunk.start, chunk.end, at, len(record)) + _blob(b"".join(offsets))
            + struct.pack("<Q", len(body)) + _text(self.compression) + struct.pack("<QQ", len(packed), len(raw))
        )  # fmt: skip
        self.start, self.end = min(self.start, chunk.start), max(self.end, chunk.end)

    def close(self) -> None:
        """Finish the file: index and statistics, so that readers need not scan it. The file is closed even when that fails."""
        try:
            self.flush()
            self._put(self._end())
        finally:
            self._file.close()

    def _end(self) -> bytes:
        """Everything behind the last chunk."""
        data_end = _record(DATA_END, struct.pack("<I", 0))
        groups = {
            SCHEMA: [self._schema_record(key) for key in self._schemas],
            CHANNEL: [self._channel_record(number) for number in range(len(self.channels))],
            STATISTICS: [_record(STATISTICS, self._statistics())],
            CHUNK_INDEX: [_record(CHUNK_INDEX, index) for index in self._chunk_indexes],
        }
        start = position = self.size + len(data_end)
        body = offsets = b""
        for operation, records in groups.items():
            group = b"".join(records)
            if group:
                offsets += _record(SUMMARY_OFFSET, struct.pack("<BQQ", operation, position, len(group)))
            body += group
            position += len(group)
        tail = struct.pack("<BQQQ", FOOTER, 20, start, position)
        crc = zlib.crc32(body + offsets + tail)
        return data_end + body + offsets + tail + struct.pack("<I", crc) + MAGIC

    def __enter__(self) -> McapWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self.close()
        else:
            self._file.close()

    def _put(self, data: bytes) -> None:
        """All of it or, with an OSError, nothing."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise
        self.size += len(data)

    def _use(self, number: int) -> None:
        """Put schema and channel into the chunk before its first message of that channel."""
        chunk = self._chunk
        if number in chunk.channels:
            return
        channel, _ = self.channels[number]
        records = self._schema_record((channel.msgtype, channel.definition)) + self._channel_record(number)
        chunk.parts.append(records)
        chunk.size += len(records)
        chunk.channels.add(number)

    def _write_many(self, topics: list[tuple[int, kernels.Longs, kernels.Buffer]]) -> None:
        for number, _, _ in topics:
            self._use(number)
        chunk = self._chunk
        times = np.concatenate([log_times for _, log_times, _ in topics])
        sizes = np.concatenate([np.full(len(p), kernels.MESSAGE_HEAD + p.shape[1]) for _, _, p in topics])
        order = np.argsort(times, kind="stable")
        offsets = np.empty(len(order), dtype=np.int64)
        offsets[order] = np.cumsum(sizes[order]) - sizes[order]
        raw = np.empty(int(sizes.sum()), dtype=np.uint8)
        at = 0
        for number, log_times, payloads in topics:
            count = len(payloads)
            records = self._records(number, log_times, payloads)
            kernels.scatter(records, offsets[at : at + count], raw)
            index = np.column_stack((log_times, offsets[at : at + count] + chunk.size)).astype("<u8")
            chunk.index[number] = [index.tobytes()]
            self.counts[number] += count
            at += count
        chunk.parts.append(raw.tobytes())
        chunk.size += len(raw)
        chunk.start, chunk.end = int(times.min()), int(times.max())

    def _records(self, number: int, log_times: kernels.Longs, payloads: kernels.Buffer) -> kernels.Buffer:
        count, size = payloads.shape
        heads = np.zeros(count, dtype=MESSAGE_RECORD)
        heads["operation"], heads["length"], heads["channel"] = MESSAGE, 22 + size, number
        heads["sequence"] = self.counts[number] + np.arange(count)
        heads["log"] = heads["publish"] = log_times
        return np.concatenate((heads.view(np.uint8).reshape(count, -1), payloads), axis=1)

    def _schema_record(self, key: tuple[str, str]) -> bytes:
        name, definition = key
        encoding = "ros2idl" if definition.startswith("=" * 80 + "\nIDL: ") else "ros2msg"
        content = struct.pack("<H", self._schemas[key]) + _text(name) + _text(encoding) + _text(definition)
        return _record(SCHEMA, content)

    def _channel_record(self, number: int) -> bytes:
        channel, type_hash = self.channels[number]
        schema = self._schemas[(channel.msgtype, channel.definition)]
        metadata = {"offered_qos_profiles": channel.qos, "topic_type_hash": type_hash}
        pairs = b"".join(_text(key) + _text(value) for key, value in metadata.items())
        content = struct.pack("<HH", number, schema) + _text(channel.topic) + _text("cdr") + _blob(pairs)
        return _record(CHANNEL, content)

    def _statistics(self) -> bytes:
        start = self.start if any(self.counts) else 0
        counts = b"".join(struct.pack("<HQ", number, count) for number, count in enumerate(self.counts))
        return struct.pack(
            "<QHIIIIQQ", sum(self.counts), len(self._schemas), len(self.channels), 0, 0, len(self._chunk_indexes),
            start, self.end,
        ) + _blob(counts)  # fmt: skip


def _packed(raw: bytes, compression: str) -> bytes:
    if compression == "zstd":
        return bytes(zstd.compress(raw, 1))
    return bytes(lz4_compress(raw)) if compression == "lz4" else raw


def _record(operation: int, content: bytes) -> bytes:
    return struct.pack("<BQ", operation, len(content)) + content


def _blob(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _blob(text.encode())
