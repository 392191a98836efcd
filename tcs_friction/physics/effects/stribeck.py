"""Stribeck drop for a law without one: friction at rest exceeds that of sliding, over a small velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import (
    EXTRA_LEVEL,
    VELOCITY,
    Feature,
    Need,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
)

LARGEST_DROP = 4.0  # of Coulomb friction
FASTEST_DROP = 0.3  # of the fastest speed, over which friction may fall: what still bends at half that speed is viscous friction


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    ratio = motion[VELOCITY] / parameters[1]
    motion[EXTRA_LEVEL] += parameters[0] * math.exp(-ratio * ratio)
    return 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [
        {"stribeck_velocity": v}
        for v in geometric(max(survey.slow, 1e-4 * survey.fast), FASTEST_DROP * survey.fast, 8)
    ]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """Static friction is up to some two times Coulomb friction (Armstrong-Helouvry et al. 1994); far more is something else.

    So is a drop over all speeds of the recording: drag that grows less than in proportion to the speed looks like it.
    """
    if values["drop"] > LARGEST_DROP * survey.level:
        return "friction at rest is not so much more than in sliding"
    if values.get("stribeck_velocity", 0.0) > FASTEST_DROP * survey.fast:
        return "the drop is not over at the speeds of the recording"
    return ""


def of_law(values: Mapping[str, float]) -> Mapping[str, float]:
    drop = max(values["static"] - values["coulomb"], 0.0)
    return {"drop": drop} | {name: values[name] for name in ("stribeck_velocity",) if name in values}


TERM = Term(
    id="stribeck",
    place=Place.SCALE,
    form="level + drop exp(-(v/stribeck_velocity)^2)",
    parameters=(
        Parameter(
            "drop", "N m", "static minus coulomb", lower=0.0, role=Role.LINEAR, feature=Feature.STRIBECK
        ),
        Parameter(
            "stribeck_velocity",
            "rad/s",
            "velocity over which static falls to coulomb",
            lower=1e-12,
            feature=Feature.STRIBECK,
            stated=False,
        ),
    ),
    kernel=scale,
    reads=(),
    coordinate="velocity",
    scan=scan,
    of_law=of_law,
    implausible=implausible,
    needs=frozenset({Need.SPEEDS}),
)
