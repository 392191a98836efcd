"""Dry friction that is raised in one place: a dent, a stain of rust, a joint of the rail."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import DRY_SCALE, POSITION, Parameter, Place, Role, Term, kernel


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    distance = (motion[POSITION] - parameters[1]) / parameters[2]
    motion[DRY_SCALE] *= 1.0 + parameters[0] * math.exp(-distance * distance)
    return 0.0


TERM = Term(
    id="local_friction_bump",
    place=Place.SCALE,
    form="level (1 + amplitude exp(-((q - centre)/width)^2))",
    parameters=(
        Parameter("amplitude", "", "relative rise of the dry friction", role=Role.LINEAR),
        Parameter("centre", "rad", "where"),
        Parameter("width", "rad", "how wide, 1/e half width", lower=1e-12),
    ),
    kernel=scale,
    coordinate="position",
)
