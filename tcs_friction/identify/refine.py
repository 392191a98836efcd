"""Levenberg-Marquardt with bounds, robust loss and exact derivatives: the local end of an identification."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

HUBER = 1.345  # in robust standard deviations: 95 % efficient on Gaussian errors (Huber 1981)

Linearised = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
Evaluated = Callable[[np.ndarray], np.ndarray]


class Outcome(enum.Enum):
    """How a search ended. A numerical outcome is data, not an error."""

    CONVERGED = "converged"
    STAGNATED = "stagnated"
    BUDGET_SPENT = "budget spent"
    CANCELLED = "cancelled"
    TOLERANCE = "cost tolerance reached"


@dataclass(frozen=True, eq=False)
class Refined:
    """unknowns (p,), residual (m,) measured minus modelled, jacobian (m, p) of the model, weights (m,) of the loss."""

    unknowns: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    weights: np.ndarray
    cost: float
    outcome: Outcome
    evaluations: int


@dataclass(frozen=True, eq=False)
class Space:
    """Where the unknowns may go. lower, upper (p,); logarithmic (p,) unknowns move by factors; free (p,) ones move at all."""

    lower: np.ndarray
    upper: np.ndarray
    logarithmic: np.ndarray
    free: np.ndarray

    def holding(self, held: np.ndarray) -> Space:
        """The same space with some unknowns (p,) held."""
        return Space(self.lower, self.upper, self.logarithmic, self.free & ~held)

    def first(self, count: int) -> Space:
        """The space of the first so many unknowns."""
        return Space(self.lower[:count], self.upper[:count], self.logarithmic[:count], self.free[:count])


def robust_scale(residual: np.ndarray, weights: np.ndarray) -> float:
    """Standard deviation that a few outliers do not move."""
    counted = residual[weights > 0.0]
    return float(np.median(np.abs(counted - np.median(counted))) / 0.6745) if len(counted) else 0.0


def loss_weights(residual: np.ndarray, weights: np.ndarray, loss: str) -> np.ndarray:
    """Weights (m,) of iteratively reweighted least squares: all equal for `squares`, Huber's for `huber`."""
    if loss == "squares":
        return weights
    scale = max(robust_scale(residual, weights), 1e-300)
    return weights * np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))


def refine(
    linearised: Linearised,
    evaluated: Evaluated,
    target: np.ndarray,
    weights: np.ndarray,
    start: np.ndarray,
    space: Space,
    loss: str = "squares",
    iterations: int = 60,
    tolerance: float = 1e-10,
    cancel: Callable[[], bool] = lambda: False,
) -> Refined:
    """Minimise half the weighted sum of squared (or Huber) errors from `start` (p,).

    Steps are damped (Marquardt 1963: scaled by the diagonal); an unknown at a bound that would leave it is taken out of
    the step.
    """
    unknowns = np.clip(start, space.lower, space.upper)
    damping, evaluations, outcome = 1e-3, 1, Outcome.BUDGET_SPENT
    modelled, jacobian = linearised(unknowns)
    residual = target - modelled
    emphasis = loss_weights(residual, weights, loss)
    cost = 0.5 * float(emphasis @ residual**2)
    for _ in range(iterations):
        if cancel():
            outcome = Outcome.CANCELLED
            break
        better = None
        for _ in range(12):
            trial = _step(unknowns, residual, jacobian, emphasis, space, damping)
            tried = target - evaluated(trial)
            evaluations += 1
            new_cost = 0.5 * float(emphasis @ tried**2)
            if new_cost <= cost and np.isfinite(new_cost):
                better = (trial, new_cost)
                damping = max(damping / 9.0, 1e-12)
                break
            damping *= 4.0
        if better is None:
            outcome = Outcome.CONVERGED
            break
        gain = (cost - better[1]) / max(cost, 1e-300)
        unknowns = better[0]
        modelled, jacobian = linearised(unknowns)
        residual = target - modelled
        evaluations += 1
        emphasis = loss_weights(residual, weights, loss)
        cost = 0.5 * float(emphasis @ residual**2)
        if gain < tolerance:
            outcome = Outcome.CONVERGED
            break
    return Refined(unknowns, residual, jacobian, emphasis, cost, outcome, evaluations)


def _step(
    unknowns: np.ndarray,
    residual: np.ndarray,
    jacobian: np.ndarray,
    emphasis: np.ndarray,
    space: Space,
    damping: float,
) -> np.ndarray:
    scale = np.where(space.logarithmic, unknowns, 1.0)
    slopes = jacobian * scale
    gradient = slopes.T @ (emphasis * residual)
    moving = space.free & (np.abs(slopes).max(axis=0, initial=0.0) > 0.0)
    moving &= ~((unknowns <= space.lower) & (gradient < 0.0)) & ~(
        (unknowns >= space.upper) & (gradient > 0.0)
    )
    index = np.flatnonzero(moving)
    trial = unknowns.copy()
    if not len(index):
        return trial
    chosen = slopes[:, index]
    normal = chosen.T @ (emphasis[:, None] * chosen)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    step = (
        np.linalg.lstsq(scaled + damping * np.eye(len(index)), gradient[index] / size, rcond=1e-13)[0] / size
    )
    logarithmic = space.logarithmic[index]
    trial[index] = np.where(
        logarithmic, unknowns[index] * np.exp(np.clip(step, -1.5, 1.5)), unknowns[index] + step
    )
    return np.clip(trial, space.lower, space.upper)
