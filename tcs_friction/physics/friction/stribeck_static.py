"""Stribeck friction without bristles: F = g(v) sign(v) + viscous v, g falling from static to coulomb.

g(v) = coulomb + (static - coulomb) exp(-|v / stribeck_velocity|^exponent); exponent 2 is paper eq. 3,
Armstrong-Helouvry (1994) reports 0.5 to 2 for other lubrications.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numba import njit

from tcs_friction.physics.friction.coulomb_viscous import static_friction, viscous_rate
from tcs_friction.physics.friction.lugre import (
    COULOMB,
    STATIC,
    STRIBECK_VELOCITY,
    USUAL_STATIC,
    VISCOUS_COEFFICIENT,
    stribeck_velocities,
)
from tcs_friction.physics.terms import VELOCITY, Feature, Parameter, Place, Survey, Term, kernel


@njit(cache=True, error_model="numpy")
def stribeck_fall(ratio: float, exponent: float) -> float:
    """exp(-|ratio|^exponent), the share of static over Coulomb friction that is left at a ratio of velocities."""
    power = ratio * ratio if exponent == 2.0 else abs(ratio) ** exponent  # a power takes as long as all else
    return math.exp(-power)


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    coulomb, static, stribeck_velocity, viscous, exponent = parameters[:5]
    fall = stribeck_fall(motion[VELOCITY] / stribeck_velocity, exponent)
    return float(static_friction(motion, coulomb + (static - coulomb) * fall, viscous))


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [
        {"static": USUAL_STATIC * survey.level, "stribeck_velocity": velocity}
        for velocity in stribeck_velocities(survey)
    ]


EXPONENT = Parameter(
    "exponent", "", "shape of the Stribeck curve", lower=0.2, upper=4.0, default=2.0, feature=Feature.STRIBECK
)

TERM = Term(
    id="stribeck_static",
    place=Place.LAW,
    form="F = (coulomb + (static - coulomb) exp(-|v/stribeck_velocity|^exponent)) sign(v) + viscous v",
    parameters=(
        COULOMB,
        STATIC,
        STRIBECK_VELOCITY,
        VISCOUS_COEFFICIENT,
        EXPONENT,
    ),
    kernel=friction,
    reads=(),
    scan=scan,
    rate=viscous_rate,
)
