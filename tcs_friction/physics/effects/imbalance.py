"""Imbalance: gravity on a centre of mass off the axis."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import CYCLE, POSITION, Need, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0] * math.sin(motion[CYCLE] * motion[POSITION] + parameters[1]))


TERM = Term(
    id="imbalance",
    place=Place.OPPOSING,
    form="x = amplitude sin(q + phase)",
    parameters=(
        Parameter("amplitude", "N m", "largest gravity torque", role=Role.LINEAR),
        Parameter("phase", "rad", "angle from the balanced position", default=0.0, role=Role.PHASE),
    ),
    kernel=torque,
    reads=(),
    rotary=True,
    coordinate="position",
    subsystem="structure",
    needs=frozenset({Need.FREE_ACCELERATION}),
)
