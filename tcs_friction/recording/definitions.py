"""Message types: the definition that came in the bag, else the standard type of that name."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tcs_friction.errors import InputError

TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
NAME_LISTS = ("name", "names", "joint_names")
"""What a list of joint names is called beside the arrays it names."""

MAX_DEFINITION = 1 << 16
"""Characters of a type's definition with all that it is made of; the largest of ROS 2's own have 4000."""

MAX_FIELDS = 10_000
MAX_DEPTH = 64
"""Fields of a type with those of its parts, and levels of parts; types of robots have some hundreds and seven."""

MAX_PATHS = 400
"""Field paths listed of one type; more would only make an error message slower."""

_EMPTY_LINES = re.compile(r"^[ \t]*(#.*)?\n", re.MULTILINE)
"""Blank lines and comments of a .msg text; the parser's time grows with the square of them."""

_IDL_SEPARATOR = "=" * 80 + "\n"

Fields = tuple[tuple[str, FieldDesc], ...]
Types = Mapping[str, Fields]


@dataclass(frozen=True)
class Channel:
    """A topic as one storage file describes it. encoding: how messages are serialised, `cdr` or `ros1`.

    definition: the text that came with it, "" if none; definition_encoding: ros2msg, ros2idl, ros1msg.
    qos: the offered quality-of-service profiles as the bag has them (YAML text), "" if none.
    """

    topic: str
    msgtype: str
    encoding: str = "cdr"
    definition: str = ""
    definition_encoding: str = "ros2msg"
    qos: str = ""


@functools.cache
def standard_types() -> Typestore:
    """The message types of ROS 2 Jazzy's common interfaces."""
    return get_typestore(Stores.ROS2_JAZZY)


@functools.cache
def _ros1_types() -> Typestore:
    return get_typestore(Stores.ROS1_NOETIC)


def full_name(msgtype: str) -> str:
    """`sensor_msgs/JointState` as ROS 1 says it becomes `sensor_msgs/msg/JointState`."""
    parts = msgtype.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else msgtype


@functools.lru_cache(maxsize=64)
def types_of(channel: Channel) -> Types:
    """Every type that a channel's messages are made of, by name, as (field name, description) pairs.

    Raises InputError when the bag has no (whole) definition of a type and no standard type has its name, or when a
    type holds itself or more fields than any message needs.
    """
    msgtype = full_name(channel.msgtype)
    base = (_ros1_types() if channel.encoding == "ros1" else standard_types()).fielddefs
    own, problem = _own_types(channel.definition, channel.definition_encoding, msgtype)
    if problem and msgtype not in base:
        found = f"the definition of {channel.msgtype} cannot be parsed: {problem}"
        raise InputError(channel.topic, found, "a whole definition in the bag, or a standard ROS 2 type")
    try:
        return _reached(base | own, msgtype, channel.topic)
    except InputError:
        if msgtype not in base:
            raise
        return _reached(base, msgtype, channel.topic)


@functools.lru_cache(maxsize=64)
def _own_types(definition: str, encoding: str, msgtype: str) -> tuple[Typesdict, str]:
    """What a definition says, and why it says nothing."""
    try:
        return (parsed(definition, encoding, msgtype) if definition else {}), ""
    except Exception as error:  # the parser is given whatever a damaged file holds
        return {}, " ".join(str(error).split())[:200]


def _reached(known: Typesdict, msgtype: str, topic: str) -> Types:
    """The types that one is made of, and itself."""
    reached: dict[str, Fields] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop()
        if name in reached or name in TIMES:
            continue
        if name not in known:
            expected = "its definition in the bag, or a standard ROS 2 type"
            raise InputError(topic, f"type {name!r} is unknown", expected)
        reached[name] = tuple(known[name][1])
        waiting.extend(inner for _, desc in known[name][1] if (inner := type_name(desc)) is not None)
    fields, depth = _extent(reached, msgtype, {})
    if fields > MAX_FIELDS or depth > MAX_DEPTH:
        found = f"{msgtype} has more than {MAX_FIELDS} fields, more than {MAX_DEPTH} levels, or holds itself"
        raise InputError(topic, found, "a smaller type")
    return reached


def _extent(types: Types, name: str, known: dict[str, tuple[int, int]], above: int = 0) -> tuple[int, int]:
    """Fields (elements of arrays counted once) and levels of a type; too many levels if it holds itself."""
    if above > MAX_DEPTH:
        return 0, above
    if name not in known:
        inner = [type_name(desc) for _, desc in types.get(name, ())]
        parts = [_extent(types, part, known, above + 1) for part in inner if part is not None]
        known[name] = len(inner) + sum(part[0] for part in parts), 1 + max((part[1] for part in parts), default=0)
    return known[name]


def parsed(definition: str, encoding: str, msgtype: str) -> Typesdict:
    """A definition's text as rosbags type descriptions. Raises ValueError for one that is too long, or what the parser raises."""
    if len(definition) > MAX_DEFINITION:
        raise ValueError(f"it has {len(definition)} characters, at most {MAX_DEFINITION} are read")
    if encoding not in ("ros2idl", "omgidl"):
        return get_types_from_msg(_EMPTY_LINES.sub("", definition), msgtype)
    if not definition.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return get_types_from_idl(definition)
    types: Typesdict = {}
    for part in definition.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.split("\n", 1)[1]))
    return types


def type_name(desc: FieldDesc) -> str | None:
    """The message type that a field is or holds, None for numbers and strings."""
    if desc[0] == Nodetype.NAME:
        return str(desc[1])
    if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        inner = desc[1][0]
        return str(inner[1]) if inner[0] == Nodetype.NAME else None
    return None


def number_paths(types: Types, msgtype: str) -> list[str]:
    """Dotted paths of the numbers and number arrays in a type; arrays of messages as `[0]`."""
    return [path for _, path in zip(range(MAX_PATHS), _paths(types, full_name(msgtype), ""), strict=False)]


def _paths(types: Types, msgtype: str, prefix: str) -> Iterator[str]:
    for name, desc in types.get(msgtype, ()):
        path = prefix + name
        kind, detail = desc
        if kind == Nodetype.BASE:
            if detail[0] not in ("string", "wstring"):
                yield path
        elif kind == Nodetype.NAME:
            if detail not in TIMES:
                yield from _paths(types, str(detail), f"{path}.")
        else:
            inner = detail[0]
            if inner[0] == Nodetype.NAME:
                if inner[1] not in TIMES:
                    yield from _paths(types, str(inner[1]), f"{path}[0].")
            elif inner[1][0] not in ("string", "wstring"):
                yield path
