"""The fast loops against the physics' own kernels and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import INERTIA, LUGRE, axis_of, walked
from scipy.signal import butter, lfilter, lfilter_zi, sosfiltfilt

from tcs_friction.identify import kernels
from tcs_friction.identify.cost import kernel_filter

VALUES = np.array(list(LUGRE.values()))


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t, position, velocity, travel: two sinusoids, the axis often reversing within the bristle's reach."""
    t = 2e-3 * np.arange(3000)
    position = 2e-3 * np.sin(1.1 * t) + 3e-4 * np.sin(7.0 * t)
    velocity = np.gradient(position, t)
    travel = np.concatenate([[0.0], 0.5 * (velocity[1:] + velocity[:-1]) * 2e-3])
    return t, position, velocity, travel


def population(count: int) -> np.ndarray:
    random = np.random.default_rng(1)
    spread = VALUES * np.exp(0.4 * random.standard_normal((count, 6)))
    return np.column_stack(
        [spread, INERTIA * np.exp(0.1 * random.standard_normal(count)), random.standard_normal(count)]
    )


@pytest.mark.parametrize("x", [0.0, -1e-12, -0.3, -7.0, -43.9])
def test_falling_exponential(x: float) -> None:
    assert kernels.falling_exponential(x) == pytest.approx(np.exp(x), rel=1e-12)


@pytest.mark.parametrize("x", [-44.0, -1e3, -1e300])
def test_far_down_the_exponential_is_nothing(x: float) -> None:
    assert 0.0 <= kernels.falling_exponential(x) < 1e-19


@pytest.mark.parametrize("count", [1, kernels.LANES - 1, kernels.LANES, 3 * kernels.LANES + 5])
def test_costs_of_a_population_are_those_of_the_axis_model(count: int) -> None:
    t, position, velocity, travel = motion()
    random = np.random.default_rng(0)
    target, acceleration = random.standard_normal(len(t)), 1e-3 * random.standard_normal(len(t))
    weight = (random.random(len(t)) < 0.8).astype(float)
    carry = np.ones(len(t))
    carry[0] = 0.0
    candidates = population(count)
    out = np.empty(count)
    none = np.zeros(0)
    kernels.squared_errors(velocity, travel, carry, acceleration, target, weight, none, candidates, out)
    for candidate, found in zip(candidates, out, strict=True):
        friction = walked(axis_of(dict(zip(LUGRE, candidate[:6], strict=True))).friction, t, position)
        errors = friction + candidate[6] * acceleration + candidate[7] - target
        assert found == pytest.approx(weight @ errors**2, rel=1e-9)


def test_costs_behind_an_observers_filter() -> None:
    """Friction of each stretch passes a Butterworth filter that starts settled."""
    t, position, velocity, travel = motion()
    random, observer = np.random.default_rng(0), kernel_filter(3, 15.0, 500.0)
    target, zero = random.standard_normal(len(t)), np.zeros(len(t))
    carry = np.ones(len(t))
    carry[0] = 0.0
    candidates, out = population(3), np.empty(3)
    kernels.squared_errors(velocity, travel, carry, zero, target, zero + 1.0, observer, candidates, out)
    b, a = butter(3, 15.0, fs=500.0)
    for candidate, found in zip(candidates, out, strict=True):
        friction = walked(axis_of(dict(zip(LUGRE, candidate[:6], strict=True))).friction, t, position)
        passed = lfilter(b, a, friction, zi=lfilter_zi(b, a) * friction[0])[0]
        assert found == pytest.approx(np.sum((passed + candidate[7] - target) ** 2), rel=1e-9)


