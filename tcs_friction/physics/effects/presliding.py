"""Pre-sliding for a law without bristles: torque before motion and hysteresis at reversals.

The law's dry part is replaced by LuGre's bristle at the law's own level (paper eqs. 2 to 4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.friction.lugre import NARROWEST, bristle_step
from tcs_friction.physics.terms import (
    DRY,
    LEVEL,
    MOBILISED,
    TRAVEL,
    VELOCITY,
    Feature,
    Need,
    Parameter,
    Place,
    Survey,
    Term,
    geometric,
    kernel,
    spring_rate,
)

LONGEST_BRISTLE = 0.1  # of the travel
FEWEST_TURNS = 2  # there and back: a hysteresis loop


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: deflection, rad; level at the instant before, N m."""
    v, level, sigma0, sigma1 = motion[VELOCITY], motion[LEVEL], parameters[0], parameters[1]
    z = bristle_step(state[0], motion[TRAVEL], state[1] if state[1] > 0.0 else level, level, sigma0)
    state[0], state[1] = z, level
    before = motion[DRY]
    motion[DRY] = sigma0 * z + sigma1 * (v - sigma0 * abs(v) / level * z)
    motion[MOBILISED] = min(max(sigma0 * z / level, -1.0), 1.0)
    return float(motion[DRY] - before)


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Bristle travels from the position's noise to a tenth of the travel; without damping and with half the critical one."""
    starts = []
    for width in geometric(max(NARROWEST * survey.resolution, 1e-7 * survey.span), 0.1 * survey.span, 9):
        stiffness = survey.level / width
        starts += [
            {"stiffness": stiffness, "damping": d * (stiffness * survey.inertia) ** 0.5} for d in (0.01, 1.0)
        ]
    return starts


def rate(values: Mapping[str, float], inertia: float) -> float:
    return spring_rate(values["stiffness"], values["damping"], inertia)


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    bristle = survey.level / values["stiffness"]
    if bristle > LONGEST_BRISTLE * survey.span:
        return "what bends over so much of the travel is no bristle"
    return "such a bristle is hardly ever bent both ways" if len(survey.turns(bristle)) < FEWEST_TURNS else ""


def of_law(values: Mapping[str, float]) -> Mapping[str, float]:
    return {name: values[name] for name in ("stiffness", "damping") if name in values}


TERM = Term(
    id="presliding",
    place=Place.OPPOSING,
    form="F becomes sigma0 z + sigma1 dz/dt, dz/dt = v - sigma0 |v|/g(v) z",
    parameters=(
        Parameter("stiffness", "N m/rad", "bristle stiffness, sigma0", lower=1e-9, feature=Feature.PRESLIDING),
        Parameter(
            "damping", "N m s/rad", "bristle damping, sigma1", lower=0.0, default=0.0, feature=Feature.PRESLIDING
        ),
    ),
    kernel=torque,
    reads=("friction",),
    states=2,
    coordinate="time_since_reversal",
    rank=-1,
    scan=scan,
    of_law=of_law,
    implausible=implausible,
    needs=frozenset({Need.BOTH_DIRECTIONS, Need.REVERSALS}),
    rate=rate,
)
