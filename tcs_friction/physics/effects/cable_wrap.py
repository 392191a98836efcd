"""Cable wrap: cables that twist with the axis, a hardening spring about a neutral position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import (
    POSITION,
    Need,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    kernel,
    spring_rate,
)

PLACES = tuple(k / 8.0 for k in range(-8, 9))  # travels from the middle: a cubic has other minima for a fit to end in
WITHIN_REACH = 1.5  # travels from the middle; a spring that rests farther off is hardly more than a constant torque


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    twist = motion[POSITION] - parameters[2]
    return float((parameters[0] + parameters[1] * twist * twist) * twist)


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Resting at zero, where cables are usually fitted, or at a place that the data tell."""
    middle = 0.5 * sum(survey.travel)
    return [{}, *({"neutral": middle + place * survey.span} for place in PLACES)]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """Of a neutral place that was fitted: at zero it is a convention, and the spring's size and sign hang on it."""
    if values["neutral"] == 0.0:
        return ""
    if values["stiffness"] < 0.0:
        return "it pushes away from its neutral place"
    away = abs(values["neutral"] - 0.5 * sum(survey.travel))
    return "its neutral place is out of reach" if away > WITHIN_REACH * survey.span else ""


def rate(values: Mapping[str, float], inertia: float) -> float:
    return spring_rate(values["stiffness"], 0.0, inertia)


TERM = Term(
    id="cable_wrap",
    place=Place.OPPOSING,
    form="x = stiffness (q - neutral) + cubic (q - neutral)^3",
    parameters=(
        Parameter("stiffness", "N m/rad", "linear stiffness", role=Role.LINEAR),
        Parameter("cubic", "N m/rad^3", "hardening", default=0.0, role=Role.LINEAR),
        Parameter("neutral", "rad", "position without torque", default=0.0),
    ),
    kernel=torque,
    reads=(),
    coordinate="position",
    subsystem="cable",
    scan=scan,
    neutral="neutral",
    implausible=implausible,
    needs=frozenset({Need.FREE_ACCELERATION}),
    rate=rate,
)
