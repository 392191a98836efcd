"""Dry friction that grows with the load torque: gears, worms, loaded bearings."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import MOBILISED, TORQUE, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0] * abs(motion[TORQUE]) * motion[MOBILISED])


TERM = Term(
    id="load_dependent_friction",
    place=Place.SCALE,
    form="x = coefficient |u| sign(v)",
    parameters=(Parameter("coefficient", "", "friction torque per load torque", lower=-1.0, upper=1.0, role=Role.LINEAR),),
    kernel=torque,
    coordinate="torque",
)
