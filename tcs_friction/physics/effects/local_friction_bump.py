"""Dry friction that is raised in one place: a dent, a stain of rust, a joint of the rail."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import DRY, POSITION, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    distance = (motion[POSITION] - parameters[1]) / parameters[2]
    return motion[DRY] * parameters[0] * math.exp(-distance * distance)


TERM = Term(
    id="local_friction_bump",
    place=Place.SCALE,
    form="x = F amplitude exp(-((q - centre)/width)^2)",
    parameters=(
        Parameter("amplitude", "", "relative rise of the dry friction", role=Role.LINEAR),
        Parameter("centre", "rad", "where"),
        Parameter("width", "rad", "how wide, 1/e half width", lower=1e-12),
    ),
    kernel=torque,
    coordinate="position",
)
