"""Stribeck drop for a law without one: friction at rest exceeds that of sliding, over a small velocity."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import DRY, LEVEL, MOBILISED, VELOCITY, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """Raises the level for the terms that come after."""
    ratio = motion[VELOCITY] / parameters[1]
    rise = parameters[0] * math.exp(-ratio * ratio)
    motion[LEVEL] += rise
    motion[DRY] += rise * motion[MOBILISED]
    return float(rise * motion[MOBILISED])


TERM = Term(
    id="stribeck",
    place=Place.SCALE,
    form="x = drop exp(-(v/stribeck_velocity)^2) sign(v)",
    parameters=(
        Parameter("drop", "N m", "static minus coulomb", role=Role.LINEAR),
        Parameter("stribeck_velocity", "rad/s", "velocity over which static falls to coulomb", lower=1e-12),
    ),
    kernel=torque,
    coordinate="velocity",
    rank=-2,
)
