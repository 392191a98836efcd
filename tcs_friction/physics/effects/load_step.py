"""A constant torque that appears (or, negative, vanishes) at a time: something was hung on, let go or jammed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.terms import TIME, Parameter, Place, Role, Survey, Term, kernel

BLURRED = 2.0  # periods of the cutoff, that the low pass spreads an event over


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(parameters[0]) if motion[TIME] >= parameters[1] else 0.0


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"time": survey.start + survey.duration * (i + 1) / 31} for i in range(30)]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """What begins while the axis turns back is friction before it is an event, unless it slides both ways before and after it.

    A turn lasts until friction is built up the other way; as much again on either side belongs to it, and what the filter blurs.
    A torque keeps its sign when the axis turns back once more, friction does not.
    """
    time, blur = values["time"], BLURRED / survey.cutoff
    turns = [(2.0 * begin - end - blur, 2.0 * end - begin + blur) for begin, end in survey.turns(survey.bristle)]
    at = [k for k, (begin, end) in enumerate(turns) if begin < time < end]
    if not at:
        return ""
    begins, ends = [begin for begin, _ in turns], [end for _, end in turns]
    legs = zip([survey.start, *ends], [*begins, survey.start + survey.duration], strict=True)
    slides = [begin < end for begin, end in legs]  # one way and the other in turn

    def both_ways(some: Sequence[bool]) -> bool:
        return any(some[::2]) and any(some[1::2])

    told = both_ways(slides[: at[0] + 1]) and both_ways(slides[at[-1] + 1 :])
    return "" if told else "the axis turns back at that time"


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
    uncancelled="it was an event of the recording",
    coordinate="time",
    subsystem="environment",
    scan=scan,
    implausible=implausible,
    discontinuous=True,
    extent=extent,
)
