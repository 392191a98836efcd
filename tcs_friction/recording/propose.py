"""A `signals:` block for a bag that nobody has described yet: likely topics and fields, by their types and names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tcs_friction.errors import InputError
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.definitions import Channel, full_name, number_paths, types_of
from tcs_friction.recording.layout import Layout, MalformedError, layout
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.table_names import said
from tcs_friction.recording.targets import target
from tcs_friction.recording.units import is_unit

LIKELY = {
    "position": ("position", "pos", "angle", "positions"),
    "velocity": ("velocity", "vel", "speed", "velocities"),
    "torque": ("effort", "torque", "efforts", "force", "current"),
}
"""Last words of fields that hold a signal, the likeliest first."""

MAX_JOINTS = 200
"""Joints of one message that are proposed; a humanoid has 60."""

STEPS_PATH = 80
"""Steps (see Allowance) of judging one field of a type."""

WANTED = ("reference", "setpoint", "desired", "target", "command")
"""Words in topics or fields that say where the axis should be, not where it is."""


@dataclass(frozen=True)
class Proposal:
    """signals: a `signals:` block (as SignalMap.from_mapping takes it), {} if nothing looks like an axis.

    joints: those that its position may be of. wrenches: what force and torque sensors say, any of which may be the torque.
    """

    signals: dict[str, Any]
    joints: tuple[str, ...] = ()
    wrenches: tuple[SignalSource, ...] = ()


def proposed_signals(first: Mapping[Channel, bytes], allowance: Allowance) -> Proposal:
    """What one message a channel looks like.

    Raises InputError when the types take more work than the allowance has left.
    """
    sight = [_Sight(channel, first[channel], allowance) for channel in sorted(first, key=lambda item: item.topic)]
    sight = [seen for seen in sight if not _is_plan(seen.channel)]
    block: dict[str, Any] = {}
    others: dict[str, Any] = {}
    joints: list[str] = []
    for seen in sight:
        if seen.joints and "position" not in block and not _wanted(seen.channel.topic):
            block, others = _of_joints(seen)
            joints = seen.joints
    for seen in sight:
        if not seen.joints:
            _of_numbers(seen, block, others)
    if "position" not in block:
        return Proposal({})
    if others:
        block["exogenous"] = others
    return Proposal(block, tuple(joints), tuple(_of_wrenches(sight)))


class _Sight:
    """A channel and one of its messages: which fields may hold signals, and which joints it names."""

    def __init__(self, channel: Channel, raw: bytes, allowance: Allowance) -> None:
        self.channel = channel
        self.raw = raw
        self.allowance = allowance
        self.paths = number_paths(types_of(channel), channel.msgtype)
        allowance.spend(STEPS_PATH * len(self.paths))
        self.likely = tuple(_likely_paths(channel, self.paths))
        self.arrays = self._with_joints()
        found = self.walked(next(iter(self.arrays.values())), [""]) if self.arrays else None
        self.joints = list(dict.fromkeys(found.names))[:MAX_JOINTS] if found is not None else []

    def walked(self, path: str, joints: Sequence[str]) -> Layout | None:
        """Where the message has the number of each joint; None if it does not fit its type."""
        topic, ros1 = self.channel.topic, self.channel.encoding == "ros1"
        targets = [target(self.channel, SignalSource(topic, path, joint), topic) for joint in joints]
        try:
            types, name = types_of(self.channel), full_name(self.channel.msgtype)
            return layout(self.raw, types, name, ros1, targets, None, self.allowance)
        except MalformedError:
            return None

    def _with_joints(self) -> dict[str, str]:
        """Signals that the type has as arrays beside joint names: signal -> field."""
        found: dict[str, str] = {}
        for name, path in self.likely:
            with suppress(InputError):
                if name not in found:
                    target(self.channel, SignalSource(self.channel.topic, path, "any"), self.channel.topic)
                    found[name] = path
        return found


def _of_joints(seen: _Sight) -> tuple[dict[str, Any], dict[str, Any]]:
    """The first joint's signals, and the other joints' positions and velocities as what might push on it."""
    block, others = {}, {}
    topic = seen.channel.topic
    for name, path in seen.arrays.items():
        found = seen.walked(path, seen.joints)
        filled = [joint for joint, column in zip(seen.joints, found.columns, strict=True) if column] if found else []
        for joint in filled:
            entry = _entry(topic, path, name, joint)
            if joint == seen.joints[0]:
                block[name] = entry
            elif name in ("position", "velocity"):
                others[f"{joint}_{name}"] = entry
    return block, others


def _of_numbers(seen: _Sight, block: dict[str, Any], others: dict[str, Any]) -> None:
    """Add what a topic without joints may be: temperature, reference, wind, or an axis of its own."""
    channel = seen.channel
    if channel.msgtype.endswith("/Temperature"):
        block.setdefault("temperature", {"topic": channel.topic, "field": "temperature"})
        return
    if "wind" in channel.topic.lower():
        path = next((path for path in seen.paths if path.endswith((".x", "data", "speed"))), None)
        if path is not None:
            others.setdefault("wind_speed", {"topic": channel.topic, "field": path})
        return
    for name, path in seen.likely:
        source = SignalSource(channel.topic, path)
        try:
            target(channel, source, channel.topic)
        except InputError:
            if not seen.arrays or path not in seen.arrays.values():
                continue
            path += "[0]"  # joints without names: the first element of each array
        if _wanted(channel.topic + path) or channel.msgtype.endswith("/AxisReference"):
            if name == "position":
                block.setdefault("reference", _entry(channel.topic, path, name))
        else:
            block.setdefault(name, _entry(channel.topic, path, name))


def _of_wrenches(sight: Sequence[_Sight]) -> Iterator[SignalSource]:
    """What a force and torque sensor says: torques first, and of those, as of forces, z first: that is where axes point."""
    for part in ("torque", "force"):
        for component in "zyx":
            for seen in sight:
                path = next((path for path in seen.paths if path.endswith(f"{part}.{component}")), None)
                if path is not None and "wrench" in (seen.channel.msgtype + path).lower():
                    yield SignalSource(seen.channel.topic, path)


def _is_plan(channel: Channel) -> bool:
    """Whether messages say where an axis is to go, not where it was: trajectories have joints and positions as well."""
    return "trajectory" in channel.msgtype.rpartition("/")[2].lower() and not channel.msgtype.endswith("State")


def _likely_paths(channel: Channel, paths: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Signals and the fields that may hold them, the likeliest first; `data` goes by the topic's name.

    Behind those that are called as ROS calls them come those whose names say a signal among other words: `az_act_deg`.
    """
    for name, words in LIKELY.items():
        for word in words:
            for path in paths:
                last = path.rpartition(".")[2].lower()
                if last == word or (last == "data" and channel.topic.lower().rpartition("/")[2].endswith(word)):
                    yield name, path
    for path in paths:
        told = said(_name_of(channel.topic, path))
        if told.signal in LIKELY:
            yield told.signal, path


def _name_of(topic: str, path: str) -> str:
    """What a number is called: by its field or, where that is `data`, by its topic."""
    last = path.partition("[")[0].rpartition(".")[2]
    return topic.rpartition("/")[2] if last.lower() == "data" else last


def _entry(topic: str, path: str, signal: str, joint: str | None = None) -> dict[str, Any]:
    """An entry of a `signals:` block, with the unit that a name says."""
    unit = said(_name_of(topic, path)).unit
    entry = {"topic": topic, "field": path} | ({"joint": joint} if joint is not None else {})
    return entry | ({"unit": unit} if unit and is_unit(unit, signal) else {})


def _wanted(text: str) -> bool:
    return any(word in text.lower() for word in WANTED)
