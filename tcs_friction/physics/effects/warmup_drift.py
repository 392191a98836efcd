"""Friction that decays while the axis warms up, without a temperature signal."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import DRY, TIME, VISCOUS, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    cold = math.exp(-motion[TIME] / parameters[2])
    return cold * (parameters[0] * motion[DRY] + parameters[1] * motion[VISCOUS])


TERM = Term(
    id="warmup_drift",
    place=Place.SCALE,
    form="x = exp(-t/time_constant) (dry F + viscous F_viscous)",
    parameters=(
        Parameter("dry", "", "relative excess of dry friction at the start", default=0.0, role=Role.LINEAR),
        Parameter("viscous", "", "relative excess of viscous friction at the start", default=0.0, role=Role.LINEAR),
        Parameter("time_constant", "s", "time in which the excess falls to 1/e", lower=1e-9),
    ),
    kernel=torque,
    coordinate="time",
)
