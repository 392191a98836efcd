"""Reset integrator friction (Haessig and Friedland 1991): a bond that stretches up to a limit, stiffer while it holds.

dp/dt = v while the bond holds (|p| < coulomb / stiffness), else p stays at its limit
F = static / coulomb stiffness p + damping dp/dt while it holds, coulomb sign(v) when it slides; plus viscous v
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.friction.lugre import (
    COULOMB,
    DAMPING,
    STATIC,
    STIFFNESS,
    USUAL_STATIC,
    VISCOUS_COEFFICIENT,
    bristle,
    bristle_widths,
    damping_shares,
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
    """State: stretch p of the bond, rad."""
    coulomb, static, stiffness, damping, viscous = parameters[:5]
    limit = coulomb / stiffness
    stretch = state[0] + motion[TRAVEL]
    state[0] = min(max(stretch, -limit), limit)
    holds = abs(stretch) < limit
    motion[LEVEL] = scaled(motion, static if holds else coulomb)
    motion[DRY] = motion[LEVEL] * state[0] / limit
    if holds:
        motion[DRY] += damping * motion[VELOCITY]
    motion[VISCOUS] = viscous * motion[VELOCITY] * motion[VISCOUS_SCALE]
    motion[MOBILISED] = state[0] / limit
    return float(motion[DRY] + motion[VISCOUS])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [
        {
            "static": USUAL_STATIC * survey.level,
            "stiffness": survey.level / width,
            "damping": share * math.sqrt(survey.level / width * survey.inertia),
        }
        for width in bristle_widths(survey)
        for share in damping_shares()
    ]


TERM = Term(
    id="reset_integrator",
    place=Place.LAW,
    form="F = static/coulomb stiffness p + damping dp/dt while |p| < coulomb/stiffness, else coulomb sign(v); + viscous v",
    parameters=(COULOMB, STATIC, STIFFNESS, DAMPING, VISCOUS_COEFFICIENT),
    kernel=friction,
    reads=(),
    states=1,
    scan=scan,
    rate=rate,
    bristle=bristle,
    discontinuous=True,
)
