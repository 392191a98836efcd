"""Bliman-Sorine friction (Bliman and Sorine 1995): two Dahl elements, the faster one minus the slower one.

    dF_1/d|x| = (f_1 sign(v) - F_1) / (ratio distance),   dF_2/d|x| = (f_2 sign(v) - F_2) / distance
    F = F_1 - F_2 + viscous v,   f_1 = coulomb + transient,   f_2 = transient

Friction depends on the path alone, not on the velocity: after a reversal it rises over the short distance, overshoots
and falls to coulomb over the long one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.friction.lugre import COULOMB, VISCOUS_COEFFICIENT, bristle_widths, scaled
from tcs_friction.physics.terms import (
    DRY,
    LEVEL,
    MOBILISED,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Feature,
    Parameter,
    Place,
    Survey,
    Term,
    kernel,
    spring_rate,
)

USUAL_TRANSIENT, USUAL_RATIO = 0.4, 0.3  # times Coulomb friction, and of distances, where a search starts


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: F_1 and F_2, N m."""
    coulomb, transient, distance, ratio, viscous = parameters[:5]
    travel = motion[TRAVEL]
    level = scaled(motion, coulomb)
    direction = math.copysign(1.0, travel)
    fast, slow = direction * (level + transient * level / coulomb), direction * transient * level / coulomb
    state[0] = fast + (state[0] - fast) * math.exp(-abs(travel) / (ratio * distance))
    state[1] = slow + (state[1] - slow) * math.exp(-abs(travel) / distance)
    motion[DRY] = state[0] - state[1]
    motion[VISCOUS] = viscous * motion[VELOCITY] * motion[VISCOUS_SCALE]
    motion[LEVEL] = level
    motion[MOBILISED] = min(max(motion[DRY] / level, -1.0), 1.0)
    return float(motion[DRY] + motion[VISCOUS])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Starts that are as stiff as a bristle of each width."""
    wider = (1.0 + USUAL_TRANSIENT) / USUAL_RATIO - USUAL_TRANSIENT
    return [
        {"transient": USUAL_TRANSIENT * survey.level, "presliding_distance": wider * width}
        for width in bristle_widths(survey)
    ]


def rate(values: Mapping[str, float], inertia: float) -> float:
    """Of the inertia on the faster element, as stiff as it is after a reversal."""
    return spring_rate(_faster(values), values["viscous"], inertia)


def stiffness(values: Mapping[str, float]) -> float:
    """Of the faster element less that of the slower one."""
    return _faster(values) - values["transient"] / values["presliding_distance"]


def _faster(values: Mapping[str, float]) -> float:
    """Stiffness of the faster element, N m/rad."""
    return (values["coulomb"] + values["transient"]) / (values["ratio"] * values["presliding_distance"])


def bristle(values: Mapping[str, float]) -> float:
    """The distance of the slower element."""
    return values["presliding_distance"]


TERM = Term(
    id="bliman_sorine",
    place=Place.LAW,
    form="F = F_1 - F_2 + viscous v, each relaxing over its own distance",
    parameters=(
        COULOMB,
        Parameter(
            "transient", "N m", "torque of the slower element, what the friction overshoots by", lower=1e-12
        ),
        Parameter(
            "presliding_distance",
            "rad",
            "distance over which the overshoot dies",
            lower=1e-15,
            feature=Feature.PRESLIDING,
        ),
        Parameter(
            "ratio", "", "distance of the rise over that of the fall", lower=0.01, upper=0.99, default=USUAL_RATIO
        ),
        VISCOUS_COEFFICIENT,
    ),
    kernel=friction,
    reads=(),
    states=2,
    scan=scan,
    rate=rate,
    bristle=bristle,
    stiffness=stiffness,
)
