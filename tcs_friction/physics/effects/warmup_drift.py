"""Friction that decays while the axis warms up, without a temperature signal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import (
    DRY_SCALE,
    TIME,
    VISCOUS_SCALE,
    Need,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
)


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    cold = math.exp(-motion[TIME] / parameters[2])
    motion[DRY_SCALE] *= 1.0 + parameters[0] * cold
    motion[VISCOUS_SCALE] *= 1.0 + parameters[1] * cold
    return 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"time_constant": tau} for tau in geometric(survey.duration / 30.0, survey.duration, 7)]


TERM = Term(
    id="warmup_drift",
    place=Place.SCALE,
    form="level (1 + dry exp(-t/time_constant)), viscous part (1 + viscous exp(-t/time_constant))",
    parameters=(
        Parameter(
            "dry",
            "",
            "relative excess of dry friction at the start",
            lower=-0.95,
            upper=20.0,
            default=0.0,
            role=Role.LINEAR,
        ),
        Parameter(
            "viscous",
            "",
            "relative excess of viscous friction at the start",
            lower=-0.95,
            upper=20.0,
            default=0.0,
            role=Role.LINEAR,
        ),
        Parameter("time_constant", "s", "time in which the excess falls to 1/e", lower=1e-9),
    ),
    kernel=scale,
    reads=(),
    coordinate="time",
    scan=scan,
    needs=frozenset({Need.DURATION}),
)
