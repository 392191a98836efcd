"""Whole mcap files read by their own index: of a file somewhere else only the chunks that hold wanted topics.

What a chunk holds is read as everywhere (`mcap_read`); this file only finds out where it lies (https://mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from tcs_friction.errors import InputError, printable
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.decode import Batch
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.mcap_read import (
    CHUNK_INDEX,
    FOOTER,
    MAGIC,
    MAX_SUMMARY,
    STATISTICS,
    TAIL,
    McapScan,
)
from tcs_friction.recording.storage import MAX_CHUNK, Damage

_HEAD = struct.Struct("<BQ")
_INDEX_HEAD = struct.Struct("<QQQQI")
_STATISTICS = struct.Struct("<QHIIIIQQI")
_OFFSET = struct.Struct("<HQ")
_COUNT = struct.Struct("<BQHI")
NEAR = 1 << 16
"""Bytes between two wanted chunks that are read along, since another request would take longer."""

MOST = 1 << 23
"""Bytes of one request for chunks that follow one another."""

STAMPED = 16
"""Bytes of a message in a message index."""


@dataclass(frozen=True)
class Chunk:
    """Where a chunk lies, and for each channel where the index of its messages does."""

    offset: int
    length: int
    channels: dict[int, int]


@dataclass(frozen=True, eq=False)
class Summary:
    """What the end of a file says: chunks in the order of the file, messages of each channel."""

    chunks: tuple[Chunk, ...]
    counts: dict[int, int]


class NoIndexError(Exception):
    """The file has no index that can be relied on."""


def summary_of(stream: BinaryIO, size: int, scan: McapScan) -> Summary:
    """The summary; topics go to `scan`. Raises NoIndexError unless it accounts for every chunk and message."""
    if size <= TAIL + len(MAGIC):
        raise NoIndexError
    stream.seek(size - TAIL)
    tail = stream.read(TAIL)
    operation, length, start = struct.unpack_from("<BQQ", tail)
    if not tail.endswith(MAGIC) or (operation, length) != (FOOTER, 20) or not 0 < start < size - TAIL:
        raise NoIndexError
    if size - TAIL - start > MAX_SUMMARY:
        raise NoIndexError
    stream.seek(start)
    text = stream.read(size - TAIL - start)
    scan.note_summary(text)
    try:
        return _checked(text, size, scan.allowance)
    except struct.error:
        raise NoIndexError from None


def _checked(text: bytes, size: int, allowance: Allowance) -> Summary:
    chunks: list[Chunk] = []
    counts: dict[int, int] = {}
    messages = expected = -1
    at = 0
    while at + 9 <= len(text):
        allowance.spend(1)
        operation, length = _HEAD.unpack_from(text, at)
        record = text[at + 9 : at + 9 + length]
        if operation == CHUNK_INDEX:
            chunks.append(_chunk(record, allowance))
        elif operation == STATISTICS:
            messages, _, _, _, _, expected, _, _, room = _STATISTICS.unpack_from(record)
            counts = _pairs(record, _STATISTICS.size, room, allowance)
        elif operation == FOOTER:
            raise NoIndexError  # files one behind the other: where their chunks lie is counted from each one's start
        at += 9 + length
    chunks.sort(key=lambda chunk: chunk.offset)
    whole = all(chunk.length <= MAX_CHUNK and chunk.offset + chunk.length <= size for chunk in chunks)
    if not chunks or len(chunks) != expected or sum(counts.values()) != messages or not whole:
        raise NoIndexError
    return Summary(tuple(chunks), counts)


def _chunk(record: bytes, allowance: Allowance) -> Chunk:
    _, _, offset, length, room = _INDEX_HEAD.unpack_from(record)
    return Chunk(offset, length, _pairs(record, _INDEX_HEAD.size, room, allowance))


def _pairs(record: bytes, at: int, room: int, allowance: Allowance) -> dict[int, int]:
    if at + room > len(record) or room % _OFFSET.size:
        raise struct.error("a map past the end of its record")
    allowance.spend(room // _OFFSET.size)
    return dict(_OFFSET.iter_unpack(record[at : at + room]))


@dataclass
class IndexedBag:
    """One recording of whole mcap files, open elsewhere: name, stream and size of each. Read like a `Bag`.

    Raises NoIndexError when one of the files has no index to rely on.
    """

    path: str
    files: Sequence[tuple[str, BinaryIO, int]]
    channels: set[Channel] = field(default_factory=set)
    damage: Damage = field(default_factory=Damage)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.allowance = Allowance(self.path, sum(size for _, _, size in self.files))
        self._scans = [McapScan(Path(name), self.damage, self.allowance) for name, _, _ in self.files]
        opened = zip(self.files, self._scans, strict=True)
        self._summaries = [summary_of(stream, size, scan) for (_, stream, size), scan in opened]
        self.channels = {channel for scan in self._scans for channel in scan.channels.values()}

    def lament(self) -> str:
        """The damage for the end of an error message."""
        return f" ({self.damage})" if self.damage else ""

    def count(self, topic: str) -> int:
        """Messages on a topic, as the files themselves count them."""
        scans = zip(self._scans, self._summaries, strict=True)
        return sum(summary.counts.get(number, 0) for scan, summary in scans for number in _numbers(scan, {topic}))

    def batches(self, topics: Collection[str] | None = None) -> Iterator[Batch]:
        """Messages of the topics (None: all), unpacked, in the order in which the files hold them."""
        yield from self.batches_from(topics, "", 0)[1]

    def batches_from(self, topics: Collection[str] | None, base: str, skipped: int) -> tuple[int, Iterator[Batch]]:
        """The same from the chunk on in which message `skipped` of topic `base` lies; and how many of those lie before it."""
        self.allowance.renew()
        places: list[tuple[int, Chunk]] = []
        passed = 0
        for number, (scan, summary) in enumerate(zip(self._scans, self._summaries, strict=True)):
            wanted = _numbers(scan, topics)
            own = _numbers(scan, {base})
            for chunk in summary.chunks:
                if not wanted & chunk.channels.keys():
                    continue
                if skipped and not places:
                    here = sum(self._messages_in(number, chunk.channels[key]) for key in own & chunk.channels.keys())
                    if passed + here <= skipped:
                        passed += here
                        continue
                places.append((number, chunk))
        return passed, self._read(places, topics)

    def _messages_in(self, number: int, offset: int) -> int:
        """How many messages the message index at `offset` lists."""
        stream = self.files[number][1]
        stream.seek(offset)
        head = stream.read(_COUNT.size)
        if len(head) < _COUNT.size:
            raise InputError(self.path, "an index of messages lies behind the end of the file", "a whole file")
        return int(_COUNT.unpack(head)[3]) // STAMPED

    def _read(self, places: Sequence[tuple[int, Chunk]], topics: Collection[str] | None) -> Iterator[Batch]:
        for number, group in _grouped(places):
            stream, scan = self.files[number][1], self._scans[number]
            first = group[0].offset
            stream.seek(first)
            data = memoryview(stream.read(group[-1].offset + group[-1].length - first))
            for chunk in group:
                record = bytes(data[chunk.offset - first : chunk.offset - first + chunk.length])
                for batch in scan.record(record):
                    if topics is None or batch.channel.topic in topics:
                        yield batch
        self.notes = [printable(str(self.damage))] if self.damage else []


def _numbers(scan: McapScan, topics: Collection[str] | None) -> set[int]:
    """The channels of the topics in one file."""
    return {number for number, channel in scan.channels.items() if topics is None or channel.topic in topics}


def _grouped(places: Sequence[tuple[int, Chunk]]) -> Iterator[tuple[int, list[Chunk]]]:
    """Chunks of one file that one request may get."""
    group: list[Chunk] = []
    of = -1
    for number, chunk in places:
        end = group[-1].offset + group[-1].length if group else 0
        near = group and number == of and chunk.offset - end <= NEAR and chunk.offset + chunk.length - group[0].offset <= MOST
        if group and not near:
            yield of, group
            group = []
        of = number
        group.append(chunk)
    if group:
        yield of, group
