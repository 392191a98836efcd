"""A periodic torque from outside: a pump, a fan, mains hum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tcs_friction.physics.terms import TIME, Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[1] * math.sin(2.0 * math.pi * parameters[0] * motion[TIME] + parameters[2]))


def rate(values: Mapping[str, float], inertia: float) -> float:
    return 2.0 * math.pi * values["frequency"]


TERM = Term(
    id="periodic_vibration",
    place=Place.OPPOSING,
    form="x = amplitude sin(2 pi frequency t + phase)",
    parameters=(
        Parameter("frequency", "Hz", "of the vibration", lower=1e-9),
        Parameter("amplitude", "N m", "of the torque", role=Role.LINEAR),
        Parameter("phase", "rad", "at the start of the recording", default=0.0, role=Role.PHASE),
    ),
    kernel=torque,
    reads=(),
    uncancelled="its phase is that of the recording's clock",
    coordinate="frequency",
    subsystem="environment",
    periodic="time",
    rate=rate,
)
