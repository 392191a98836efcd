"""Commands to a controller of several joints, of which one is the axis: which number is whose, and what the others keep. No ROS.

A command to an effort controller has a number for each of its joints; there is no way to leave one out. What the others
had before cannot be asked for, 0 lets an arm fall, and the effort measured last is only near what held it. So nothing is
assumed: parameter `others` says it for each of them, and the usual answer is a controller of the one joint.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from tcs_friction.errors import InputError

MEASURED = "measured"
"""In place of a number: what the robot reports of the joint when torque begins to be let on."""
MOST_JOINTS = 1000

Others = Mapping[str, float | None]
"""Effort (N m) that each other joint keeps by name, None for the measured one."""


def others_of(texts: Sequence[str], where: str) -> Others:
    """The parameter `others`: JOINT=EFFORT or JOINT=measured each. Raises InputError."""
    found: dict[str, float | None] = {}
    for text in texts:
        joint, _, value = (part.strip() for part in text.partition("="))
        effort = None if value == MEASURED else _number(value)
        if not joint or (effort is not None and not math.isfinite(effort)):
            raise InputError(where, repr(text), f"JOINT=EFFORT in N m, or JOINT={MEASURED}")
        if joint in found:
            raise InputError(where, f"{joint} twice", "every joint once")
        found[joint] = effort
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def objection(joints: Sequence[str], interface: str, axis: str, others: Others, controller: str) -> str:
    """Why an axis cannot be driven through a controller of these joints, "" when it can. `interface`: "" where it is not told."""
    if not joints or len(joints) > MOST_JOINTS:
        return f"{controller} names {len(joints)} joints, expected {axis}"
    if len(set(joints)) < len(joints):
        return f"{controller} names a joint twice"
    if interface not in ("", "effort"):
        return f"{controller} commands {interface[:40]}, expected effort"
    if axis not in joints:
        return f"{controller} commands {_listed(joints)}, expected {axis}"
    unnamed = [name for name in joints if name != axis and name not in others]
    if unnamed:
        return f"{controller} commands {_listed(unnamed)} as well: say in parameter others what each keeps, as JOINT=EFFORT"
    strange = [name for name in others if name not in joints or name == axis]
    return f"parameter others names {_listed(strange)}, which {controller} does not command beside {axis}" if strange else ""


def _listed(names: Sequence[str], most: int = 5) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(name[:100] for name in names[:most]) + more


class EffortCommand:
    """std_msgs/Float64MultiArray in the order of a controller's joints: one number changes, the others stay."""

    def __init__(self, joints: Sequence[str], axis: str, kept: Mapping[str, float]) -> None:
        """kept: effort (N m) of every other joint."""
        self._efforts = [0.0 if name == axis else kept[name] for name in joints]
        self._at = list(joints).index(axis)
        self._layout = struct.Struct(f"<4sIII4x{len(self._efforts)}d")

    def write(self, torque: float) -> bytes:
        """The serialised message with a torque (N m) of the axis; one that is not finite is none."""
        self._efforts[self._at] = torque if math.isfinite(torque) else 0.0
        return self._layout.pack(b"\x00\x01\x00\x00", 0, 0, len(self._efforts), *self._efforts)
