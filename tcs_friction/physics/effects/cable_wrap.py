"""Cable wrap: cables that twist with the axis, a hardening spring about a neutral position."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import POSITION, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    twist = motion[POSITION] - parameters[2]
    return float((parameters[0] + parameters[1] * twist * twist) * twist)


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
)
