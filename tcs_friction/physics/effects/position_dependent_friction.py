"""Dry friction that varies slowly over the turn: a bearing out of true, uneven grease."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import (
    CYCLE,
    DRY_SCALE,
    POSITION,
    Need,
    Parameter,
    Place,
    Role,
    Term,
    kernel,
    resolved,
)

MOST_PERIODS = 12.0  # per turn: bearings out of true and uneven grease vary more slowly


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    if not resolved(motion, parameters[0]):
        return 0.0
    angle = parameters[0] * motion[CYCLE] * motion[POSITION] + parameters[2]
    motion[DRY_SCALE] *= 1.0 + parameters[1] * math.cos(angle)
    return 0.0


def orders(once: float, rotary: bool) -> tuple[float, float]:
    """It varies slowly: from half a period over the travel to MOST_PERIODS per turn, or over a travel shorter than a turn."""
    return 0.5 * once, MOST_PERIODS * max(once, 1.0)


TERM = Term(
    id="position_dependent_friction",
    place=Place.SCALE,
    form="level (1 + amplitude cos(order q + phase))",
    parameters=(
        Parameter("order", "1/turn", "periods per turn (per metre if linear)", lower=1e-6),
        Parameter(
            "amplitude",
            "",
            "relative variation of the dry friction",
            lower=-0.95,
            upper=0.95,
            role=Role.LINEAR,
        ),
        Parameter("phase", "rad", "phase of the variation", default=0.0, role=Role.PHASE),
    ),
    kernel=scale,
    reads=(),
    coordinate="position",
    periodic="position",
    needs=frozenset({Need.BOTH_DIRECTIONS}),
    orders=orders,
)
