"""A `signals:` block for a bag that nobody has described yet: likely topics and fields, by their types and names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tcs_friction.errors import InputError
from tcs_friction.recording.definitions import Channel, full_name, number_paths, types_of
from tcs_friction.recording.layout import MalformedError, layout
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.targets import target

LIKELY = {
    "position": ("position", "pos", "angle", "positions"),
    "velocity": ("velocity", "vel", "speed", "velocities"),
    "torque": ("effort", "torque", "efforts", "force", "current"),
}
"""Last words of fields that hold a signal, the likeliest first."""

WANTED = ("reference", "setpoint", "desired", "target", "command")
"""Words in topics or fields that say where the axis should be, not where it is."""


def proposed_signals(first: Mapping[Channel, bytes]) -> dict[str, Any]:
    """A `signals:` block (as SignalMap.from_mapping takes it) from one message a channel; {} if nothing looks like an axis."""
    channels = dict(sorted(first.items(), key=lambda item: item[0].topic))
    block: dict[str, Any] = {}
    others: dict[str, Any] = {}
    for channel, raw in channels.items():
        joints = joint_names(channel, raw)
        if joints and "position" not in block and not _wanted(channel.topic):
            block, others = _of_joints(channel, raw, joints)
    for channel, raw in channels.items():
        if not joint_names(channel, raw):
            _of_numbers(channel, block, others)
    if "position" not in block:
        return {}
    if others:
        block["exogenous"] = others
    return block


def joint_names(channel: Channel, raw: bytes) -> list[str]:
    """The joints that a message of several names, [] if it is not of that kind."""
    known = _with_joints(channel)
    return list(dict.fromkeys(_names(channel, raw, next(iter(known.values()))))) if known else []


def _with_joints(channel: Channel) -> dict[str, str]:
    """Signals that a type has as arrays beside joint names: signal -> field."""
    found: dict[str, str] = {}
    for name, path in _likely_paths(channel):
        try:
            target(channel, SignalSource(channel.topic, path, "any"), channel.topic)
        except InputError:
            continue
        found.setdefault(name, path)
    return found


def _names(channel: Channel, raw: bytes, path: str) -> tuple[str, ...]:
    where = target(channel, SignalSource(channel.topic, path, ""), channel.topic)
    try:
        return layout(
            raw, types_of(channel), full_name(channel.msgtype), channel.encoding == "ros1", [where], None
        ).names
    except MalformedError:
        return ()


def _of_joints(channel: Channel, raw: bytes, joints: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The first joint's signals, and the other joints' velocities as what might push on it."""
    block, others = {}, {}
    for name, path in _with_joints(channel).items():
        if _filled(channel, raw, path, joints[0]):
            block[name] = {"topic": channel.topic, "field": path, "joint": joints[0]}
        if name == "velocity":
            for joint in joints[1:]:
                if _filled(channel, raw, path, joint):
                    others[f"{joint}_velocity"] = {"topic": channel.topic, "field": path, "joint": joint}
    return block, others


def _filled(channel: Channel, raw: bytes, path: str, joint: str) -> bool:
    where = target(channel, SignalSource(channel.topic, path, joint), channel.topic)
    try:
        ros1 = channel.encoding == "ros1"
        return layout(raw, types_of(channel), full_name(channel.msgtype), ros1, [where], None).columns[0] is not None
    except MalformedError:
        return False


def _of_numbers(channel: Channel, block: dict[str, Any], others: dict[str, Any]) -> None:
    """Add what a topic without joints may be: temperature, reference, wind, or an axis of its own."""
    if channel.msgtype.endswith("/Temperature"):
        block.setdefault("temperature", {"topic": channel.topic, "field": "temperature"})
        return
    if "wind" in channel.topic.lower():
        path = next((path for path in _paths(channel) if path.endswith((".x", "data", "speed"))), None)
        if path is not None:
            others.setdefault("wind_speed", {"topic": channel.topic, "field": path})
        return
    for name, path in _likely_paths(channel):
        source = SignalSource(channel.topic, path)
        try:
            target(channel, source, channel.topic)
        except InputError:
            continue
        if _wanted(channel.topic + path) or channel.msgtype.endswith("/AxisReference"):
            if name == "position":
                block.setdefault("reference", {"topic": channel.topic, "field": path})
        else:
            block.setdefault(name, {"topic": channel.topic, "field": path})


def _likely_paths(channel: Channel) -> Iterator[tuple[str, str]]:
    """Signals and the fields that may hold them, the likeliest first; `data` goes by the topic's name."""
    paths = _paths(channel)
    for name, words in LIKELY.items():
        for word in words:
            for path in paths:
                last = path.rpartition(".")[2].lower()
                if last == word or (last == "data" and channel.topic.lower().rpartition("/")[2].endswith(word)):
                    yield name, path


def _paths(channel: Channel) -> list[str]:
    try:
        return number_paths(types_of(channel), channel.msgtype)
    except InputError:
        return []


def _wanted(text: str) -> bool:
    return any(word in text.lower() for word in WANTED)
