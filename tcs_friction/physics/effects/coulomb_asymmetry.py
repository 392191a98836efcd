"""Dry friction that differs by direction: a loaded seal, a worm's flank."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import DRY, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0] * abs(motion[DRY]))


TERM = Term(
    id="coulomb_asymmetry",
    place=Place.SCALE,
    form="x = asymmetry |F|",
    parameters=(Parameter("asymmetry", "", "half the difference over the mean", lower=-1.0, upper=1.0, role=Role.LINEAR),),
    kernel=torque,
    coordinate="direction",
)
