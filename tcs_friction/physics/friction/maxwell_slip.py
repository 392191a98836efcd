"""Generalised Maxwell slip (Al-Bender, Lampaert and Swevers 2005) in the limit of quick attraction: springs that slip one by one.

    F_i follows stiffness_i dx, but never leaves +-g(v)/elements;   F = sum_i F_i + viscous v
    g(v) = coulomb + (static - coulomb) exp(-(v / stribeck_velocity)^2)

Element i of N slips after a distance proportional to ((i - 1/2)/N)^spread; all together have the given stiffness. Unlike LuGre's
bristle the memory is not lost inside a hysteresis loop: small loops close (nonlocal memory).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.friction.lugre import (
    COULOMB,
    STATIC,
    STIFFNESS,
    STRIBECK_VELOCITY,
    USUAL_STATIC,
    VISCOUS_COEFFICIENT,
    bristle,
    bristle_widths,
    rate,
    scaled,
    stribeck_level,
    stribeck_velocities,
)
from tcs_friction.physics.terms import (
    DRY,
    LEVEL,
    MOBILISED,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    kernel,
)


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: torque of each element, N m; share of the stiffness that each has; the spread behind these shares, plus one."""
    stiffness, spread, viscous = parameters[3], parameters[4], parameters[5]
    elements = len(state) // 2
    if state[2 * elements] != spread + 1.0:
        softness = 0.0
        for i in range(elements):
            state[elements + i] = ((i + 0.5) / elements) ** -spread
            softness += state[elements + i]
        for i in range(elements):
            state[elements + i] /= softness
        state[2 * elements] = spread + 1.0
    level = scaled(motion, stribeck_level(motion[VELOCITY], parameters[0], parameters[1], parameters[2]))
    total, limit = 0.0, level / elements
    for i in range(elements):
        state[i] = min(max(state[i] + stiffness * state[elements + i] * motion[TRAVEL], -limit), limit)
        total += state[i]
    motion[DRY] = total
    motion[VISCOUS] = viscous * motion[VELOCITY] * motion[VISCOUS_SCALE]
    motion[LEVEL] = level
    motion[MOBILISED] = total / level
    return float(total + motion[VISCOUS])


def element_count(values: Mapping[str, float], dt: float) -> int:
    """Number of states."""
    return 2 * round(values["elements"]) + 1


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [
        {
            "static": USUAL_STATIC * survey.level,
            "stribeck_velocity": velocity,
            "stiffness": survey.level / width,
        }
        for width in bristle_widths(survey)
        for velocity in stribeck_velocities(survey)
    ]


TERM = Term(
    id="maxwell_slip",
    place=Place.LAW,
    form="F = sum_i F_i + viscous v, F_i = stiffness_i x within +-g(v)/elements",
    parameters=(
        COULOMB,
        STATIC,
        STRIBECK_VELOCITY,
        STIFFNESS,
        Parameter(
            "spread", "", "how far apart the elements slip: 0 all at once", lower=0.0, upper=4.0, default=1.0
        ),
        VISCOUS_COEFFICIENT,
        Parameter("elements", "", "number of elements", lower=1.0, upper=64.0, default=8.0, role=Role.FIXED),
    ),
    kernel=friction,
    reads=(),
    states=element_count,
    scan=scan,
    rate=rate,
    bristle=bristle,
)
