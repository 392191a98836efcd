"""Columns to raw messages in bulk: one serialised message is the mould, the columns fill its numbers."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tcs_friction.errors import InputError
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.columns import Nanoseconds
from tcs_friction.recording.decode import SECOND
from tcs_friction.recording.definitions import Channel, full_name, types_of
from tcs_friction.recording.layout import layout
from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.targets import stamp_path, target

JOINT_STATE = "sensor_msgs/msg/JointState"

OWN_TYPES = {
    "tcs_friction_msgs/msg/AxisReference": "std_msgs/Header header\nfloat64 position\nfloat64 velocity\nfloat64 acceleration",
    "tcs_friction_msgs/msg/AxisTorque": "std_msgs/Header header\nfloat64 torque",
    "tcs_friction_msgs/msg/FrictionEstimate": "std_msgs/Header header\nfloat64 torque\nfloat64 velocity\n"
    "float64 residual\nbool valid",
}
"""The fields of this project's messages that recordings hold; msg_defs has them with their comments."""

SIMPLE_TYPES = (
    *OWN_TYPES, "sensor_msgs/msg/Temperature", "geometry_msgs/msg/Vector3Stamped", "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/AccelStamped",
    "sensor_msgs/msg/Imu", "std_msgs/msg/Float64",
)  # fmt: skip
"""Types tried, in this order, for signals that are not of a joint: the first that has all the fields is taken."""


@dataclass(frozen=True, eq=False)
class TopicData:
    """Messages of one topic to write. times: (n,) ns log times; messages: (n, size) bytes, all of one layout."""

    channel: Channel
    times: Nanoseconds
    messages: NDArray[np.uint8]


@functools.cache
def typestore() -> Typestore:
    """The standard types and this project's own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in OWN_TYPES.items():
        store.register(get_types_from_msg(text, name))
    return store


@functools.cache
def known_definition(msgtype: str) -> str:
    """The full definition of a type known here, "" of any other."""
    if msgtype not in typestore().fielddefs:
        return ""
    return typestore().generate_msgdef(msgtype, ros_version=2)[0]


def channel_of(topic: str, msgtype: str) -> Channel:
    """A channel with the full definition of a type known here."""
    return Channel(topic, msgtype, "cdr", known_definition(msgtype))


def encoded(topic: str, msgtype: str, times: Nanoseconds, columns: Mapping[str, Column], qos: str = "") -> TopicData:
    """A topic of a type with single numbers: field path -> (n,); other fields are zero, the stamps are `times`."""
    mould = typestore().serialize_cdr(empty(msgtype), msgtype)
    sources = {SignalSource(topic, path): values for path, values in columns.items()}
    return _filled(topic, msgtype, times, sources, bytes(mould), qos)


def joint_states(
    topic: str, times: Nanoseconds, joints: Mapping[str, Mapping[str, Column]], qos: str = ""
) -> TopicData:
    """A JointState topic: joint -> field (position, velocity, effort) -> (n,).

    A field that no joint has is left empty; where only some have it, the others get NaN.
    """
    message = empty(JOINT_STATE)
    message.name = list(joints)
    sources: dict[SignalSource, Column] = {}
    for kind in ("position", "velocity", "effort"):
        if not any(kind in columns for columns in joints.values()):
            continue
        setattr(message, kind, np.full(len(joints), np.nan))
        for joint, columns in joints.items():
            if kind in columns:
                sources[SignalSource(topic, kind, joint)] = columns[kind]
    mould = typestore().serialize_cdr(message, JOINT_STATE)
    return _filled(topic, JOINT_STATE, times, sources, bytes(mould), qos)


def _filled(
    topic: str, msgtype: str, times: Nanoseconds, sources: Mapping[SignalSource, Column], mould: bytes, qos: str
) -> TopicData:
    channel = replace(channel_of(topic, msgtype), qos=qos)
    targets = [target(channel, source, topic) for source in sources]
    stamp = stamp_path(channel)
    known = layout(mould, types_of(channel), full_name(msgtype), False, targets, stamp, Allowance(topic, len(mould)))
    messages = np.tile(np.frombuffer(mould, np.uint8), (len(times), 1))
    for place, values in zip(known.columns, sources.values(), strict=True):
        assert place is not None  # the mould was made with every source in it
        offset, code = place
        messages[:, offset : offset + int(code[2])] = _bytes(values, code)
    if known.stamp is not None:
        messages[:, known.stamp : known.stamp + 4] = _bytes(times // SECOND, "<i4")
        messages[:, known.stamp + 4 : known.stamp + 8] = _bytes(times % SECOND, "<u4")
    return TopicData(channel, np.asarray(times, dtype=np.int64), messages)


def _bytes(values: NDArray[Any], code: str) -> NDArray[np.uint8]:
    return np.ascontiguousarray(values).astype(code).view(np.uint8).reshape(len(values), int(code[2]))


def simple_type(topic: str, sources: Sequence[SignalSource]) -> str:
    """The first of SIMPLE_TYPES with all the fields. Raises InputError if none has."""
    for msgtype in SIMPLE_TYPES:
        try:
            for source in sources:
                target(channel_of(topic, msgtype), source, topic)
        except InputError:
            continue
        return msgtype
    fields = ", ".join(source.field for source in sources)
    known = ", ".join(name.rpartition("/")[2] for name in SIMPLE_TYPES)
    raise InputError(topic, f"no message type to write {fields}", f"fields of JointState or one of {known}")


def empty(msgtype: str) -> Any:
    """A message with zeros, empty strings and empty lists."""
    store = typestore()
    _, fields = store.fielddefs[msgtype]
    return store.types[msgtype](**{name: _empty(desc) for name, desc in fields})


def _empty(desc: FieldDesc) -> Any:
    if desc[0] == Nodetype.NAME:
        return empty(desc[1])
    if desc[0] == Nodetype.BASE:
        return "" if desc[1][0] in ("string", "wstring") else 0
    inner, bound = desc[1]
    count = bound if desc[0] == Nodetype.ARRAY else 0
    if inner[0] == Nodetype.BASE and inner[1][0] not in ("string", "wstring"):
        return np.zeros(count, dtype=inner[1][0])
    return [_empty(inner) for _ in range(count)]
