"""Dry friction that differs by direction: a loaded seal, a worm's flank."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import DRY_SCALE, VELOCITY, Need, Parameter, Place, Role, Term, kernel


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    motion[DRY_SCALE] *= 1.0 + parameters[0] if motion[VELOCITY] >= 0.0 else 1.0 - parameters[0]
    return 0.0


TERM = Term(
    id="coulomb_asymmetry",
    place=Place.SCALE,
    form="level (1 + asymmetry sign(v)); sliding, x = asymmetry |F|",
    parameters=(
        Parameter(
            "asymmetry", "", "half the difference over the mean", lower=-0.95, upper=0.95, role=Role.LINEAR
        ),
    ),
    kernel=scale,
    reads=(),
    coordinate="direction",
    needs=frozenset({Need.MOTION, Need.BOTH_DIRECTIONS}),
)
