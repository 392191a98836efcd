"""A constant torque: an amplifier's offset, a tilted axis, a counterweight."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import Need, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0])


TERM = Term(
    id="torque_bias",
    place=Place.OPPOSING,
    form="x = bias",
    parameters=(Parameter("bias", "N m", "constant opposing torque", role=Role.LINEAR),),
    kernel=torque,
    reads=(),
    coordinate="torque",
    subsystem="actuator",
    offset="bias",
    needs=frozenset({Need.BOTH_DIRECTIONS}),
)
