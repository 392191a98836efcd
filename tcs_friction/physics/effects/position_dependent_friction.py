"""Dry friction that varies slowly over the turn: a bearing out of true, uneven grease."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import CYCLE, DRY, POSITION, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    angle = parameters[0] * motion[CYCLE] * motion[POSITION] + parameters[2]
    return motion[DRY] * parameters[1] * math.cos(angle)


TERM = Term(
    id="position_dependent_friction",
    place=Place.SCALE,
    form="x = F amplitude cos(order q + phase)",
    parameters=(
        Parameter("order", "1/turn", "periods per turn (per metre if linear)", lower=1e-6),
        Parameter("amplitude", "", "relative variation of the dry friction", role=Role.LINEAR),
        Parameter("phase", "rad", "phase of the variation", default=0.0, role=Role.PHASE),
    ),
    kernel=torque,
    coordinate="position",
)
