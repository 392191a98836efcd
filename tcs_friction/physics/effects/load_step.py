"""A constant torque that appears (or, negative, vanishes) at a time: something was hung on, let go or jammed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import TIME, Parameter, Place, Role, Survey, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0]) if motion[TIME] >= parameters[1] else 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"time": survey.start + survey.duration * (i + 1) / 31} for i in range(30)]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """A torque keeps its sign when the axis turns back, friction does not: both ways have to be seen before and after."""
    time = values["time"]
    between = any(end <= time for _, end in survey.turns) and any(begin >= time for begin, _ in survey.turns)
    return "" if between else "the axis does not turn back both before and after it"


def extent(values: Mapping[str, float]) -> tuple[float, float | None]:
    return values["time"], None


TERM = Term(
    id="load_step",
    place=Place.OPPOSING,
    form="x = step for t >= time",
    parameters=(
        Parameter("step", "N m", "torque that appears", role=Role.LINEAR),
        Parameter("time", "s", "since the start of the recording"),
    ),
    kernel=torque,
    reads=(),
    coordinate="time",
    subsystem="environment",
    scan=scan,
    implausible=implausible,
    discontinuous=True,
    extent=extent,
)
