"""Pattern search (Hooke and Jeeves 1961): downhill where a cost jumps, so that its derivatives lead nowhere.

In: a start, a cost, the neighbours of a point at a step. Out: a point that has no better neighbour at the last step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

Point = TypeVar("Point")


def go_downhill(
    start: Point,
    cost: Callable[[Point], float],
    neighbours: Callable[[Point, float], Iterable[Point]],
    step: float,
    rounds: int,
) -> Point:
    """Go to the best neighbour in each of `rounds`; the step, in the caller's units, is halved where none is better."""
    least = cost(start)
    for _ in range(rounds):
        tried = [(cost(point), point) for point in neighbours(start, step)]
        value, best = min(tried, key=lambda pair: pair[0], default=(least, start))
        if value < least:
            least, start = value, best
        else:
            step *= 0.5
    return start


def by_factors(values: Mapping[str, float], names: Sequence[str], step: float) -> list[dict[str, float]]:
    """The values with one of those named larger, then smaller, by a step of its logarithm."""
    return [{**values, name: values[name] * math.exp(way * step)} for name in names for way in (1, -1)]
