"""Values that are repeated until the next comes are told from signals that rest or that are coarse."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.recording.freshness import fresh_samples, longest_unchanged

T = np.arange(9000) * 0.004
RANDOM = np.random.default_rng(0)
TORQUE = 20.0 * np.sin(0.9 * T) + 6.0 * np.sign(np.cos(0.9 * T)) + 0.05 * RANDOM.standard_normal(len(T))


def held(values: np.ndarray, period: float, t: np.ndarray = T) -> np.ndarray:
    """The value at the last multiple of a period, s."""
    return np.asarray(np.interp(np.floor((t + 1e-9) / period) * period, t, values))


@pytest.mark.parametrize("every", [2, 3, 5, 20, 4.17, 7.5])
@pytest.mark.parametrize("resolution", [0.0, 0.02, 0.05])
def test_a_held_signal_is_told_with_its_period(every: float, resolution: float) -> None:
    values = held(TORQUE, every * 0.004)
    if resolution:
        values = resolution * np.round(values / resolution)
    period, share = fresh_samples(T, values)
    assert period == pytest.approx(every * 0.004, rel=0.1 if resolution else 0.03)
    assert share == pytest.approx(1.0 / every, rel=0.1 if resolution else 0.03)


def test_times_that_jitter_and_values_that_rest_do_not_hide_a_hold() -> None:
    t = T + 0.001 * RANDOM.uniform(size=len(T))
    values = held(np.where((T > 10.0) & (T < 22.0), 3.0, TORQUE), 0.02, t)
    assert fresh_samples(t, values)[0] == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(
    "values",
    [
        TORQUE,
        np.round(np.sin(0.3 * T) / 0.01),
        0.001 * np.round(1000.0 * T / 36.0),
        np.round(4.0 * np.sin(0.9 * T)) + np.round(0.3 * RANDOM.standard_normal(len(T))),
        np.where(np.mod(T, 2.0) < 1.0, 5.0, -5.0),
        np.repeat(RANDOM.standard_normal(18), 500),
        np.where((T > 5.0) & (T < 6.0), TORQUE, 1.0),
        np.zeros(len(T)),
        T[:1],
    ],
    ids=["noisy", "coarse", "slow ramp", "coarse noise", "square", "steps", "mostly at rest", "constant", "one sample"],
)
def test_what_rests_is_coarse_or_is_commanded_in_steps_is_not_held(values: np.ndarray) -> None:
    period, share = fresh_samples(T[: len(values)], values)
    assert share == 1.0
    assert period == pytest.approx(0.004 if len(values) > 1 else 0.0)


def test_the_longest_time_without_a_change() -> None:
    values = TORQUE.copy()
    values[2000:2500] = values[2000]
    span, start = longest_unchanged(T, values)
    assert span == pytest.approx(499 * 0.004)
    assert start == pytest.approx(8.0)
    assert longest_unchanged(T[:1], T[:1]) == (0.0, 0.0)
