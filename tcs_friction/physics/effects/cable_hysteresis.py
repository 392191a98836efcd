"""Cable hysteresis: cables and hoses that drag along and slip, a Dahl element far wider than the bearing's bristles.

ds/dq = (1 - s sign(v))^exponent / width,   x = amplitude s

A hose of many strands slips little by little: exponent 1. One cable that sticks until it slips is a spring that gives way (a
Jenkins element): exponent 0. Source: Dahl, A solid friction model, Aerospace Corporation TOR-0158 (1968).
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

WIDE = 5.0  # bristle deflections: what turns over in less is the bearing's own pre-sliding
UNKNOWN_BRISTLE = 1e-3  # rad, where no law says: rolling friction builds up within 0.1 mm (Futami, Furutani & Yoshida 1990)
HALFWAY = 0.5  # exponent, where a search starts
ALMOST_ONE = 1e-6  # distance of an exponent from one, below which it is one
TWICE = 2.0  # a cable has to drag along and slip within the travel to be told from a spring


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: s, -1 to 1; the step is exact in travel."""
    travel = motion[TRAVEL]
    if travel != 0.0:
        steady = 1.0 if travel > 0.0 else -1.0
        left, passed, rest = 1.0 - state[0] * steady, abs(travel) / parameters[1], 1.0 - parameters[2]
        if rest < ALMOST_ONE:
            left *= math.exp(-passed)
        else:
            left = max(left**rest - rest * passed, 0.0) ** (1.0 / rest)
        state[0] = steady * (1.0 - left)
    return float(parameters[0] * state[0])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Widths from well above the bristles' to a third of the travel."""
    lowest = max(narrowest(survey), 1e-3 * survey.span)
    if TWICE * lowest > survey.span:
        return []
    widths = geometric(lowest, max(0.3 * survey.span, 2.0 * lowest), 8)
    return [{"width": width, "exponent": HALFWAY} for width in widths]


def narrowest(survey: Survey) -> float:
    """The least width (rad) that is no bristle's."""
    return WIDE * (survey.bristle if survey.bristle > 0.0 else UNKNOWN_BRISTLE)


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    if values["amplitude"] < 0.0:
        return "it would push where it ought to drag"
    if values["width"] < narrowest(survey):
        return "it turns over within the travel of a bristle"
    return "it does not turn over within the travel" if TWICE * values["width"] > survey.span else ""


def rate(values: Mapping[str, float], inertia: float) -> float:
    return spring_rate(abs(values["amplitude"]) / values["width"], 0.0, inertia)


TERM = Term(
    id="cable_hysteresis",
    place=Place.OPPOSING,
    form="x = amplitude s, ds/dq = (1 - s sign(v))^exponent/width",
    parameters=(
        Parameter("amplitude", "N m", "torque far from a reversal", role=Role.LINEAR),
        Parameter("width", "rad", "travel over which the torque turns over", lower=1e-12),
        Parameter("exponent", "", "1: slips little by little, 0: all at once", lower=0.0, upper=1.0, default=1.0),
    ),
    kernel=torque,
    reads=(),
    states=1,
    coordinate="time_since_reversal",
    subsystem="cable",
    scan=scan,
    implausible=implausible,
    needs=frozenset({Need.BOTH_DIRECTIONS, Need.REVERSALS}),
    rate=rate,
)
