"""The noise of a drive, from a residual."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, resample_poly

from tcs_friction.identify.drive_noise import drive_noise, first_order

INERTIA, SIZE = 100.0, 0.25


def residual(seed: int, period: float, bandwidth: float, encoder: float, seconds: float = 60.0) -> np.ndarray:
    """Coloured noise of SIZE, and what an encoder's noise makes of the inertia's torque."""
    random = np.random.default_rng(seed)
    count, decay = int(seconds / period), np.exp(-2.0 * np.pi * bandwidth * period)
    drive = lfilter([SIZE * np.sqrt(1.0 - decay**2)], [1.0, -decay], random.standard_normal(count))
    acceleration = np.gradient(np.gradient(encoder * random.standard_normal(count), period), period)
    return np.asarray(drive - INERTIA * acceleration)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("period", "bandwidth"), [(0.001, 3.0), (0.001, 10.0), (0.004, 3.0), (0.004, 10.0), (0.01, 3.0)])
@pytest.mark.parametrize("encoder", [0.0, 1e-7, 1e-6])
def test_size_and_bandwidth_are_found_below_the_encoders_share(
    seed: int, period: float, bandwidth: float, encoder: float
) -> None:
    """As a fit has it: thinned to a quarter of the samples, of which the filter leaves what is below 0.3 of their rate."""
    thinned = resample_poly(residual(seed, period, bandwidth, encoder), 1, 4)[50:-50]
    rate = 0.25 / period
    found = drive_noise([thinned], rate, period, encoder, INERTIA, lambda f: np.where(f < 0.3 * rate, 1.0, 0.0))
    assert found is not None
    assert found.rms == pytest.approx(SIZE, rel=0.2)
    assert found.bandwidth == pytest.approx(bandwidth, rel=0.35)


def test_bursts_and_lines_do_not_count() -> None:
    """What a law leaves at reversals, and a cogging that it does not have."""
    noise = residual(3, 0.001, 5.0, 0.0)
    t = 0.001 * np.arange(len(noise))
    wrong = noise + 3.0 * np.exp(-(((t % 10.0) - 5.0) ** 2) / 0.02) + 0.3 * np.sin(2.0 * np.pi * 7.3 * t)
    found = drive_noise([wrong], 1000.0, 0.001, 0.0, INERTIA)
    assert found is not None
    assert found.rms == pytest.approx(SIZE, rel=0.2)


def test_what_a_filter_took_is_given_back() -> None:
    noise = residual(4, 0.001, 10.0, 0.0)
    smoothed = lfilter([0.1], [1.0, -0.9], noise)
    found = drive_noise(
        [smoothed], 1000.0, 0.001, 0.0, INERTIA, lambda f: np.abs(0.1 / (1.0 - 0.9 * np.exp(-2j * np.pi * f * 0.001))) ** 2
    )
    assert found is not None
    assert found.rms == pytest.approx(SIZE, rel=0.2)
    assert found.bandwidth == pytest.approx(10.0, rel=0.3)


def test_an_encoder_alone_leaves_no_drive_to_speak_of() -> None:
    noise = 0.0 * residual(0, 0.001, 5.0, 0.0) + residual(5, 0.001, 5.0, 1e-5) - residual(5, 0.001, 5.0, 0.0)
    found = drive_noise([resample_poly(noise, 1, 4)], 250.0, 0.001, 1e-5, INERTIA, lambda f: np.where(f < 70.0, 1.0, 0.0))
    assert found is not None
    assert found.rms < 0.3 * float(np.std(resample_poly(noise, 1, 4)))


@pytest.mark.parametrize("residuals", [[], [np.ones(10)], [np.zeros(5000)]])
def test_nothing_is_told_of_nothing(residuals: list[np.ndarray]) -> None:
    assert drive_noise(residuals, 100.0, 0.01, 0.0, INERTIA) is None


def test_the_density_adds_up_to_the_variance() -> None:
    frequency = np.linspace(0.0, 5000.0, 500_001)
    assert np.trapezoid(first_order(frequency, 10.0, 0.001), frequency) == pytest.approx(1.0, rel=0.01)
