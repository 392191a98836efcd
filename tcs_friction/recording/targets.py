"""A signal source against a message type: does the field exist, is it a number, where are the joint names."""

from __future__ import annotations

from dataclasses import dataclass

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording.definitions import (
    NAME_LISTS,
    TIMES,
    Channel,
    Types,
    full_name,
    number_paths,
    types_of,
)
from tcs_friction.recording.signals import SignalSource

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Target:
    """Where a source's number is: at `path`, or at the place in that array that `names` gives its joint."""

    path: Path
    names: Path | None = None
    joint: str | None = None


def target(channel: Channel, source: SignalSource, bag: str) -> Target:
    """Resolve a source. Raises InputError naming the nearest fields that exist."""
    types = types_of(channel)
    desc: FieldDesc = (Nodetype.NAME, full_name(channel.msgtype))
    structs: list[tuple[Path, str]] = []
    path: Path = ()
    for step in source.steps:
        if isinstance(step, int):
            desc = _element(desc, step, source, bag)
        else:
            if desc[0] != Nodetype.NAME or desc[1] in TIMES:
                raise _no_field(channel, source, bag)
            structs.append((path, str(desc[1])))
            fields = dict(types[str(desc[1])])
            if step not in fields:
                raise _no_field(channel, source, bag)
            desc = fields[step]
        path = (*path, step)
    return _leaf(types, desc, path, structs, channel, source, bag)


def stamp_path(channel: Channel) -> Path | None:
    """Where the type has its time stamp: in a header, or at the top; None if nowhere."""
    types = types_of(channel)
    fields = dict(types[full_name(channel.msgtype)])
    if fields.get("stamp") == (Nodetype.NAME, TIMES[0]):
        return ("stamp",)
    header = fields.get("header")
    if header is not None and header[0] == Nodetype.NAME:
        inner = dict(types.get(str(header[1]), ()))
        if inner.get("stamp") == (Nodetype.NAME, TIMES[0]):
            return ("header", "stamp")
    return None


def _leaf(
    types: Types, desc: FieldDesc, path: Path, structs: list[tuple[Path, str]], channel: Channel,
    source: SignalSource, bag: str,
) -> Target:  # fmt: skip
    if desc[0] == Nodetype.BASE:
        if desc[1][0] in ("string", "wstring"):
            raise InputError(bag, f"{source.topic} {source.field} is text", "a number")
        if source.joint is not None:
            raise InputError(bag, f"{source.topic} {source.field} is one number", f"no joint, found {source.joint}")
        return Target(path)
    if desc[0] == Nodetype.NAME:
        raise _no_field(channel, source, bag)
    inner = desc[1][0]
    if inner[0] == Nodetype.NAME or inner[1][0] in ("string", "wstring"):
        raise _no_field(channel, source, bag)
    if source.joint is None:
        if desc[0] == Nodetype.ARRAY and desc[1][1] == 1:
            return Target((*path, 0))
        raise InputError(bag, f"{source.topic} {source.field} is an array", f"a joint, or an index as in {source.field}[0]")
    for prefix, name in reversed(structs):
        fields = dict(types[name])
        for candidate in NAME_LISTS:
            if candidate in fields and _is_text_list(fields[candidate]):
                return Target(path, (*prefix, candidate), source.joint)
    expected = f"an index as in {source.field}[0] instead of joint"
    raise InputError(bag, f"{channel.msgtype} on {source.topic} has no list of joint names", expected)


def _element(desc: FieldDesc, index: int, source: SignalSource, bag: str) -> FieldDesc:
    if desc[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        raise InputError(bag, f"{source.topic} {source.field}: [{index}] on something that is no array", "no index there")
    if desc[0] == Nodetype.ARRAY and index >= desc[1][1]:
        raise InputError(bag, f"{source.topic} {source.field}: index {index}", f"less than {desc[1][1]}")
    return desc[1][0]


def _no_field(channel: Channel, source: SignalSource, bag: str) -> InputError:
    known = number_paths(types_of(channel), channel.msgtype)
    return InputError(
        bag, f"no number {source.field} in {source.topic} ({channel.msgtype})", nearest(source.field, known)
    )


def _is_text_list(desc: FieldDesc) -> bool:
    return desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) and desc[1][0] == (Nodetype.BASE, ("string", 0))
