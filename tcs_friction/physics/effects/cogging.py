"""Cogging: torque locked to the position by the magnets' attraction to the slots, with harmonics of one order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tcs_friction.physics.terms import CYCLE, POSITION, Parameter, Place, Role, Survey, Term, kernel, resolved

HARMONICS = 4


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    angle = parameters[0] * motion[CYCLE] * motion[POSITION]
    opposing = 0.0
    for j in range(HARMONICS):
        amplitude = parameters[1 + 2 * j]
        if amplitude != 0.0 and resolved(motion, (j + 1) * parameters[0]):
            opposing += amplitude * math.cos((j + 1) * angle + parameters[2 + 2 * j])
    return opposing


def _harmonic(j: int) -> tuple[Parameter, Parameter]:
    suffix = "" if j == 1 else f"_{j}"
    default = None if j == 1 else 0.0
    return (
        Parameter(
            f"amplitude{suffix}",
            "N m",
            f"amplitude of harmonic {j}",
            default=default,
            role=Role.LINEAR,
            stated=j == 1,
        ),
        Parameter(f"phase{suffix}", "rad", f"phase of harmonic {j}", default=0.0, role=Role.PHASE),
    )


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """While bristles bend the axis does not slide, and their torque follows the position, too."""
    half = math.pi / (values["order"] * survey.cycle)
    return "half a wave is shorter than the travel of a bristle" if half < survey.bristle else ""


TERM = Term(
    id="cogging",
    place=Place.OPPOSING,
    form="x = sum_j amplitude_j cos(j order q + phase_j)",
    parameters=(
        Parameter("order", "1/turn", "periods per turn (per metre if linear) of the fundamental", lower=1e-6),
        *[parameter for j in range(1, HARMONICS + 1) for parameter in _harmonic(j)],
    ),
    kernel=torque,
    reads=(),
    coordinate="position",
    subsystem="actuator",
    periodic="position",
    whole=True,
    implausible=implausible,
)
