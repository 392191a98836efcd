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
    """State: stretch p of the bond, rad; velocity an instant before, rad/s.

    The force jumps where the bond lets go and where it holds again, after the part `passed` of the step. A sample stands for half
    a step on either side of it, so one that jumped in the middle of the step has its whole new force, one that jumped earlier has
    more than that and one that jumped later has less: sums over samples are right whenever it jumped.
    """
    coulomb, static, stiffness, damping, viscous = parameters[:5]
    limit, travel, velocity, last = coulomb / stiffness, motion[TRAVEL], motion[VELOCITY], state[1]
    held, passed = abs(state[0]) < limit, 0.5
    if not held and velocity * state[0] < 0.0:  # it holds again from where the motion reversed
        passed = last / (last - velocity) if last * state[0] > 0.0 else 0.0
        travel -= 0.5 * last * passed * dt
    stretch = state[0] + travel
    holds = abs(stretch) < limit
    if held and not holds:
        passed = (math.copysign(limit, stretch) - state[0]) / travel
    state[0], state[1] = min(max(stretch, -limit), limit), velocity
    share = holds + (0.5 - passed) * (holds - held)  # of the sample, in which the bond holds
    level = coulomb + share * (static - coulomb)
    motion[LEVEL] = scaled(motion, level)
    motion[DRY] = motion[LEVEL] * state[0] / limit + share * damping * velocity
    motion[VISCOUS] = viscous * velocity * motion[VISCOUS_SCALE]
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
    states=2,
    scan=scan,
    rate=rate,
    bristle=bristle,
)
