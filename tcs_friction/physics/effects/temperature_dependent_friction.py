"""Friction that follows the recorded temperature: the lubricant's viscosity, the preload."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import (
    DRY_SCALE,
    TEMPERATURE,
    VISCOUS_SCALE,
    Need,
    Parameter,
    Place,
    Role,
    Term,
    kernel,
)


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    warmer = motion[TEMPERATURE] - parameters[2]
    motion[DRY_SCALE] *= 1.0 + parameters[0] * warmer
    motion[VISCOUS_SCALE] *= 1.0 + parameters[1] * warmer
    return 0.0


TERM = Term(
    id="temperature_dependent_friction",
    place=Place.SCALE,
    form="level (1 + dry (T - T0)), viscous part (1 + viscous (T - T0))",
    parameters=(
        Parameter(
            "dry", "1/degC", "relative change of dry friction per degree", default=0.0, role=Role.LINEAR
        ),
        Parameter(
            "viscous",
            "1/degC",
            "relative change of viscous friction per degree",
            default=0.0,
            role=Role.LINEAR,
        ),
        Parameter(
            "reference_temperature", "degC", "T0, where the law's values hold", default=20.0, role=Role.FIXED
        ),
    ),
    kernel=scale,
    reads=(),
    temperature=True,
    coordinate="temperature",
    needs=frozenset({Need.DURATION}),
)
