"""Drag that grows with the square of speed; a negative coefficient is degressive viscous friction."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import VELOCITY, Need, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0] * motion[VELOCITY] * abs(motion[VELOCITY]))


TERM = Term(
    id="quadratic_drag",
    place=Place.OPPOSING,
    form="x = coefficient v |v|",
    parameters=(Parameter("coefficient", "N m s^2/rad^2", "drag coefficient", role=Role.LINEAR),),
    kernel=torque,
    reads=(),
    coordinate="velocity",
    needs=frozenset({Need.SPEEDS}),
)
