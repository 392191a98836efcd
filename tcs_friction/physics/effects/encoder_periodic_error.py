"""Encoder error that repeats over the turn: eccentric scale, interpolation error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tcs_friction.physics.terms import CYCLE, POSITION, Parameter, Place, Role, Term, kernel, resolved


@kernel
def error(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    if not resolved(motion, parameters[0]):
        return 0.0
    return float(parameters[1] * math.sin(parameters[0] * motion[CYCLE] * motion[POSITION] + parameters[2]))


def warnings(values: Mapping[str, float]) -> list[str]:
    """An encoder whose error grows as fast as the position would count backwards."""
    slope = values["order"] * abs(values["amplitude"])
    return [f"the encoder would count backwards: order times amplitude is {slope:.3g}"] if slope >= 1.0 else []


TERM = Term(
    id="encoder_periodic_error",
    place=Place.SENSOR,
    form="measured q = q + amplitude sin(order q + phase)",
    parameters=(
        Parameter("order", "1/turn", "periods per turn (per metre if linear)", lower=1e-6),
        Parameter("amplitude", "rad", "amplitude of the error", role=Role.LINEAR),
        Parameter("phase", "rad", "phase of the error", default=0.0, role=Role.PHASE),
    ),
    kernel=error,
    reads=(),
    coordinate="position",
    subsystem="sensor",
    periodic="position",
    whole=True,
    warn=warnings,
)
