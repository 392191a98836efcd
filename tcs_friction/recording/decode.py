"""Columns from raw messages in bulk: one layout serves every message that has the same structure bytes."""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording import kernels
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.columns import Mask, Nanoseconds, TopicColumns
from tcs_friction.recording.definitions import Channel, full_name, types_of
from tcs_friction.recording.layout import Layout, MalformedError, layout
from tcs_friction.recording.mending import mended
from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.targets import stamp_path, target

MAX_LAYOUTS = 32
"""Layouts tried in bulk on one batch; messages that fit none of so many are parsed one by one."""

BLOCK_ROWS = 1 << 17
"""Rows of a column that are allocated at a time."""

SECOND = 1_000_000_000

STEPS_BATCH = 100
"""Steps (see Allowance) of decoding any batch."""

SERIALISED = "messages are serialised as"
READABLE = "cdr or ros1, or the signals as a table (.csv)"


@dataclass(frozen=True, eq=False)
class Batch:
    """Some messages of one channel as they lie in a buffer: (n,) log times in ns, payload offsets and lengths.

    piece: the piece of the file that they come from; batches of one piece follow one another.
    """

    channel: Channel
    buffer: NDArray[np.uint8]
    log_times: Nanoseconds
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]
    unpacked_from: NDArray[np.uint8] | None = None

    @property
    def piece(self) -> NDArray[np.uint8]:
        return self.buffer if self.unpacked_from is None else self.unpacked_from

    def __len__(self) -> int:
        return len(self.starts)

    def payload(self, index: int) -> bytes:
        """The serialised bytes of one message."""
        start = int(self.starts[index])
        return self.buffer[start : start + int(self.lengths[index])].tobytes()

    def payloads(self) -> Iterator[bytes]:
        """Every message's bytes."""
        return (self.payload(index) for index in range(len(self)))


class Decoder:
    """Decodes the batches of one channel into columns: the wanted sources and, if the type has one, the stamp."""

    def __init__(self, channel: Channel, sources: Sequence[SignalSource], bag: str, allowance: Allowance) -> None:
        """Raises InputError if the channel's type lacks a source."""
        self._allowance = allowance
        allowance.parse(channel.definition)
        allowance.spend(STEPS_BATCH)
        if channel.encoding not in ("cdr", "ros1"):
            raise InputError(f"{bag} {channel.topic}", f"{SERIALISED} {channel.encoding}", READABLE)
        self._types = types_of(channel)
        self._msgtype = full_name(channel.msgtype)
        self._ros1 = channel.encoding == "ros1"
        self._targets = [target(channel, source, bag) for source in sources]
        self.stamp = stamp_path(channel)
        self._layouts: list[Layout] = []
        self.names: dict[str, None] = {}  # joint names met, in order

    def decode(self, batch: Batch) -> tuple[Column, Mask, Nanoseconds | None, Mask]:
        """values (sources, n), absent (sources, n), stamps (n,) or None, and which messages could be decoded (n,)."""
        self._allowance.spend(STEPS_BATCH)
        count = len(batch)
        values = np.full((len(self._targets), count), np.nan)
        absent = np.zeros(values.shape, dtype=np.bool_)
        stamps = np.zeros(count, dtype=np.int64) if self.stamp is not None else None
        assigned = np.full(count, -1, dtype=np.int64)
        used = self._assign(batch, assigned)
        for number in used:
            self._gather(batch, assigned, number, self._layouts[number], values, absent, stamps)
        for index in np.flatnonzero(assigned == -1):
            self._single(batch, int(index), values, absent, stamps, assigned)
        return values, absent, stamps, assigned != -2

    def _assign(self, batch: Batch, assigned: NDArray[np.int64]) -> list[int]:
        """Give every message a layout: one known, else one made from the first message that fits none."""
        used = []
        number = 0
        left = len(batch)
        while left and number < MAX_LAYOUTS:
            if number == len(self._layouts):
                unassigned = np.flatnonzero(assigned == -1).tolist()
                fresh = next(filter(None, (self._layout(batch, index, assigned) for index in unassigned)), None)
                if fresh is None:
                    break
                self._layouts.append(fresh)
            known = self._layouts[number]
            before = left
            left = kernels.match_layout(
                batch.buffer, batch.starts, batch.lengths, assigned, number, known.offsets, known.content, known.size
            )
            if left < before:
                used.append(number)
            number += 1
        return used

    def _layout(self, batch: Batch, index: int, assigned: NDArray[np.int64]) -> Layout | None:
        """The layout of one message; a message that fits its type nowhere is marked -2."""
        try:
            raw = batch.payload(index)
            fresh = layout(raw, self._types, self._msgtype, self._ros1, self._targets, self.stamp, self._allowance)
        except MalformedError:
            assigned[index] = -2
            return None
        self.names.update(dict.fromkeys(fresh.names))
        return fresh

    def _gather(
        self, batch: Batch, assigned: NDArray[np.int64], number: int, known: Layout,
        values: Column, absent: Mask, stamps: Nanoseconds | None,
    ) -> None:  # fmt: skip
        chosen = assigned == number
        whole = bool(chosen.all())

        def column(offset: int, code: str) -> NDArray[Any]:
            out = np.empty((len(batch), int(code[2])), dtype=np.uint8)
            kernels.gather(batch.buffer, batch.starts, assigned, number, offset, out)
            return out.view(code)[:, 0]

        def place(into: NDArray[Any], values: NDArray[Any]) -> None:
            if whole:
                into[:] = values
            else:
                into[chosen] = values[chosen]

        for row, item in enumerate(known.columns):
            if item is None:
                absent[row, chosen] = True
            else:
                place(values[row], column(*item))
        if stamps is not None and known.stamp is not None:
            seconds = column(known.stamp, f"{known.order}i4").astype(np.int64)
            place(stamps, seconds * SECOND + column(known.stamp + 4, f"{known.order}u4"))

    def _single(
        self, batch: Batch, index: int, values: Column, absent: Mask, stamps: Nanoseconds | None,
        assigned: NDArray[np.int64],
    ) -> None:  # fmt: skip
        fresh = self._layout(batch, index, assigned)
        if fresh is None:
            return
        raw = batch.payload(index)
        for row, item in enumerate(fresh.columns):
            if item is None:
                absent[row, index] = True
            else:
                values[row, index] = np.frombuffer(raw, item[1], 1, item[0])[0]
        if stamps is not None and fresh.stamp is not None:
            seconds = int(np.frombuffer(raw, f"{fresh.order}i4", 1, fresh.stamp)[0])
            stamps[index] = seconds * SECOND + int(np.frombuffer(raw, f"{fresh.order}u4", 1, fresh.stamp + 4)[0])


