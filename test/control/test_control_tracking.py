"""Tracking errors: the numbers of Table 3 on errors that are known."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.control.tracking import reversals, tracking_errors
from tcs_friction.errors import InputError

T = np.linspace(0.0, 40.0, 40_001)
SPEED = np.cos(2.0 * np.pi * T / 20.0)  # turns negative at 5 s and 25 s, positive at 15 s and 35 s


def pulse(at: float, height: float) -> np.ndarray:
    return height * np.exp(-(((T - at) / 0.1) ** 2))


def test_reversals_are_found_with_their_direction() -> None:
    np.testing.assert_allclose(reversals(T, SPEED), [[5, -1], [15, 1], [25, -1], [35, 1]], atol=2e-3)


def test_standing_still_between_does_not_hide_a_reversal() -> None:
    speed = np.array([1.0, 1.0, 0.0, 0.0, -1.0, 0.0, -1.0, 1.0])
    np.testing.assert_array_equal(reversals(np.arange(8.0), speed), [[4, -1], [7, 1]])


def test_peaks_are_averaged_by_direction() -> None:
    error = pulse(5.2, -0.8) + pulse(25.2, -1.0) + pulse(15.2, 0.5) + pulse(35.2, 0.7)
    result = tracking_errors(T, SPEED, error)
    assert result.peak_negative == pytest.approx(-0.9)
    assert result.peak_positive == pytest.approx(0.6)
    assert result.rms == pytest.approx(np.sqrt(np.mean(error**2)))
    assert result.reversals == 4


def test_error_turned_over_by_compensation_counts() -> None:
    assert tracking_errors(T, SPEED, pulse(15.2, -0.5)).peak_positive == pytest.approx(0.25)


def test_start_is_left_out() -> None:
    error = pulse(0.5, 50.0) + pulse(5.2, -1.0)
    result = tracking_errors(T, SPEED, error, settle=3.0)
    assert result.rms < 0.1
    assert result.peak_negative == pytest.approx(-0.5)


@pytest.mark.parametrize("settle", [0.0, 100.0])
def test_run_without_reversal_is_refused(settle: float) -> None:
    speed = np.ones_like(T) if settle == 0.0 else SPEED
    with pytest.raises(InputError, match="no reversal"):
        tracking_errors(T, speed, T, settle)
