"""Viscous friction that differs by direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcs_friction.physics.terms import VELOCITY, Need, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0] * abs(motion[VELOCITY]))


def rate(values: Mapping[str, float], inertia: float) -> float:
    return abs(values["asymmetry"]) / inertia


TERM = Term(
    id="viscous_asymmetry",
    place=Place.OPPOSING,
    form="x = asymmetry |v|",
    parameters=(
        Parameter(
            "asymmetry", "N m s/rad", "half the difference of the viscous coefficients", role=Role.LINEAR
        ),
    ),
    kernel=torque,
    reads=(),
    coordinate="direction",
    needs=frozenset({Need.BOTH_DIRECTIONS, Need.SPEEDS}),
    rate=rate,
)
