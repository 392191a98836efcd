"""The solver finds known minima, keeps to bounds, and says how it ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tcs_friction.numerics.least_squares import Minimum, Schedule, minimise
from tcs_friction.numerics.outcome import Outcome

Residual = Callable[[np.ndarray], np.ndarray]
T = np.linspace(0.0, 2.0, 60)


@dataclass
class Curve:
    """Half the squares of a residual with derivatives by central differences; numbers within bounds, some of them held."""

    residual: Residual
    lower: float = -np.inf
    upper: float = np.inf
    held: tuple[int, ...] = ()
    unit: float | np.ndarray = 1.0  # of the numbers
    extra: Callable[[np.ndarray], float] = lambda _: 0.0  # beside the squares
    linearised: int = 0
    tried: list[np.ndarray] = field(default_factory=list)
    jacobian: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def quadratic(self, point: np.ndarray, renew: bool) -> tuple[float, np.ndarray, np.ndarray]:
        sizes = 1e-6 * self.unit * np.ones(len(point))
        steps = np.diag(sizes)
        if renew:
            self.linearised += 1
            columns = [self.residual(point + s) - self.residual(point - s) for s in steps]
            self.jacobian = np.stack(columns, axis=1) / (2.0 * sizes)
        slope = np.array([self.extra(point + s) - self.extra(point - s) for s in steps]) / (2.0 * sizes)
        gradient = self.jacobian.T @ self.residual(point) + slope
        return self.value(point), gradient, self.jacobian.T @ self.jacobian

    def value(self, point: np.ndarray) -> float:
        return 0.5 * float(self.residual(point) @ self.residual(point)) + self.extra(point)

    def cost(self, point: np.ndarray) -> float:
        self.tried.append(point)
        return self.value(point)

    def moved(self, point: np.ndarray, step: np.ndarray) -> np.ndarray:
        return np.clip(point + step, self.lower, self.upper)

    def blocked(self, point: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        at_bound = ((point <= self.lower) & (gradient > 0.0)) | ((point >= self.upper) & (gradient < 0.0))
        return at_bound | np.isin(np.arange(len(point)), self.held)


def decay(point: np.ndarray) -> np.ndarray:
    """Errors of a decaying exponential whose numbers are 2 and 1.5."""
    return point[0] * np.exp(-point[1] * T) - 2.0 * np.exp(-1.5 * T)


def rosenbrock(point: np.ndarray) -> np.ndarray:
    return np.array([10.0 * (point[1] - point[0] ** 2), 1.0 - point[0]])


def solved(curve: Curve, start: list[float], **options: object) -> Minimum[np.ndarray]:
    return minimise(curve, np.array(start), **{"iterations": 100, "relative": 1e-12, "absolute": 1e-20} | options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("residual", "start", "minimum"),
    [(decay, [1.0, 1.0], [2.0, 1.5]), (decay, [50.0, 9.0], [2.0, 1.5]), (rosenbrock, [-1.2, 1.0], [1.0, 1.0])],
)
def test_a_known_minimum_is_found_from_a_bad_start(residual: Residual, start: list[float], minimum: list[float]) -> None:
    found = solved(Curve(residual), start)
    assert found.outcome is Outcome.CONVERGED
    assert found.point == pytest.approx(minimum, rel=1e-6)


def test_the_unit_of_a_number_does_not_matter() -> None:
    units = np.array([1e9, 1e-9])
    plain = solved(Curve(decay), [1.0, 1.0], iterations=4)
    scaled = solved(Curve(lambda x: decay(x / units), unit=units), list(units), iterations=4)
    assert scaled.point / units == pytest.approx(plain.point, rel=1e-6)


def test_a_bound_holds_and_what_presses_against_it_does_not_disturb_the_others() -> None:
    curve = Curve(decay, upper=1.8)
    found = solved(curve, [1.0, 1.0])
    assert found.point[0] == 1.8
    assert max(point.max() for point in curve.tried) <= 1.8
    alone = solved(Curve(lambda x: decay(np.array([1.8, x[0]]))), [1.0])
    assert found.point[1] == pytest.approx(alone.point[0], rel=1e-6)


def test_held_numbers_stay() -> None:
    found = solved(Curve(decay, held=(0,)), [1.7, 1.0])
    assert found.point[0] == 1.7
    assert found.point[1] != 1.0
    everything = solved(Curve(decay, held=(0, 1)), [1.7, 1.0])
    assert everything.point.tolist() == [1.7, 1.0]
    assert everything.outcome is Outcome.CONVERGED


def test_a_number_without_effect_stays() -> None:
    found = solved(Curve(lambda x: decay(x[:2])), [1.0, 1.0, 7.0])
    assert found.point == pytest.approx([2.0, 1.5, 7.0])


def test_what_is_no_square_moves_the_minimum() -> None:
    """(x - 3)^2 / 2 + x is least at 2."""
    found = solved(Curve(lambda x: x - 3.0, extra=lambda x: float(x[0])), [10.0])
    assert found.point == pytest.approx([2.0], rel=1e-6)


def test_a_cost_may_be_negative() -> None:
    found = solved(Curve(lambda x: x - 3.0, extra=lambda x: float(x[0]) - 100.0), [10.0])
    assert found.cost == pytest.approx(-97.5)
    assert found.outcome is Outcome.CONVERGED


def test_the_budget_ends_a_search_after_so_many_steps() -> None:
    found = solved(Curve(rosenbrock), [-1.2, 1.0], iterations=3)
    assert (found.outcome, found.steps) == (Outcome.BUDGET_SPENT, 3)


def test_a_step_that_gains_less_than_asked_for_is_the_last() -> None:
    rough, fine = (solved(Curve(rosenbrock), [-1.2, 1.0], absolute=gain) for gain in (0.5, 1e-20))
    assert rough.outcome is fine.outcome is Outcome.CONVERGED
    assert rough.steps < fine.steps


def test_cancelling_is_asked_before_every_step() -> None:
    answers = iter([False, False, True])
    found = solved(Curve(rosenbrock), [-1.2, 1.0], cancel=lambda: next(answers))
    assert (found.outcome, found.steps) == (Outcome.CANCELLED, 2)


@pytest.mark.parametrize("residual", [lambda x: x * np.nan, lambda x: np.where(x == 5.0, 1.0, np.nan)])
def test_a_start_without_cost_or_derivatives_is_said(residual: Residual) -> None:
    found = solved(Curve(residual), [5.0])
    assert (found.outcome, found.steps, found.point[0]) == (Outcome.UNDEFINED, 0, 5.0)


def test_no_step_leads_where_the_cost_is_not_finite() -> None:
    """The first step from 10 to the minimum of (ln x)^2 would lead to a negative number."""
    with np.errstate(invalid="ignore"):
        found = solved(Curve(lambda x: np.log(x)), [10.0])
    assert found.point == pytest.approx([1.0], rel=1e-6)
    assert np.isfinite(found.cost)


def test_wrong_derivatives_are_no_convergence() -> None:
    class Misled(Curve):
        def quadratic(self, point: np.ndarray, renew: bool) -> tuple[float, np.ndarray, np.ndarray]:
            cost, gradient, normal = super().quadratic(point, renew)
            return cost, -gradient, normal

    found = solved(Misled(decay), [1.0, 1.0])
    assert (found.outcome, found.steps) == (Outcome.STAGNATED, 0)
    assert found.point.tolist() == [1.0, 1.0]


def test_derivatives_that_foretold_the_gain_serve_again() -> None:
    def bent(x: np.ndarray) -> np.ndarray:
        return x - 3.0 + 1e-3 * x**2

    always, once = Curve(bent), Curve(bent)
    first, second = solved(always, [10.0]), solved(once, [10.0], reuse=0.1)
    assert once.linearised < always.linearised
    assert second.point == pytest.approx(first.point, rel=1e-6)


@pytest.mark.parametrize("start", [[0.3, 5.0], [50.0, 9.0]])
def test_derivatives_that_lead_no_farther_are_renewed(start: list[float]) -> None:
    """Those of another point end no search: from these starts one step, and one that hardly gains, are foretold wrongly."""
    curve = Curve(decay)
    found = solved(curve, start, reuse=10.0)
    assert found.outcome is Outcome.CONVERGED
    assert found.point == pytest.approx([2.0, 1.5], rel=1e-6)
    assert curve.linearised < found.steps


def test_no_number_moves_farther_than_allowed() -> None:
    curve = Curve(decay)
    solved(curve, [50.0, 9.0], longest=np.array([0.5, np.inf]))
    path = np.array([[50.0, 9.0], *curve.tried])
    assert np.abs(np.diff(path[:2, 0]))[0] == pytest.approx(0.5)
    assert np.abs(np.diff(path[:2, 1]))[0] > 0.5


def test_a_schedule_says_how_often_a_step_is_tried() -> None:
    class Uphill(Curve):
        def cost(self, point: np.ndarray) -> float:
            return super().cost(point) + 1e9

    curve = Uphill(decay)
    solved(curve, [1.0, 1.0], schedule=replace(Schedule(), attempts=5))
    assert len(curve.tried) == 5


def test_the_result_cannot_be_changed() -> None:
    found = solved(Curve(decay), [1.0, 1.0])
    with pytest.raises(AttributeError):
        found.cost = 0.0  # type: ignore[misc]
