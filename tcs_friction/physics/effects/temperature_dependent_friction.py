"""Friction that follows the recorded temperature: the lubricant's viscosity, the preload."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import DRY, TEMPERATURE, VISCOUS, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    warmer = motion[TEMPERATURE] - parameters[2]
    return float(warmer * (parameters[0] * motion[DRY] + parameters[1] * motion[VISCOUS]))


TERM = Term(
    id="temperature_dependent_friction",
    place=Place.SCALE,
    form="x = (T - T0) (dry F + viscous F_viscous)",
    parameters=(
        Parameter("dry", "1/degC", "relative change of dry friction per degree", default=0.0, role=Role.LINEAR),
        Parameter("viscous", "1/degC", "relative change of viscous friction per degree", default=0.0, role=Role.LINEAR),
        Parameter("reference_temperature", "degC", "T0, where the law's values hold", default=20.0, role=Role.FIXED),
    ),
    kernel=torque,
    temperature=True,
    coordinate="temperature",
)
