"""Reset integrator friction (Haessig and Friedland 1991): a bond that stretches up to a limit, stiffer while it holds.

dp/dt = v while the bond holds (|p| < coulomb / stiffness), else p stays at its limit
F = static / coulomb stiffness p + damping dp/dt while it holds, coulomb sign(v) when it slides; plus viscous v
"""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.friction.lugre import (
    COULOMB,
    DAMPING,
    STATIC,
    STIFFNESS,
    VISCOUS_COEFFICIENT,
    bristle,
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


TERM = Term(
    id="reset_integrator",
    place=Place.LAW,
    form="F = static/coulomb stiffness p + damping dp/dt while |p| < coulomb/stiffness, else coulomb sign(v); + viscous v",
    parameters=(COULOMB, STATIC, STIFFNESS, DAMPING, VISCOUS_COEFFICIENT),
    kernel=friction,
    reads=(),
    states=1,
    rate=rate,
    bristle=bristle,
)
