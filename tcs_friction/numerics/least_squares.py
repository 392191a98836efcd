"""Levenberg-Marquardt for costs that are least squares and something more.

Near a point x the cost is taken to be a quadratic function of a step s,

    c(x + s) = c(x) + g's + s'N s / 2,

with the gradient g (p,) and the Gauss-Newton normal matrix N (p, p). The step solves

    (N + damping D) s = -g,      D = diag(N)

for the numbers that may move (Marquardt, J. SIAM 11 (1963) 431: D makes the step independent of units). A step that does not
lower the cost is taken again with more damping; one that does lets the next be damped less.

The solver sees a point only through an `Objective`. Bounds, numbers that move by factors, priors, robust weights and terms
that are no squares are therefore the caller's, and a point may be of any type.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tcs_friction.numerics.outcome import Outcome

Array = NDArray[np.float64]
Point = TypeVar("Point")

SMALLEST = 1e-300  # curvature, so that nothing is divided by zero
RANK = 1e-13  # of the largest singular value of the damped and scaled normal matrix; smaller ones are rounding errors


class Objective(Protocol[Point]):
    """What is minimised, at points of any type; p numbers of it may change.

    `quadratic` is always called before `cost` is called at steps from a point. `cost` may therefore use the weights that
    `quadratic` found there.
    """

    def quadratic(self, point: Point, renew: bool) -> tuple[float, Array, Array]:
        """Cost, gradient (p,) and normal matrix (p, p). Unless `renew`, the derivatives from before may serve once more."""

    def cost(self, point: Point) -> float:
        """The cost alone."""

    def moved(self, point: Point, step: Array) -> Point:
        """The point after a step (p,), kept within its bounds."""

    def blocked(self, point: Point, gradient: Array) -> NDArray[np.bool_]:
        """(p,) Which numbers stay: those that are held, and those at a bound that going downhill would leave."""


@dataclass(frozen=True)
class Schedule:
    """How a step is damped, relative to the curvature. The defaults are those of an identification.

    start: damping at first; ease: divides it after a step that lowers the cost, down to `least`; tighten: multiplies it after one
    that does not, at most `attempts` times for one step. floor: least curvature that counts in D, relative to the largest.
    """

    start: float = 1e-3
    ease: float = 9.0
    tighten: float = 4.0
    least: float = 1e-12
    attempts: int = 12
    floor: float = 0.0


@dataclass(frozen=True, eq=False)
class Minimum(Generic[Point]):
    """Where a search ended and how.

    gradient (p,), normal (p, p): the last derivatives, at `point` or at the last point but one. steps: taken, each to a lower or
    equal cost. `point` is the start if there is none.
    """

    point: Point
    cost: float
    gradient: Array
    normal: Array
    outcome: Outcome
    steps: int


def minimise(
    objective: Objective[Point],
    start: Point,
    *,
    iterations: int,
    relative: float = 0.0,
    absolute: float = 0.0,
    longest: Array | float = np.inf,
    reuse: float = 0.0,
    schedule: Schedule = Schedule(),
    cancel: Callable[[], bool] = lambda: False,
) -> Minimum[Point]:
    """Go downhill from `start` until a step gains too little.

    Parameters
    ----------
    iterations: steps at most.
    relative, absolute: a step whose gain is no more than relative * |cost| or than absolute is the last one.
    longest: (p,) or one for all; no number moves farther in one step.
    reuse: the derivatives serve for the next step, too, after one whose gain they foretold up to this share; 0: never. Where they
        then lead no farther they are taken anew.
    cancel: asked before every step.

    A cost or a derivative that is not finite at the start, or where a step led, ends the search with Outcome.UNDEFINED. A step
    to a cost that is not finite is not taken. STAGNATED: the derivatives promise a gain that no step brings.
    """
    point, damping, renew, steps = start, schedule.start, True, 0
    cost, gradient, normal = np.nan, np.zeros(0), np.zeros((0, 0))
    outcome = Outcome.BUDGET_SPENT
    for _ in range(iterations):
        if cancel():
            outcome = Outcome.CANCELLED
            break
        cost, gradient, normal = objective.quadratic(point, renew)
        if not (np.isfinite(cost) and np.isfinite(gradient).all() and np.isfinite(normal).all()):
            outcome = Outcome.UNDEFINED
            break
        enough = max(absolute, relative * abs(cost))
        moving = ~objective.blocked(point, gradient) & (np.diag(normal) > 0.0)
        promised, taken, before = 0.0, False, damping
        for attempt in range(schedule.attempts):
            step = np.clip(_step(gradient, normal, moving, damping, schedule.floor), -longest, longest)
            foretold = -float(step @ (gradient + 0.5 * normal @ step))
            promised = foretold if attempt == 0 else promised
            trial = objective.moved(point, step)
            reached = objective.cost(trial)
            if np.isfinite(reached) and reached <= cost:
                taken = True
                break
            damping *= schedule.tighten
        if not taken and promised > enough and not renew:  # the derivatives were those of another point
            renew, damping = True, before
            continue
        if not taken:
            outcome = Outcome.CONVERGED if promised <= enough else Outcome.STAGNATED
            break
        damping = max(damping / schedule.ease, schedule.least)
        gain, point, cost, steps = cost - reached, trial, reached, steps + 1
        if gain <= enough and (renew or foretold <= enough):
            outcome = Outcome.CONVERGED
            break
        renew = not abs(gain - foretold) < reuse * foretold
    return Minimum(point, cost, gradient, normal, outcome, steps)


def _step(gradient: Array, normal: Array, moving: NDArray[np.bool_], damping: float, floor: float) -> Array:
    """(p,) The damped step, zero where nothing moves."""
    step = np.zeros(len(gradient))
    index = np.flatnonzero(moving)
    if len(index):
        least = max(floor * float(np.diag(normal).max()), SMALLEST)
        size = np.sqrt(np.maximum(np.diag(normal)[index], least))
        damped = normal[np.ix_(index, index)] / np.outer(size, size) + damping * np.eye(len(index))
        step[index] = np.linalg.lstsq(damped, -gradient[index] / size, rcond=RANK)[0] / size
    return step
