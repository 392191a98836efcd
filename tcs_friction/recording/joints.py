"""The joints of a bag: by name where its messages name them, else by number."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from tcs_friction.errors import nearest
from tcs_friction.recording.choice import joint_number, no_joint
from tcs_friction.recording.decode import Batch, Decoder
from tcs_friction.recording.definitions import full_name, types_of
from tcs_friction.recording.layout import MalformedError, layout
from tcs_friction.recording.propose import MAX_JOINTS
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.targets import target

if TYPE_CHECKING:
    from tcs_friction.recording.bags import Bag

_ELEMENT = re.compile(r"(.*)\[(\d+)\]")


def joints_of(bag: Bag, signals: SignalMap) -> tuple[str, ...]:
    """The joints of the position's topic in their order; of an array without names the numbers of its elements.

    () where the position is of one joint that nobody names, and where there is no message.
    """
    source = signals.position
    batch = next((batch for batch in bag.batches([source.topic]) if len(batch)), None)
    if batch is None:
        return ()
    found = _ELEMENT.fullmatch(source.field)
    if found is not None:
        return tuple(map(str, range(_elements(batch, source, found[1], bag))))
    if source.joint is None:
        return ()
    decoder = Decoder(batch.channel, [source], str(bag.path), bag.allowance)
    decoder.decode(batch)
    return tuple(decoder.names)


def _elements(batch: Batch, source: SignalSource, array: str, bag: Bag) -> int:
    """How long an array is in the first message."""
    channel, where = batch.channel, str(bag.path)
    targets = [target(channel, replace(source, field=f"{array}[{number}]"), where) for number in range(MAX_JOINTS)]
    types, name = types_of(channel), full_name(channel.msgtype)
    try:
        found = layout(batch.payload(0), types, name, channel.encoding == "ros1", targets, None, bag.allowance)
    except MalformedError:
        return 0
    return sum(column is not None for column in found.columns)


def signals_of(bag: Bag, signals: SignalMap, asked: str) -> SignalMap:
    """The signals of another joint of a bag, by its name or by its number from 0 on.

    Raises InputError naming the joints there are.
    """
    found = _ELEMENT.fullmatch(signals.position.field)
    number = joint_number(asked)
    if signals.position.joint is not None and number is None:
        return signals.of_joint(asked)  # whether there is one shows when all messages are read
    names = joints_of(bag, signals)
    if asked in names or (number is not None and number < len(names)):
        name = asked if number is None or asked in names else names[number]
        return signals.of_joint(name) if found is None else _of_element(signals, found[2], name)
    if not names:
        raise no_joint(asked, f"none, since {signals.position.topic} names no joints")
    expected = f"0 to {len(names) - 1}" if found is not None else f"0 to {len(names) - 1} or a name"
    raise no_joint(asked, nearest(asked, names) if number is None else expected)


def _of_element(signals: SignalMap, old: str, number: str) -> SignalMap:
    """The signals of another element of arrays: those of the axis that have the old number."""
    moved = {
        name: replace(source, field=source.field.removesuffix(f"[{old}]") + f"[{number}]")
        for name in ("position", "velocity", "torque", "reference")
        if (source := getattr(signals, name)) is not None and source.field.endswith(f"[{old}]")
    }
    return replace(signals, **moved)
