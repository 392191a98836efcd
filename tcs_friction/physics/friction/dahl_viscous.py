"""Dahl friction (Dahl 1976) with viscous friction: LuGre's bristle without Stribeck drop and without damping.

dz/dt = v - stiffness |v| / coulomb z,   F = stiffness z + viscous v
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.friction.lugre import (
    COULOMB,
    STIFFNESS,
    VISCOUS_COEFFICIENT,
    bristle,
    bristle_step,
    bristle_widths,
    level_before,
    rate,
    scaled,
)
from tcs_friction.physics.terms import (
    DRY,
    LEVEL,
    MOBILISED,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Place,
    Survey,
    Term,
    kernel,
)


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: deflection z, rad."""
    coulomb, stiffness, viscous = parameters[:3]
    level = scaled(motion, coulomb)
    state[0] = bristle_step(state[0], motion[TRAVEL], level_before(motion, level), level, stiffness)
    motion[DRY] = stiffness * state[0]
    motion[VISCOUS] = viscous * motion[VELOCITY] * motion[VISCOUS_SCALE]
    motion[LEVEL] = level
    motion[MOBILISED] = min(max(motion[DRY] / level, -1.0), 1.0)
    return float(motion[DRY] + motion[VISCOUS])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"stiffness": survey.level / width} for width in bristle_widths(survey)]


TERM = Term(
    id="dahl_viscous",
    place=Place.LAW,
    form="F = stiffness z + viscous v, dz/dt = v - stiffness |v|/coulomb z",
    parameters=(COULOMB, STIFFNESS, VISCOUS_COEFFICIENT),
    kernel=friction,
    reads=(),
    states=1,
    scan=scan,
    rate=rate,
    bristle=bristle,
)
