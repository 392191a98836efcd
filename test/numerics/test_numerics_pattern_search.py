"""A search without derivatives: it goes down where a cost jumps, and halves its step where nothing is better."""

from __future__ import annotations

import math

import pytest

from tcs_friction.numerics.pattern_search import by_factors, go_downhill


def neighbours(point: float, step: float) -> list[float]:
    return [point - step, point + step]


@pytest.mark.parametrize("start", [-3.0, 0.3, 7.7])
def test_a_minimum_between_jumps_is_found(start: float) -> None:
    """Every derivative of this cost is zero."""
    found = go_downhill(start, lambda x: math.floor(abs(x - 2.0) / 0.01), neighbours, step=1.0, rounds=40)
    assert found == pytest.approx(2.0, abs=0.01)


def test_the_rounds_are_the_most_that_are_tried() -> None:
    asked: list[float] = []

    def record(x: float, step: float) -> list[float]:
        asked.append(x)
        return neighbours(x, step)

    assert go_downhill(0.0, lambda x: abs(x - 100.0), record, 1.0, 5) == 5.0
    assert asked == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_point_without_neighbours_stays() -> None:
    assert go_downhill(3.0, abs, lambda *_: [], 1.0, 10) == 3.0


def test_the_best_neighbour_is_taken_and_never_a_worse_point() -> None:
    costs: list[float] = []

    def cost(x: float) -> float:
        return (x - 5.0) ** 2

    def record(x: float, step: float) -> list[float]:
        costs.append(cost(x))
        return neighbours(x, step)

    assert go_downhill(0.0, cost, record, 3.0, 30) == pytest.approx(5.0, abs=1e-3)
    assert costs == sorted(costs, reverse=True)


def test_each_number_is_moved_by_a_factor_both_ways() -> None:
    moves = by_factors({"a": 2.0, "b": 3.0, "c": 5.0}, ["a", "c"], math.log(2.0))
    expected = [(4.0, 3.0, 5.0), (1.0, 3.0, 5.0), (2.0, 3.0, 10.0), (2.0, 3.0, 2.5)]
    assert [tuple(move.values()) for move in moves] == [pytest.approx(values) for values in expected]
