"""Dry friction that is raised in one place: a dent, a stain of rust, a joint of the rail."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import (
    DRY_SCALE,
    POSITION,
    Local,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
)

WIDEST = 1.0 / 6.0  # of the travel: what is wider is friction that depends on the position all over


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    distance = (motion[POSITION] - parameters[1]) / parameters[2]
    motion[DRY_SCALE] *= 1.0 + parameters[0] * math.exp(-distance * distance)
    return 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Six widths; where, a matched filter over the position finds (`local`)."""
    widths = geometric(survey.span / 300.0, WIDEST * survey.span, 6)
    return [{"centre": survey.travel[0], "width": width} for width in widths]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    return "it is not in one place of the travel" if values["width"] > WIDEST * survey.span else ""


TERM = Term(
    id="local_friction_bump",
    place=Place.SCALE,
    form="level (1 + amplitude exp(-((q - centre)/width)^2))",
    parameters=(
        Parameter(
            "amplitude", "", "relative rise of the dry friction", lower=-0.95, upper=20.0, role=Role.LINEAR
        ),
        Parameter("centre", "rad", "where"),
        Parameter("width", "rad", "how wide, 1/e half width", lower=1e-12),
    ),
    kernel=scale,
    reads=(),
    coordinate="position",
    scan=scan,
    implausible=implausible,
    local=Local(),
)
