"""Normal courses, steps and drifts against a known truth, and nothing found where nothing changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.trends.changes import trend_of
from tcs_friction.trends.normal import independent, least_squares, noise_of, normal_design
from tcs_friction.trends.series import Series

BEGIN = 20000.0  # days since 1970


def series(
    random: np.random.Generator,
    count: int = 50,
    years: float = 1.0,
    step: float = 0.0,
    drift: float = 0.0,
    alike: float = 0.0,
    slope: float = -0.25,
) -> Series:
    """A level of 78 with seasonal temperature, of curvature too, scatter 0.3 between recordings and deviations of about 0.1."""
    day = BEGIN + np.sort(random.uniform(0.0, 365.0 * years, count))
    warm = (
        10.0 - 12.0 * np.cos(2.0 * np.pi * (day - BEGIN - 15.0) / 365.0) + 3.0 * random.standard_normal(count)
    )
    scatter = random.standard_normal(count)
    for k in range(1, count):
        scatter[k] = alike * scatter[k - 1] + np.sqrt(1.0 - alike**2) * scatter[k]
    std = 0.1 * np.exp(0.5 * random.standard_normal(count))
    value = (
        78.0
        + slope * (warm - 10.0)
        + 0.005 * (warm - 10.0) ** 2
        + 0.3 * scatter
        + std * random.standard_normal(count)
    )
    value += step * (day > BEGIN + 200.0) + drift * (day - day[0]) / (day[-1] - day[0])
    columns = {"temperature_change": np.full(count, 0.1)}
    return Series("coulomb", "N m", day, value, std, warm, columns, np.ones(count), ("1",) * count, {})


def test_the_normal_course_is_found_with_its_temperature_and_scatter() -> None:
    one = series(np.random.default_rng(1), 400, 3.0)
    trend = trend_of(one, 10.0, 1e-3)
    assert trend is not None
    assert not trend.changes
    for name, true in (("level", 78.0), ("temperature", -0.25), ("temperature squared", 0.005)):
        value, std = trend.fit.value(name)
        assert abs(value - true) < 3.5 * std
    assert trend.noise.scatter == pytest.approx(0.3, rel=0.15)


@pytest.mark.parametrize(("alike", "count"), [(0.0, 12), (0.0, 50), (0.5, 50)])
def test_nothing_is_found_where_nothing_changed(alike: float, count: int) -> None:
    """At a rate of 2 % for each of 40 series: 5 or more have a chance of 0.1 %."""
    random = np.random.default_rng(7)
    false = sum(bool(trend_of(series(random, count, alike=alike), 10.0, 0.02).changes) for _ in range(40))  # type: ignore[union-attr]
    assert false <= 4


def test_a_seasonal_temperature_is_no_drift_and_no_step() -> None:
    """Half a year, in which it only gets warmer, is where temperature and time are most alike."""
    random = np.random.default_rng(2)
    for _ in range(20):
        trend = trend_of(series(random, 40, 0.5, slope=-2.0), 10.0, 1e-3)
        assert trend is not None
        assert trend.changes == ()


def test_a_step_is_found_at_its_date_and_with_its_size() -> None:
    random = np.random.default_rng(3)
    for size in (3.0, -3.0):
        trend = trend_of(series(random, step=size), 10.0, 1e-4)
        assert trend is not None
        (change,) = trend.changes
        assert change.kind == "step"
        assert change.earliest <= BEGIN + 200.0 <= change.latest
        assert change.latest - change.earliest < 40.0
        assert abs(change.size - size) < 3.0 * change.std
        assert change.level == pytest.approx(78.0, abs=0.5)
        assert trend.now[0] == pytest.approx(78.0 + size, abs=0.5)


def test_a_drift_is_a_drift() -> None:
    trend = trend_of(series(np.random.default_rng(4), drift=10.0), 10.0, 1e-4)
    assert trend is not None
    (change,) = trend.changes
    assert change.kind == "drift"
    assert abs(change.size - 10.0) < 3.0 * change.std


def test_a_step_beside_a_drift_is_found_too() -> None:
    trend = trend_of(series(np.random.default_rng(5), 200, step=3.0, drift=5.0), 10.0, 1e-4)
    assert trend is not None
    assert {change.kind: round(change.size) for change in trend.changes} == {"step": 3, "drift": 5}


def test_a_step_that_temperature_may_be_is_not_found() -> None:
    """Cold before, warm after: what the step is cannot be told from what the warmth does."""
    one = series(np.random.default_rng(6), slope=0.0)
    warm = np.where(one.day > BEGIN + 200.0, 20.0, 0.0) + np.random.default_rng(0).normal(0.0, 0.01, len(one))
    trend = trend_of(replace(one, value=one.value + 0.3 * (warm > 10.0), temperature=warm), 10.0, 1e-3)
    assert trend is not None
    assert trend.changes == ()


def test_one_recording_only_is_a_level_with_its_error() -> None:
    whole = series(np.random.default_rng(8))
    columns = {name: values[:1] for name, values in whole.columns.items()}
    one = replace(whole, day=whole.day[:1], value=whole.value[:1], std=whole.std[:1], temperature=whole.temperature[:1],
                  columns=columns, count=whole.count[:1], version=("1",))  # fmt: skip
    trend = trend_of(one, 10.0, 1e-3)
    assert trend is not None
    assert not trend.searched
    assert trend.now[0] == pytest.approx(one.value[0])


def test_alike_neighbours_make_errors_larger() -> None:
    random = np.random.default_rng(9)
    one = series(random, 300, 2.0, alike=0.7)
    design = normal_design(one, 10.0)
    noise = noise_of(design, one)
    assert noise.alike == pytest.approx(0.7, abs=0.15)
    alone = least_squares(design, one.value, independent(one, noise.scatter)).value("level")[1]
    assert least_squares(design, one.value, noise).value("level")[1] > 1.5 * alone