class Blocks:
    """Values that come in parts. They lie in large blocks, which go back to the system one by one as they are joined."""

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.blocks: list[NDArray[Any]] = []
        self.room = 0

    def add(self, values: NDArray[Any]) -> None:
        while len(values):
            if not self.room:
                memory = mmap.mmap(-1, BLOCK_ROWS * np.dtype(self.kind).itemsize)  # unlike the heap's, it goes back
                self.blocks.append(np.frombuffer(memory, dtype=self.kind))
                self.room = BLOCK_ROWS
            count = min(self.room, len(values))
            start = BLOCK_ROWS - self.room
            self.blocks[-1][start : start + count] = values[:count]
            values = values[count:]
            self.room -= count

    def joined(self) -> NDArray[Any]:
        whole: NDArray[Any] = np.empty(len(self.blocks) * BLOCK_ROWS - self.room, dtype=self.kind)
        self.blocks.reverse()
        for start in range(0, len(whole), BLOCK_ROWS):
            part = whole[start : start + BLOCK_ROWS]
            part[:] = self.blocks.pop()[: len(part)]
        return whole


class _Growing:
    """The columns of one topic while batches come in."""

    def __init__(self, topic: str, sources: Sequence[SignalSource], allowance: Allowance) -> None:
        self.topic = topic
        self.allowance = allowance
        self.sources = tuple(dict.fromkeys(sources))
        self.decoders: dict[Channel, Decoder] = {}
        self.log_times = Blocks(np.int64)
        self.stamps = Blocks(np.int64)
        self.values = [Blocks(np.float64) for _ in self.sources]
        self.absent = [Blocks(np.bool_) for _ in self.sources]
        self.spoilt = self.count = 0

    def add(self, batch: Batch, bag: str) -> None:
        decoder = self.decoders.get(batch.channel)
        if decoder is None:
            decoder = self.decoders[batch.channel] = Decoder(batch.channel, self.sources, bag, self.allowance)
        values, absent, stamps, good = decoder.decode(batch)
        spoilt = int(np.count_nonzero(~good))
        self.spoilt += spoilt
        rows = np.flatnonzero(good) if spoilt else slice(None)
        self.log_times.add(batch.log_times[rows])
        self.stamps.add((stamps if stamps is not None else np.zeros(len(batch), dtype=np.int64))[rows])
        for row, source in enumerate(self.sources):
            self.values[row].add(source.si(values[row, rows]))
            if absent[row].any() or self.absent[row].blocks:
                self.absent[row].add(np.zeros(self.count - self._noted(row), dtype=np.bool_))
                self.absent[row].add(absent[row, rows])
        self.count += len(batch) - spoilt

    def _noted(self, row: int) -> int:
        return len(self.absent[row].blocks) * BLOCK_ROWS - self.absent[row].room

    def columns(self, bag: str) -> TopicColumns:
        headers = any(decoder.stamp is not None for decoder in self.decoders.values())
        values, absent = {}, {}
        for row, source in enumerate(self.sources):
            if self.absent[row].blocks:
                absent[source] = self.absent[row].joined()
                if absent[source].all():
                    raise self._nowhere(source, bag)
            values[source] = self.values[row].joined()
        stamps = self.stamps.joined()
        return TopicColumns(self.topic, self.log_times.joined(), stamps if headers else None, values, absent)

    def _nowhere(self, source: SignalSource, bag: str) -> InputError:
        names = [name for decoder in self.decoders.values() for name in decoder.names]
        if source.joint is not None and source.joint not in names:
            return InputError(f"{bag} {self.topic}", f"no joint {source.joint}", nearest(source.joint, names))
        whose = f" for joint {source.joint}" if source.joint is not None else ""
        return InputError(f"{bag} {self.topic}", f"{source.field} is empty{whose} in every message", "values")


def topic_columns(
    batches: Iterable[Batch], wanted: dict[str, list[SignalSource]], bag: str, told: list[str], allowance: Allowance
) -> dict[str, TopicColumns]:
    """Columns of every wanted topic that has messages. Messages that do not fit their type are counted in `told`."""
    growing = {topic: _Growing(topic, sources, allowance) for topic, sources in wanted.items()}
    for batch in batches:
        if batch.channel.topic in growing and len(batch):
            growing[batch.channel.topic].add(batch, bag)
    result = {}
    for topic, parts in growing.items():
        if parts.spoilt:
            told.append(mended(f"{topic}: {parts.spoilt} messages do not fit their type, left out"))
        if parts.count:
            result[topic] = parts.columns(bag)
    return result
