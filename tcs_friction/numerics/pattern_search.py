"""Pattern search (Hooke and Jeeves 1961): downhill where a cost jumps, so that its derivatives lead nowhere.

In: a start, a cost, the neighbours of a point at a step. Out: a point that has no better neighbour at the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

Point = TypeVar("Point")


def pattern_search(
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