def test_costs_behind_a_zero_phase_low_pass() -> None:
    """Of two stretches, each by itself; the ends, where filters set out in their own ways, do not count."""
    t, position, velocity, travel = motion()
    random, low_pass, cut = np.random.default_rng(0), kernel_filter(4, 15.0, 500.0), 1100
    target, zero = random.standard_normal(len(t)), np.zeros(len(t))
    carry, weight, count = np.ones(len(t)), np.zeros(len(t)), 3
    carry[[0, cut]], weight[200:900], weight[1300:2800], travel[cut] = 0.0, 1.0, 1.0, 0.0
    candidates, out = population(count), np.empty(count)
    kernels.smoothed_errors(velocity, travel, carry, zero, target, weight, low_pass, candidates, out)
    sections = butter(4, 15.0, fs=500.0, output="sos")
    for candidate, found in zip(candidates, out, strict=True):
        law = axis_of(dict(zip(LUGRE, candidate[:6], strict=True))).friction
        parts = [walked(law, t[part], position[part]) for part in (slice(0, cut), slice(cut, None))]
        passed = np.concatenate([sosfiltfilt(sections, part) for part in parts])
        assert found == pytest.approx(weight @ (passed + candidate[7] - target) ** 2, rel=1e-4)


def test_normal_equations_hold_the_linear_part() -> None:
    """With them the cost of the best linear coefficients is that of a dense least-squares solution."""
    t, position, velocity, travel = motion()
    random = np.random.default_rng(2)
    acceleration = np.gradient(velocity, t)
    weight = (random.random(len(t)) < 0.7).astype(float)
    carry = np.ones(len(t))
    carry[0] = 0.0
    target = random.standard_normal(len(t)) + 40.0 * np.sign(velocity)
    shapes = np.array([[3e-4, 1.4, 5e-4], [1e-4, 1.1, 2e-3]] * 10)
    sums = np.empty((len(shapes), kernels.GRAM))
    kernels.normal_equations(velocity, travel, carry, acceleration, target, weight, shapes, sums)
    for (distance, ratio, stribeck), row in zip(shapes, sums, strict=True):
        unit = {
            "coulomb": 1.0,
            "static": ratio,
            "stribeck_velocity": stribeck,
            "stiffness": 1.0 / distance,
            "viscous": 0.0,
        }
        slide = walked(axis_of({**unit, "damping": 0.0}).friction, t, position)
        rate = walked(axis_of({**unit, "damping": 1.0}).friction, t, position) - slide
        columns = np.column_stack([slide, rate, velocity, acceleration, np.ones(len(t))])
        gram = columns.T @ (weight[:, None] * columns)
        assert row[:15] == pytest.approx(gram[np.triu_indices(5)], rel=1e-8, abs=1e-12)
        assert row[15:] == pytest.approx(columns.T @ (weight * target), rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("which", range(6))
def test_sensitivities_are_derivatives(which: int) -> None:
    _, _, velocity, travel = motion()
    bounds, initial = np.array([0, 1000, 3000]), np.array([20.0, -50.0])

    def run(values: np.ndarray) -> np.ndarray:
        out = np.empty((len(velocity), 8))
        kernels.sensitivities(velocity, travel, bounds, values, initial, out)
        return out

    step = 1e-6 * VALUES[which]
    high, low = VALUES.copy(), VALUES.copy()
    high[which] += step
    low[which] -= step
    expected = (run(high)[:, 0] - run(low)[:, 0]) / (2.0 * step)
    assert run(VALUES)[:, 1 + which] == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max())


def test_sensitivity_to_the_initial_state() -> None:
    _, _, velocity, travel = motion()
    bounds = np.array([0, 3000])
    out, moved = np.empty((3000, 8)), np.empty((3000, 8))
    kernels.sensitivities(velocity, travel, bounds, VALUES, np.array([10.0]), out)
    kernels.sensitivities(velocity, travel, bounds, VALUES, np.array([11.0]), moved)
    assert moved[:, 0] - out[:, 0] == pytest.approx(out[:, 7], abs=1e-9)  # the torque is linear in it
    assert abs(out[0, 7]) > 0.5
    assert abs(out[-1, 7]) < 1e-3


def test_decimate_is_a_symmetric_filter_at_the_centres() -> None:
    columns = np.random.default_rng(0).standard_normal((50, 3))
    taps = np.array([0.25, 0.5, 0.25])
    centres = np.array([1, 10, 48])
    out = np.empty((3, 3))
    kernels.decimate(columns, centres, taps, out)
    expected = 0.25 * columns[centres - 1] + 0.5 * columns[centres] + 0.25 * columns[centres + 1]
    assert out == pytest.approx(expected)
