"""The messages of a bag one by one in the order of their log times, for playing."""

from __future__ import annotations

import functools
import struct
from collections.abc import Collection, Iterator

import numpy as np
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tcs_friction.errors import InputError
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.decode import Batch
from tcs_friction.recording.definitions import Channel, full_name, standard_types, types_of

LOOK_AHEAD = 2_000_000_000
"""ns; messages that lie further from their place in the file than this come late."""

Message = tuple[int, Channel, bytes]


def in_log_order(bag: Bag, topics: Collection[str] | None = None, begin: int = 0) -> Iterator[Message]:
    """Log time in ns, channel and bytes of each message, sorted within a sliding window; none before `begin`."""
    waiting: list[Batch] = []
    newest = 0
    for batch in bag.batches(topics):
        if not len(batch):
            continue
        if waiting and batch.piece is not waiting[-1].piece:  # every topic of the piece before has come
            ready, waiting = _divided(waiting, newest - LOOK_AHEAD)
            yield from _sorted(ready, begin)
        waiting.append(batch)
        newest = max(newest, int(batch.log_times.max()))
    yield from _sorted(waiting, begin)


def _divided(batches: list[Batch], limit: int) -> tuple[list[Batch], list[Batch]]:
    """The part of each batch before the limit, and the part from it on."""
    before, after = [], []
    for batch in batches:
        early = batch.log_times < limit
        if early.any():
            before.append(_part(batch, early))
        if not early.all():
            after.append(_part(batch, ~early))
    return before, after


def _part(batch: Batch, chosen: np.ndarray) -> Batch:
    times, starts, lengths = batch.log_times[chosen], batch.starts[chosen], batch.lengths[chosen]
    return Batch(batch.channel, batch.buffer, times, starts, lengths, batch.unpacked_from)


def _sorted(batches: list[Batch], begin: int) -> Iterator[Message]:
    if not batches:
        return
    times = np.concatenate([batch.log_times for batch in batches])
    owners = np.repeat(np.arange(len(batches)), [len(batch) for batch in batches])
    places = np.concatenate([np.arange(len(batch)) for batch in batches])
    order = np.argsort(times, kind="stable")
    order = order[times[order] >= begin]
    for time, owner, place in zip(times[order].tolist(), owners[order].tolist(), places[order].tolist(), strict=True):
        batch = batches[owner]
        yield time, batch.channel, batch.payload(place)


def as_cdr(channel: Channel, payload: bytes) -> bytes | None:
    """A message as ROS 2 serialises it; None if it is of ROS 1 and does not fit its type."""
    if channel.encoding == "cdr":
        return payload
    try:
        return bytes(_converter(channel).ros1_to_cdr(payload, full_name(channel.msgtype)))
    except (SerdeError, InputError, ValueError, TypeError, IndexError, struct.error, MemoryError):  # whatever a bag holds
        return None


@functools.cache
def _converter(channel: Channel) -> Typestore:
    """The standard ROS 2 types, and what else the channel's type is made of."""
    standard = standard_types().fielddefs
    store = get_typestore(Stores.EMPTY)
    store.register(standard)
    own: Typesdict = {name: ([], list(fields)) for name, fields in types_of(channel).items() if name not in standard}
    store.register(own)
    return store


def first_time(bag: Bag, topics: Collection[str] | None = None) -> int:
    """Log time of the first message in the order of the file, ns; 0 if there is none."""
    for batch in bag.batches(topics):
        if len(batch):
            return int(batch.log_times.min())
    return 0
