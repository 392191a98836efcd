"""Coupling from another axis: torque in proportion to its acceleration, from its recorded velocity.

What is in proportion to the velocity or the position itself, as the weight of the next link over a short travel, is `exogenous`.
"""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.effects.wind_torque import names_wind
from tcs_friction.physics.terms import Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """The signal's rate stands behind its value, both of the same instant: a difference to the instant before would be late."""
    return float(parameters[0] * motion[int(parameters[1]) + 1])


def may_be_a_velocity(name: str) -> bool:
    """Whether a recorded signal of this name may be another axis' velocity: anything but a wind or a position."""
    return not names_wind(name) and not name.endswith("_position")


TERM = Term(
    id="cross_axis_coupling",
    place=Place.OPPOSING,
    form="x = inertia d(other axis' velocity)/dt",
    parameters=(Parameter("inertia", "kg m^2", "coupling inertia", role=Role.LINEAR),),
    kernel=torque,
    reads=(),
    signals=1,
    coordinate="exogenous",
    subsystem="environment",
    suits=may_be_a_velocity,
)
