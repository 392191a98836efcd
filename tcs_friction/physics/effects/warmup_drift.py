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

RISING = -0.1  # of what falls: friction that rises by more while the axis warms up is no warm-up
SLOW = 2.0  # periods of the motion, so that friction is seen at the same places and speeds while it falls


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    cold = math.exp(-motion[TIME] / parameters[2])
    motion[DRY_SCALE] *= 1.0 + parameters[0] * cold
    motion[VISCOUS_SCALE] *= 1.0 + parameters[1] * cold
    return 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    fastest = max(survey.duration / 30.0, SLOW * survey.period)
    if fastest > survey.duration:
        return []
    return [{"time_constant": tau} for tau in geometric(fastest, survey.duration, 7)]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    if values["time_constant"] < SLOW * survey.period:
        return "it is fast against the motion"
    rising, falling = sorted((values["dry"], values["viscous"]))
    return "friction rises while the axis warms up" if rising < RISING * max(falling, 0.0) else ""


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
    uncancelled="it began with the recording",
    coordinate="time",
    scan=scan,
    implausible=implausible,
    needs=frozenset({Need.DURATION}),
)
