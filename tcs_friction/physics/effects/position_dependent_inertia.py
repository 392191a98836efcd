"""Inertia that changes over the turn, as of an eccentric payload or a tube that tilts: twice per turn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tcs_friction.physics.terms import (
    CYCLE,
    INERTIA,
    POSITION,
    VELOCITY,
    Need,
    Parameter,
    Place,
    Role,
    Term,
    kernel,
)


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """Lagrange: J(q) a + J'(q) v^2 / 2; the first part acts through motion[INERTIA]."""
    angle = 2.0 * motion[CYCLE] * motion[POSITION] + parameters[1]
    inertia = motion[INERTIA]
    motion[INERTIA] = inertia * (1.0 + parameters[0] * math.cos(angle))
    return float(-inertia * parameters[0] * motion[CYCLE] * math.sin(angle) * motion[VELOCITY] ** 2)


def inertia_over(values: Mapping[str, float], angle: np.ndarray) -> np.ndarray:
    return 1.0 + values["amplitude"] * np.cos(2.0 * angle + values["phase"])


TERM = Term(
    id="position_dependent_inertia",
    place=Place.BODY,
    form="J (1 + amplitude cos(2 q + phase))",
    parameters=(
        Parameter(
            "amplitude", "", "relative variation of the inertia", lower=-0.95, upper=0.95, role=Role.LINEAR
        ),
        Parameter("phase", "rad", "phase of the variation", default=0.0, role=Role.PHASE),
    ),
    kernel=torque,
    reads=(),
    rotary=True,
    coordinate="acceleration",
    subsystem="structure",
    needs=frozenset({Need.ACCELERATION, Need.MEASURED_INERTIA, Need.TRAVEL}),
    inertia_over=inertia_over,
)
