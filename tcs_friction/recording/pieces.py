"""Long recordings in pieces of about equally many samples, read one by one, so that none has to fit into memory whole."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from tcs_friction.errors import InputError
from tcs_friction.recording.align import align
from tcs_friction.recording.bags import Bag, read_columns
from tcs_friction.recording.decode import Batch, topic_columns
from tcs_friction.recording.mcap_index import IndexedBag
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource


@dataclass(frozen=True)
class Span:
    """Messages `start` to `stop` of the topic that has the position, counted through the whole recording."""

    start: int
    stop: int


def spans(count: int, most: int) -> tuple[Span, ...]:
    """`count` messages shared among as few pieces of at most `most` as there can be, none much smaller than another.

    >>> spans(5, 2)
    (Span(start=0, stop=1), Span(start=1, stop=3), Span(start=3, stop=5))
    """
    number = max(1, -(-count // most))
    cuts = [k * count // number for k in range(number + 1)]
    return tuple(Span(start, stop) for start, stop in itertools.pairwise(cuts))


def read_piece(bag: Bag | IndexedBag, signals: SignalMap, span: Span | None = None) -> Recording:
    """The recording that lies in a span of a bag, None: all of it; only that is held in memory.

    A signal other than position and torque without a message in the span is left out. Raises InputError when the bag lacks a
    topic, field or joint, or the span has too few samples.
    """
    if span is None:
        columns, notes = read_columns(bag, [source for _, source in signals.named()])
        return align(columns, signals, str(bag.path), notes)
    base = signals.position.topic
    wanted: dict[str, list[SignalSource]] = {}
    for _, source in signals.named():
        wanted.setdefault(source.topic, []).append(source)
    passed = 0
    batches: Iterator[Batch]
    if isinstance(bag, IndexedBag):
        passed, batches = bag.batches_from(wanted, base, span.start)
    else:
        batches = bag.batches(wanted)
    told: list[str] = []
    columns = topic_columns(cut(batches, base, span, passed), wanted, str(bag.path), told, bag.allowance)
    for source in (signals.position, signals.torque):
        if source.topic not in columns:
            found = f"no message on {source.topic} among samples {span.start} to {span.stop}"
            raise InputError(str(bag.path), found, "some")
    kept = {name: source for name, source in signals.named() if source.topic in columns}
    exogenous = {name: kept.pop(name) for name in signals.exogenous if name in kept}
    return align(columns, SignalMap(**kept, exogenous=exogenous), str(bag.path), told)


def cut(batches: Iterable[Batch], base: str, span: Span, passed: int = 0) -> Iterator[Batch]:
    """The batches from the piece of the file with the span's first message of `base` to that with its last.

    Messages of `base` outside the span are left out. In front come the last earlier messages of the other topics, since
    what changes seldom is held from there. passed: messages of `base` before the first batch.
    """
    last: dict[str, Batch] = {}
    seen = passed
    for _, together in itertools.groupby(batches, key=lambda batch: id(batch.piece)):
        group = list(together)
        here = sum(len(batch) for batch in group if batch.channel.topic == base)
        if seen >= span.stop:
            return
        if seen + here <= span.start:
            last.update((batch.channel.topic, _part(batch, len(batch) - 1, len(batch))) for batch in group if len(batch))
        else:
            yield from (batch for topic, batch in last.items() if topic != base)
            last.clear()
            at = seen
            for batch in group:
                if batch.channel.topic != base:
                    yield batch
                    continue
                yield _part(batch, max(0, span.start - at), min(len(batch), span.stop - at))
                at += len(batch)
        seen += here


def _part(batch: Batch, start: int, stop: int) -> Batch:
    stop = max(start, stop)
    return replace(
        batch, log_times=batch.log_times[start:stop], starts=batch.starts[start:stop], lengths=batch.lengths[start:stop]
    )
