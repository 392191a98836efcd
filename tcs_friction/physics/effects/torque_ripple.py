"""Torque ripple: the motor gives a little more or less of the commanded torque, locked to position."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.physics.terms import CYCLE, POSITION, TORQUE, Parameter, Place, Role, Term, kernel, resolved


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    if not resolved(motion, parameters[0]):
        return float(motion[TORQUE])
    angle = parameters[0] * motion[CYCLE] * motion[POSITION] + parameters[2]
    return float(motion[TORQUE] * (1.0 + parameters[1] * math.cos(angle)))


SMALLEST_GAIN = 0.1  # that is divided by: a drive that gives less there cannot be made up for


@kernel
def inverse(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """The gain is divided out."""
    wave = parameters[1] * math.cos(parameters[0] * motion[CYCLE] * motion[POSITION] + parameters[2])
    return float(motion[TORQUE] / max(1.0 + wave, SMALLEST_GAIN))


TERM = Term(
    id="torque_ripple",
    place=Place.DRIVE,
    form="u (1 + amplitude cos(order q + phase))",
    parameters=(
        Parameter("order", "1/turn", "periods per turn (per metre if linear)", lower=1e-6),
        Parameter("amplitude", "", "relative ripple", role=Role.LINEAR),
        Parameter("phase", "rad", "phase of the ripple", default=0.0, role=Role.PHASE),
    ),
    kernel=torque,
    inverse=inverse,
    reads=("torque",),
    coordinate="position",
    subsystem="actuator",
    periodic="position",
    whole=True,
)
