"""A term's parameter: its unit and bounds, how the torque depends on it, what of the friction it describes."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

from tcs_friction.errors import InputError


class Role(enum.Enum):
    """How the torque depends on a parameter: what a fit may exploit."""

    LINEAR = "linear"  # torque proportional to it
    PHASE = "phase"  # phase of the LINEAR parameter declared just before it, rad
    SHAPE = "shape"  # anything else; must be searched
    FIXED = "fixed"  # a convention or datum, never fitted


class Feature(enum.Enum):
    """What of the friction a parameter describes, in a law or in an effect that completes one."""

    DRY = "dry friction of steady sliding"  # of a law: its level, N m
    VISCOUS = "viscous friction"
    STRIBECK = "dry friction that falls with speed"
    PRESLIDING = "dry friction that builds up over a travel"


@dataclass(frozen=True)
class Parameter:
    """One declared parameter of a term. `unit` is that of a rotary axis; `unit_for` gives the linear one.

    default: None where a value has to be given. feature: what of the friction it describes, if that is one of the usual parts.
    stated: whether a sentence about the effect has room for it; a table has them all.
    """

    name: str
    unit: str
    description: str
    lower: float = -math.inf
    upper: float = math.inf
    default: float | None = None
    role: Role = Role.SHAPE
    feature: Feature | None = None
    stated: bool = True

    def unit_for(self, kind: str, torque: str = "") -> str:
        """Unit on an axis of this kind ("rotary" or "linear") whose torque is in `torque`, "" for N m or N."""
        return self.unit if self.role is Role.PHASE else unit_on(kind, self.unit, torque)

    def check(self, value: object, where: str) -> float:
        """The value as a float.

        Raises
        ------
        InputError: not a number, not finite or out of the bounds.
        """
        number = float("nan")
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
        if not (math.isfinite(number) and self.lower <= number <= self.upper):
            bounds = f"a number from {self.lower:g} to {self.upper:g} {self.unit}".rstrip()
            raise InputError(where, f"{self.name} is {value!r}", bounds)
        return number


class Harmonic(NamedTuple):
    """The two numbers of one harmonic of a periodic effect; no phase where it is the effect's own."""

    amplitude: Parameter
    phase: Parameter | None


def unit_on(kind: str, unit: str, torque: str = "") -> str:
    """The unit that a "rotary" or "linear" axis has where a rotary one has `unit`.

    torque: what torque is in where it is known up to a constant (A, V, %), "" for N m or N.

    >>> unit_on("linear", "N m s/rad"), unit_on("linear", "kg m^2"), unit_on("rotary", "1/turn")
    ('N s/m', 'kg', '1/turn')
    >>> unit_on("rotary", "kg m^2", "A"), unit_on("linear", "N m s/rad", "A")
    ('A s^2/rad', 'A s/m')
    """
    if torque:
        for plain, other in (("kg m^2", f"{torque} s^2/rad"), ("kg m²", f"{torque} s²/rad"), ("N m", torque)):
            unit = unit.replace(plain, other)
    if kind == "rotary":
        return unit
    for rotary, linear in (("kg m^2", "kg"), ("kg m²", "kg"), ("N m", "N"), ("turn", "m")):
        unit = unit.replace(rotary, linear)
    return unit.replace("rad", "m")
