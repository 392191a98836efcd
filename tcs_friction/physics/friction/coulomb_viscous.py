"""Coulomb and viscous friction: F = coulomb sign(v) + viscous v, at rest whatever holds the axis up to coulomb."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import njit

from tcs_friction.physics.friction.lugre import COULOMB, VISCOUS_COEFFICIENT, scaled
from tcs_friction.physics.terms import (
    ARREST,
    DRY,
    LEVEL,
    MOBILISED,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Place,
    Term,
    kernel,
)


@njit(cache=True, error_model="numpy")
def static_friction(motion: Any, level: float, viscous: float) -> float:
    """Dry friction that arrests the axis if it can, its level otherwise (Karnopp 1985), plus viscous friction."""
    level = scaled(motion, level)
    motion[VISCOUS] = viscous * motion[VELOCITY] * motion[VISCOUS_SCALE]
    motion[LEVEL] = level
    motion[MOBILISED] = min(max((motion[ARREST] - motion[VISCOUS]) / level, -1.0), 1.0)
    motion[DRY] = level * motion[MOBILISED]
    return float(motion[DRY] + motion[VISCOUS])


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(static_friction(motion, parameters[0], parameters[1]))


def viscous_rate(values: Mapping[str, float], inertia: float) -> float:
    """Of the decay by viscous friction."""
    return values["viscous"] / inertia


TERM = Term(
    id="coulomb_viscous",
    place=Place.LAW,
    form="F = coulomb sign(v) + viscous v",
    parameters=(COULOMB, VISCOUS_COEFFICIENT),
    kernel=friction,
    reads=(),
    rate=viscous_rate,
    usual=True,
)
