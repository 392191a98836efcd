"""Cable hysteresis: cables and hoses that drag along and slip, a Dahl element far wider than the bearing's bristles.

ds/dq = (1 - s sign(v)) / width,   x = amplitude s
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import (
    TRAVEL,
    Need,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
    spring_rate,
)


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: s, -1 to 1; the step is exact in travel."""
    travel = motion[TRAVEL]
    if travel != 0.0:
        steady = 1.0 if travel > 0.0 else -1.0
        state[0] = steady + (state[0] - steady) * math.exp(-abs(travel) / parameters[1])
    return float(parameters[0] * state[0])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Widths from well above the bristles' to a third of the travel."""
    lowest = max(5.0 * survey.bristle, 1e-3 * survey.span)
    return [{"width": width} for width in geometric(lowest, max(0.3 * survey.span, 2.0 * lowest), 8)]


def rate(values: Mapping[str, float], inertia: float) -> float:
    return spring_rate(abs(values["amplitude"]) / values["width"], 0.0, inertia)


TERM = Term(
    id="cable_hysteresis",
    place=Place.OPPOSING,
    form="x = amplitude s, ds/dq = (1 - s sign(v))/width",
    parameters=(
        Parameter("amplitude", "N m", "torque far from a reversal", role=Role.LINEAR),
        Parameter("width", "rad", "travel over which the torque turns over", lower=1e-12),
    ),
    kernel=torque,
    reads=(),
    states=1,
    coordinate="time_since_reversal",
    subsystem="cable",
    scan=scan,
    needs=frozenset({Need.BOTH_DIRECTIONS, Need.REVERSALS}),
    rate=rate,
)
