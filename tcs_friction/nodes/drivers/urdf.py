"""What a robot's description (URDF) says of one joint: its kind, its limits, its believed friction. No ROS here.

The description may come from anybody on the network. It is read as a stream of tags, without a tree, within bounds of size and
depth, and one with a DOCTYPE, in which entities would be declared, is refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.parsers import expat

from tcs_friction.control.torque_gate import TorqueLimits
from tcs_friction.errors import InputError, nearest

LARGEST = 16 << 20
"""Bytes of a description; those of robots with many links have 1 MB."""
DEEPEST = 64
"""Tags within each other; a URDF has 6."""
MOST_NAMES = 10_000
"""Joints whose names are remembered, for the message about one that is not there."""
LINEAR = "prismatic"
KINDS = {"revolute": "rotary", "continuous": "rotary", LINEAR: "linear"}
"""Types of joints that can be an axis, and the `kind` of that axis."""


@dataclass(frozen=True)
class JointLimits:
    """One joint. For a prismatic one read N, m/s, m.

    kind: rotary or linear. effort: N m. speed: rad/s. lower, upper: rad, infinite for a continuous joint. friction: N m.
    damping: N m s/rad; both are 0 where the description says nothing.
    """

    kind: str
    effort: float
    speed: float
    lower: float = -math.inf
    upper: float = math.inf
    friction: float = 0.0
    damping: float = 0.0

    def within(self, limits: TorqueLimits, where: str) -> TorqueLimits:
        """The smaller ones of these limits and a driver's own. Raises InputError where no travel is left."""
        lower, upper = max(limits.travel_from, self.lower), min(limits.travel_to, self.upper)
        if lower > upper:
            found = f"travel from {self.lower:g} to {self.upper:g}"
            raise InputError(where, found, f"some of it within travel_from ({limits.travel_from:g}) to {limits.travel_to:g}")
        torque, speed = min(limits.torque_limit, self.effort), min(limits.overspeed, self.speed)
        return replace(limits, torque_limit=torque, overspeed=speed, travel_from=lower, travel_to=upper)


class _Reader:
    """Follows the tags of a description and keeps what stands at robot/joint of the wanted name."""

    def __init__(self, joint: str, where: str) -> None:
        self._joint, self._where = joint, where
        self._path: list[str] = []
        self._inside = False
        self.names: list[str] = []
        self.found: dict[str, Mapping[str, str]] = {}

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """A tag begins."""
        if len(self._path) >= DEEPEST:
            raise InputError(self._where, f"tags {DEEPEST} deep", "a URDF")
        self._path.append(tag)
        if self._path == ["robot", "joint"]:
            self._begin_joint(attributes)
        elif self._inside and len(self._path) == 3:
            self.found.setdefault(tag, attributes)

    def end(self, _: str) -> None:
        """A tag ends."""
        self._path.pop()
        self._inside = self._inside and len(self._path) > 1

    def doctype(self, *_: object) -> None:
        """Where entities would be declared."""
        raise InputError(self._where, "has a DOCTYPE", "a URDF, which has none")

    def _begin_joint(self, attributes: dict[str, str]) -> None:
        name = attributes.get("name", "")
        if len(self.names) < MOST_NAMES:
            self.names.append(name)
        self._inside = name == self._joint
        if self._inside and "joint" in self.found:
            raise InputError(self._where, f"joint {name} twice", "every joint once")
        if self._inside:
            self.found["joint"] = attributes


def joint_limits(description: str | bytes, joint: str, where: str) -> JointLimits:
    """A joint of a description. InputError, beginning with `where`, for what is no URDF or has no such joint or no limits."""
    data = description.encode(errors="replace") if isinstance(description, str) else description
    if len(data) > LARGEST:
        raise InputError(where, f"more than {LARGEST >> 20} MiB", "a URDF")
    reader = _Reader(joint, where)
    parser = expat.ParserCreate("utf-8" if isinstance(description, str) else None)
    parser.StartElementHandler, parser.EndElementHandler = reader.start, reader.end
    parser.StartDoctypeDeclHandler = reader.doctype
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(where, f"no XML ({error})", "a URDF") from None
    if "joint" not in reader.found:
        raise InputError(where, f"no joint {joint[:100]}", nearest(joint, reader.names))
    return _limits(reader.found, f"{where}: joint {joint}")


def load_joint_limits(path: Path, joint: str) -> JointLimits:
    """A joint of a description in a file."""
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(str(path), f"cannot be read ({reason})", "a URDF file") from None
    return joint_limits(data, joint, str(path))


def _limits(found: Mapping[str, Mapping[str, str]], where: str) -> JointLimits:
    kind = found["joint"].get("type", "")
    if kind not in KINDS:
        raise InputError(where, f"type {kind[:40]!r}", f"one of {', '.join(KINDS)}")
    if "mimic" in found:
        raise InputError(where, "mimics another", "a joint with a motor of its own")
    if "limit" not in found:
        raise InputError(where, "no <limit>", "<limit> with effort and velocity")
    limit, dynamics = found["limit"], found.get("dynamics", {})
    effort, speed = (_number(limit, name, f"{where}: limit") for name in ("effort", "velocity"))
    if not (effort > 0.0 and speed > 0.0):
        raise InputError(where, f"limits of effort {effort:g}, velocity {speed:g}", "positive ones: nothing may act otherwise")
    travel = (-math.inf, math.inf)
    if kind != "continuous":
        travel = (_number(limit, "lower", f"{where}: limit", "0"), _number(limit, "upper", f"{where}: limit", "0"))
        if not travel[0] < travel[1]:
            raise InputError(where, f"limits of travel {travel[0]:g} to {travel[1]:g}", "lower below upper")
    friction, damping = (_number(dynamics, name, f"{where}: dynamics", "0") for name in ("friction", "damping"))
    return JointLimits(KINDS[kind], effort, speed, *travel, friction, damping)


def _number(attributes: Mapping[str, str], name: str, where: str, default: str = "") -> float:
    text = attributes.get(name, default)[:40]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(where, f"{name} {text!r}", "a number")
    return value
