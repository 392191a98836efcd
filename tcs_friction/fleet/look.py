"""The first look at a recording: the hash of its content, the axes that it may be of, when it began, how long it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.fleet.axes import FleetAxis
from tcs_friction.fleet.opening import at_hand, opened, reason_of
from tcs_friction.fleet.sources import Found
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.decode import Batch, Decoder
from tcs_friction.recording.mcap_index import IndexedBag

HEAD = 2000
"""Messages of a topic that are looked at for a joint: several nodes may publish on one topic in turn."""


@dataclass(frozen=True)
class Look:
    """What was seen.

    axes: names of those that fit. starts: of each, ns since 1970, 0 if unknown. samples: of its position's topic. reason: why it
    cannot be worked on, "" if it can. table: it holds one axis and does not say which.
    """

    name: str
    key: str
    axes_key: str
    input_hash: str
    axes: tuple[str, ...] = ()
    starts: tuple[int, ...] = ()
    samples: tuple[int, ...] = ()
    table: bool = False
    reason: str = ""


def look_at(found: Found, axes: Sequence[FleetAxis], axes_key: str, known_hash: str = "") -> Look:
    """Look at one recording; what is wrong with it is said in `reason`. known_hash: where its content was hashed before."""
    look = Look(found.name, found.look, axes_key, known_hash)
    try:
        look = replace(look, input_hash=known_hash or found.hash())
        return _table(look, found, axes) if found.table else _bag(look, found, axes)
    except Exception as error:  # whatever a file does to a reader: it is a row
        content = look.input_hash or f"unread-{look.key[:32]}"
        return replace(look, input_hash=content, reason=reason_of(error, found))


def _table(look: Look, found: Found, axes: Sequence[FleetAxis]) -> Look:
    with at_hand(found) as path:
        likely = next((axis for axis in axes if axis.fits(found.name, (), axis.since)), axes[0])
        recording = likely.table(path)
    fitting = tuple(axis.name for axis in axes if axis.fits(found.name, (), recording.start))
    reason = "" if fitting else "no axis fits its path and time"
    count = len(fitting)
    starts, samples = (recording.start,) * count, (len(recording),) * count
    return replace(look, axes=fitting, starts=starts, samples=samples, table=True, reason=reason)


def _bag(look: Look, found: Found, axes: Sequence[FleetAxis]) -> Look:
    wanted = {source.topic for axis in axes for source in (axis.signals.position, axis.signals.torque)}
    with opened(found, by_index=True) as bag:
        heads, counts = _heads(bag, wanted)
        topics = {channel.topic for channel in bag.channels}
        begun = {axis.name: _begin(bag, heads, axis, found.name) for axis in axes}
    fitting = [axis for axis in axes if (start := begun[axis.name]) is not None and axis.fits(found.name, topics, start)]
    if not fitting:
        carried = any(start is not None for start in begun.values())
        why = "one has its signals, but another path, topic or time" if carried else f"its topics are {', '.join(sorted(topics))}"
        return replace(look, reason=f"no axis fits{'' if carried else bag.lament()}: {why}")
    starts = tuple(begun[axis.name] or 0 for axis in fitting)
    samples = tuple(counts[axis.signals.position.topic] for axis in fitting)
    return replace(look, axes=tuple(axis.name for axis in fitting), starts=starts, samples=samples)


def _heads(bag: Bag | IndexedBag, wanted: set[str]) -> tuple[dict[str, Batch], dict[str, int]]:
    """The first messages of each wanted topic, and how many there are."""
    if isinstance(bag, IndexedBag):
        present = [topic for topic in sorted(wanted) if bag.count(topic)]
        firsts = {topic: next((batch for batch in bag.batches([topic]) if len(batch)), None) for topic in present}
        heads = {topic: _head(batch) for topic, batch in firsts.items() if batch is not None}
        return heads, {topic: bag.count(topic) for topic in present}
    heads = {}
    counts: dict[str, int] = {}
    for batch in bag.batches(wanted):
        topic = batch.channel.topic
        if len(batch):
            counts[topic] = counts.get(topic, 0) + len(batch)
            if topic not in heads:
                heads[topic] = _head(batch)
    return heads, counts


def _head(batch: Batch) -> Batch:
    first, last = slice(0, HEAD), min(HEAD, len(batch)) - 1
    low, high = int(batch.starts[first].min()), int(batch.starts[last] + batch.lengths[last])
    starts = batch.starts[first] - low
    buffer = batch.buffer[low : max(high, int((batch.starts[first] + batch.lengths[first]).max()))].copy()
    return replace(batch, buffer=buffer, log_times=batch.log_times[first], starts=starts, lengths=batch.lengths[first])


def _begin(bag: Bag | IndexedBag, heads: dict[str, Batch], axis: FleetAxis, name: str) -> int | None:
    """When the axis' own messages begin, ns since 1970; None where the recording has not its position and torque."""
    begun = None
    for source in (axis.signals.torque, axis.signals.position):
        head = heads.get(source.topic)
        if head is None:
            return None
        try:
            decoder = Decoder(head.channel, [source], name, bag.allowance)
            _, absent, stamps, good = decoder.decode(head)
        except InputError:  # its type has no such field
            return None
        rows = np.flatnonzero(good & ~absent[0])
        if not len(rows):
            return None
        times = stamps if stamps is not None and int(stamps[rows[0]]) > 0 else head.log_times
        begun = int(times[rows[0]])
    return begun
