"""Where the signals are in a bag: the `signals:` block of an axis file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording.units import Conversion, conversion_of, torque_base, units_of

REQUIRED = ("position", "torque")
OPTIONAL = ("velocity", "temperature", "reference")
SOURCE_KEYS = ("topic", "field", "joint", "scale", "unit")
FROM_STAMP, UP_TO_STAMP, UNKNOWN = "from_stamp", "up_to_stamp", "unknown"
ACTS = (FROM_STAMP, UP_TO_STAMP, UNKNOWN)
"""When a logged torque acts: from its stamp to the next, from the stamp before to its own, or nobody knows."""

T = TypeVar("T", float, np.ndarray)
_STEP = re.compile(r"([A-Za-z_]\w*)((?:\[\d+\])*)")


@dataclass(frozen=True)
class SignalSource:
    """One signal: a topic, a dotted path to a number in its messages, and how that becomes SI units.

    `field` may index arrays (`points[0].positions[2]`); `joint` picks the element of the last array by the name
    list beside it (`name`, `names` or `joint_names`), wherever the joint stands in each message.
    scale: factor, beside that of the unit. unit: of the number (see recording.units), "" for SI. rated: torque (N m) of which a
    torque in per cent is a share, 0 where nobody knows it. acts: of a torque, when it does, one of ACTS, or s after its stamp at
    which it begins to (negative: before).
    """

    topic: str
    field: str
    joint: str | None = None
    scale: float = 1.0
    unit: str = ""
    rated: float = 0.0
    acts: str | float = UNKNOWN

    @cached_property
    def conversion(self) -> Conversion:
        """Factor and offset: the one place where scale and unit act, of bags, tables and live topics alike."""
        factor, offset = conversion_of(self.unit, self.rated)
        return self.scale * factor, self.scale * offset

    def si(self, values: T) -> T:
        """What is recorded, a number or a column, in SI units."""
        factor, offset = self.conversion
        values = values if factor == 1.0 else values * factor
        return values + offset if offset else values

    def recorded(self, values: T) -> T:
        """The other way round: SI units as they are to be recorded."""
        factor, offset = self.conversion
        return values if (factor, offset) == (1.0, 0.0) else (values - offset) / factor

    def acts_after(self, period: float) -> float | None:
        """s after its stamp at which a logged value begins to act, of values `period` s apart; None: not known."""
        return {FROM_STAMP: 0.0, UP_TO_STAMP: -period, UNKNOWN: None}[self.acts] if isinstance(self.acts, str) else self.acts

    @property
    def steps(self) -> tuple[str | int, ...]:
        """The path as names and indices: `a.b[3]` is ("a", "b", 3)."""
        steps: list[str | int] = []
        for part in self.field.split("."):
            match = _STEP.fullmatch(part)
            if match is None:
                raise InputError(f"field {self.field!r}", f"{part!r} is no field name", "a dotted path like pose.x or data[0]")
            steps.append(match[1])
            steps.extend(int(index) for index in re.findall(r"\d+", match[2]))
        return tuple(steps)

    def __str__(self) -> str:
        joint = f" of {self.joint}" if self.joint is not None else ""
        return f"{self.topic} {self.field}{joint}"


@dataclass(frozen=True)
class SignalMap:
    """Which recorded signal plays which part. Position and torque are needed, the rest is optional."""

    position: SignalSource
    torque: SignalSource
    velocity: SignalSource | None = None
    temperature: SignalSource | None = None
    reference: SignalSource | None = None
    exogenous: Mapping[str, SignalSource] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "exogenous", MappingProxyType(dict(self.exogenous)))

    def __reduce__(self) -> tuple[Any, ...]:
        return (
            SignalMap,
            (self.position, self.torque, self.velocity, self.temperature, self.reference, dict(self.exogenous)),
        )

    def named(self) -> Iterator[tuple[str, SignalSource]]:
        """Every signal there is with its name, position first."""
        for name in (*REQUIRED, *OPTIONAL):
            source = getattr(self, name)
            if source is not None:
                yield name, source
        yield from self.exogenous.items()

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics needed, each once, the position's first."""
        return tuple(dict.fromkeys(source.topic for _, source in self.named()))

    @property
    def torque_unit(self) -> str:
        """Of a drive whose torque is known up to a constant: A, V or %; "" where the torque is one."""
        return torque_base(self.torque.unit, self.torque.rated)

    def of_joint(self, joint: str) -> SignalMap:
        """The signals of another joint of the same messages."""
        own = self.position.joint
        moved = {
            name: replace(source, joint=joint)
            for name in ("position", "velocity", "torque")
            if (source := getattr(self, name)) is not None and (source.joint == own or name == "position")
        }
        return replace(self, **moved)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], where: str) -> SignalMap:
        """Build from the `signals:` block as YAML gives it; `where` names the file in errors."""
        block = _mapping(mapping, f"{where}: signals")
        known = (*REQUIRED, *OPTIONAL, "exogenous")
        _refuse_unknown(block, known, f"{where}: signals")
        for name in REQUIRED:
            if block.get(name) is None:
                raise InputError(f"{where}: signals", f"{name} is missing", "at least position and torque")
        sources = {
            name: _source(block[name], f"{where}: signals.{name}", name)
            for name in (*REQUIRED, *OPTIONAL)
            if block.get(name) is not None
        }
        others = _mapping(block.get("exogenous") or {}, f"{where}: signals.exogenous")
        exogenous = {str(name): _source(entry, f"{where}: signals.exogenous.{name}") for name, entry in others.items()}
        for name in exogenous:
            if name in known:
                raise InputError(f"{where}: signals.exogenous", f"{name} is a signal of the axis", "another name")
        return cls(exogenous=exogenous, **sources)

    def to_mapping(self) -> dict[str, Any]:
        """The `signals:` block that `from_mapping` reads back to an equal map."""
        block: dict[str, Any] = {
            name: _entry(getattr(self, name)) for name in (*REQUIRED, *OPTIONAL) if getattr(self, name) is not None
        }
        if self.exogenous:
            block["exogenous"] = {name: _entry(source) for name, source in self.exogenous.items()}
        return block


