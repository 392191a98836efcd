"""LuGre's bristle under LuGre's curve over the speed times a free one: for friction that falls or rises as no formula has it.

    dz/dt = v - stiffness |v| / g(v) z
    g(v)  = (coulomb + (static - coulomb) exp(-(v / stribeck_velocity)^2)) h(v)
    F     = stiffness z + damping dz/dt + viscous v

ln h is a cubic spline in ln |v| (Catmull and Rom 1974) through five knots at stribeck_velocity (1/9, 1/3, 1, 3, 9). It is zero at
the first and the last one and beyond; shape_1 to shape_3 are h at the three between. With all of them one the law is LuGre's;
with others it comes near every law of LuGre's kind (Canudas de Wit et al. 1995), with any Stribeck curve of Armstrong-Helouvry
et al. (1994). The spline has no kinks: with linear pieces a fit often ended where a knot met the speeds of many samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numba import njit

from tcs_friction.physics.friction.lugre import (
    COULOMB,
    DAMPING,
    STATIC,
    STIFFNESS,
    STRIBECK_VELOCITY,
    VISCOUS_COEFFICIENT,
    bristle,
    bristle_friction,
    rate,
    starts,
    stribeck_level,
)
from tcs_friction.physics.friction.lugre import TERM as LUGRE
from tcs_friction.physics.terms import VELOCITY, Feature, Parameter, Place, Survey, Term, kernel

APART = 3.0  # factor between the speeds of two knots
INNER = 3  # knots between the first and the last


@njit(cache=True, error_model="numpy")
def _knot(number: int, parameters: Any) -> float:
    """ln h at a knot; parameters as for `free_level`."""
    return math.log(parameters[2 + number]) if 0 < number <= INNER else 0.0


@njit(cache=True, error_model="numpy")
def free_level(velocity: float, parameters: Any) -> float:
    """Dry friction available at this velocity, N m; parameters: coulomb, static, stribeck_velocity, the inner shapes."""
    level, speed = stribeck_level(velocity, parameters[0], parameters[1], parameters[2]), abs(velocity)
    first = parameters[2] / APART ** (0.5 * (INNER + 1))
    if speed <= first:
        return float(level)
    passed = math.log(speed / first) / math.log(APART)
    if passed >= INNER + 1:
        return float(level)
    before = int(passed)
    left, right = _knot(before, parameters), _knot(before + 1, parameters)
    rise = right - left
    at_left = 0.5 * (right - _knot(before - 1, parameters)) if before > 0 else 0.0
    at_right = 0.5 * (_knot(before + 2, parameters) - left) if before < INNER else 0.0
    share = passed - before
    bend = 3.0 * rise - 2.0 * at_left - at_right + share * (at_left + at_right - 2.0 * rise)
    return float(level * math.exp(left + share * (at_left + share * bend)))


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: deflection z, rad."""
    level = free_level(motion[VELOCITY], parameters)
    return bristle_friction(motion, state, level, parameters[3 + INNER], parameters[4 + INNER], parameters[5 + INNER])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Starts with half the critical damping."""
    return starts(survey, (1.0,))


def _shape(number: int) -> Parameter:
    return Parameter(
        f"shape_{number}",
        "",
        f"friction at inner knot {number} over LuGre's",
        lower=0.1,
        upper=10.0,
        default=1.0,
        feature=Feature.STRIBECK,
        stated=False,
    )


TERM = Term(
    id="free_curve",
    place=Place.LAW,
    form="F = sigma0 z + sigma1 dz/dt + sigma2 v, dz/dt = v - sigma0 |v|/g(v) z, g LuGre's times a free curve",
    parameters=(
        COULOMB,
        STATIC,
        STRIBECK_VELOCITY,
        *(_shape(1 + k) for k in range(INNER)),
        STIFFNESS,
        DAMPING,
        VISCOUS_COEFFICIENT,
    ),
    kernel=friction,
    reads=(),
    states=1,
    scan=scan,
    rate=rate,
    bristle=bristle,
    extends=LUGRE.id,
)
