"""Cable wrap: cables that twist with the axis, a hardening spring about a neutral position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcs_friction.physics.terms import POSITION, Need, Parameter, Place, Role, Term, kernel, spring_rate


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    twist = motion[POSITION] - parameters[2]
    return float((parameters[0] + parameters[1] * twist * twist) * twist)


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
    needs=frozenset({Need.FREE_ACCELERATION}),
    rate=rate,
)
