"""Whether a search ended at a minimum of the cost. Only there do the data say how sure the values are.

A swarm has no derivatives and ends when it gains no more, or when its evaluations are spent; neither makes its end a minimum.
From there a few steps of least squares lower the cost by D, to C. With residuals that are worth n independent samples, 2 C / n is
the variance of one, and the cost at one standard error from the minimum is higher by half of that, C / n. So the end is
sqrt(D n / C) standard errors away from the minimum. Beyond one it is none: an interval around it would be off by as much as it is
wide. Nearer, the way to the minimum is added to what the values are unsure by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcs_friction.identify.conclusions import refit
from tcs_friction.identify.problem import Problem
from tcs_friction.identify.refine import Refined, Space
from tcs_friction.identify.uncertainty import independent_samples
from tcs_friction.identify.words import not_searched
from tcs_friction.numerics.outcome import Outcome

STEPS = 8  # of least squares at most: more than one standard error is there to be gained in the first few, or not at all
FARTHEST = 1.0  # standard errors
NO_MINIMUM = "the search did not end at a minimum"
ENDS = {Outcome.STAGNATED: "it stagnated", Outcome.BUDGET_SPENT: "its evaluations were spent"}


@dataclass(frozen=True, eq=False)
class End:
    """Where a search ended: whether that is a minimum, how it ended, and what to say of it.

    way (p,): how far the unknowns are from the minimum, where they are near one.
    """

    minimum: bool
    outcome: Outcome
    way: np.ndarray | None
    notes: tuple[str, ...] = ()


def end_of_search(problem: Problem, fit: Refined, space: Space, loss: str, outcome: Outcome) -> End:
    """Judge the end `fit` of a search that ended with `outcome`. space: everything that may move."""
    if outcome is Outcome.CANCELLED:
        return End(False, outcome, None, (f"{NO_MINIMUM} of the cost, since it was cancelled: no value has an interval",))
    near = refit(problem, fit.unknowns, space, loss, STEPS)
    away = standard_errors_away(fit.residual, near.residual, near.weights)
    if away <= FARTHEST:
        converged = Outcome.CONVERGED if outcome in ENDS else outcome
        return End(True, converged, near.unknowns - fit.unknowns, not_searched(problem.axis))
    why = ENDS.get(outcome, outcome.value)
    far = f"{away:.3g} standard errors from one" if math.isfinite(away) else "of a cost that can be nothing"
    words = f"{NO_MINIMUM} of the cost ({why}, {far}): no value has an interval; --refine finishes the search"
    return End(False, outcome, None, (*not_searched(problem.axis), words))


def standard_errors_away(residual: np.ndarray, least: np.ndarray, weights: np.ndarray) -> float:
    """By how many standard errors the fit that leaves `residual` (m,) is away from the one that leaves `least` (m,)."""
    cost, lowest = (0.5 * float(weights @ left**2) for left in (residual, least))
    if not cost > lowest:
        return 0.0
    if not lowest > 0.0:
        return math.inf
    return math.sqrt((cost - lowest) / lowest * independent_samples(least[weights > 0.0]))
