"""The local end of an identification: least squares of errors within bounds, all of them alike or outliers less.

cost = sum of w (y - f(x))^2 / 2, with weights w (m,) that follow from the errors by iteratively reweighted least squares where
outliers shall count less (Huber, Robust Statistics, 1981, section 7.8).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tcs_friction.numerics.least_squares import minimise
from tcs_friction.numerics.outcome import Outcome

HUBER = 1.345  # in robust standard deviations: 95 % efficient on Gaussian errors (Huber 1981)
LONGEST = 1.5  # step of a logarithm: a factor of 4.5, so that a model that is not linear there does not run away

Linearised = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
Evaluated = Callable[[np.ndarray], np.ndarray]


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
    """Minimise half the weighted sum of squared (or Huber) errors from `start` (p,)."""
    errors = _Errors(linearised, evaluated, target, weights, space, loss)
    found = minimise(
        errors, np.clip(start, space.lower, space.upper), iterations=iterations, relative=tolerance,
        longest=np.where(space.logarithmic, LONGEST, np.inf), cancel=cancel,
    )  # fmt: skip
    cost = errors.linearise(found.point)
    return Refined(
        found.point, errors.residual, errors.jacobian, errors.emphasis, cost, found.outcome, errors.evaluations
    )


class _Errors:
    """Errors of a model as the solver's objective. A step of a logarithmic unknown is the logarithm of its factor."""

    def __init__(
        self,
        linearised: Linearised,
        evaluated: Evaluated,
        target: np.ndarray,
        weights: np.ndarray,
        space: Space,
        loss: str,
    ) -> None:
        self._linearised, self._evaluated = linearised, evaluated
        self._target, self._weights, self._space, self._loss = target, weights, space, loss
        self._at: np.ndarray | None = None  # the unknowns of the following
        self.residual, self.jacobian, self.emphasis = target, np.zeros((0, 0)), weights
        self.evaluations = 0

    def linearise(self, unknowns: np.ndarray) -> float:
        """Residual, jacobian and weights at these unknowns, and the cost there."""
        if self._at is None or not np.array_equal(self._at, unknowns):
            modelled, self.jacobian = self._linearised(unknowns)
            self.evaluations += 1
            self.residual = self._target - modelled
            self.emphasis = loss_weights(self.residual, self._weights, self._loss)
            self._at = unknowns.copy()
        return 0.5 * float(self.emphasis @ self.residual**2)

    def quadratic(self, point: np.ndarray, renew: bool) -> tuple[float, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Cost, gradient and normal matrix by the steps of `moved`."""
        cost = self.linearise(point)
        slopes = self.jacobian * np.where(self._space.logarithmic, point, 1.0)
        return cost, -(slopes.T @ (self.emphasis * self.residual)), slopes.T @ (self.emphasis[:, None] * slopes)

    def cost(self, point: np.ndarray) -> float:
        """Under the weights of the last `quadratic`."""
        self.evaluations += 1
        return 0.5 * float(self.emphasis @ (self._target - self._evaluated(point)) ** 2)

    def moved(self, point: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Within bounds."""
        space = self._space
        factor = np.exp(np.where(space.logarithmic, step, 0.0))
        return np.clip(np.where(space.logarithmic, point * factor, point + step), space.lower, space.upper)

    def blocked(self, point: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """What is held or would leave its bounds."""
        space = self._space
        below, above = (point <= space.lower) & (gradient > 0.0), (point >= space.upper) & (gradient < 0.0)
        return np.asarray(~space.free | below | above)