def _entry(source: SignalSource) -> dict[str, Any]:
    entry: dict[str, Any] = {"topic": source.topic, "field": source.field}
    if source.joint is not None:
        entry["joint"] = source.joint
    if source.scale != 1.0:
        entry["scale"] = source.scale
    if source.unit:
        entry["unit"] = source.unit
    if source.acts != UNKNOWN:
        entry["acts"] = source.acts
    return entry


def _source(entry: Any, where: str, signal: str = "") -> SignalSource:
    """signal: "" for one that is none of the axis, whose unit is nobody's business."""
    block = _mapping(entry, where)
    _refuse_unknown(block, (*SOURCE_KEYS, "acts") if signal == "torque" else SOURCE_KEYS, where)
    for key in ("topic", "field"):
        if not isinstance(block.get(key), str) or not block[key]:
            raise InputError(where, f"{key} is {block.get(key)!r}", "a name")
    joint = block.get("joint")
    if joint is not None and not isinstance(joint, str):
        raise InputError(where, f"joint is {joint!r}", "a name (quote it if it is a number)")
    scale = block.get("scale", 1.0)
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not math.isfinite(scale) or scale == 0:
        raise InputError(where, f"scale is {scale!r}", "a finite number other than 0")
    unit, known = block.get("unit", ""), units_of(signal)
    if unit != "" and unit not in known:
        found = f"unit is {unit!r}"
        raise InputError(where, found, nearest(str(unit), known) if known else "no unit of a signal that is not the axis' own")
    acts = _acts(block.get("acts", UNKNOWN), where)
    source = SignalSource(block["topic"], block["field"], joint, float(scale), unit, acts=acts)
    try:
        steps = source.steps
    except InputError as error:
        raise InputError(where, f"{error.where}: {error.found}", error.expected) from None
    if joint is not None and isinstance(steps[-1], int):
        raise InputError(where, f"joint {joint} and an index in {source.field}", "one of the two")
    return source


def _acts(value: Any, where: str) -> str | float:
    if isinstance(value, str) and value in ACTS:
        return value
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(where, f"acts is {value!r}", f"{', '.join(ACTS)}, or s after the stamp")
    return float(value)


def _mapping(entry: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(entry, Mapping):
        raise InputError(where, f"{entry!r}", "a mapping")
    return entry


def _refuse_unknown(block: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    for key in block:
        if key not in tuple(known):
            raise InputError(where, f"unknown key {key!r}", nearest(str(key), known))


def graph_signals(namespace: str, joint: str) -> SignalMap:
    """Where a graph of nodes in a namespace such as `/azimuth` has the signals of its joint."""
    states = f"{namespace}/joint_states"
    return SignalMap(
        position=SignalSource(states, "position", joint),
        torque=SignalSource(states, "effort", joint),
        velocity=SignalSource(states, "velocity", joint),
        reference=SignalSource(f"{namespace}/reference", "position"),
    )


def opposing_torque() -> InputError:
    """The refusal of a torque whose sign is turned over."""
    return InputError("signal torque", "it opposes every motion that it should drive", "the other sign (scale: -1.0)")
