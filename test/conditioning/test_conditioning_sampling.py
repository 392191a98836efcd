"""Even samples of an uneven series, and the noise of derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.sampling import jitter, resampled
from tcs_friction.conditioning.white_noise import derivative_noise


def test_an_uneven_series_comes_out_even() -> None:
    t = 3.0 + np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 1.5e-3, 5000))
    even, (line, wave) = resampled(t, np.array([2.0 * t, np.sin(5.0 * t)]), 1000.0)
    assert even[0] == t[0]
    assert t[-1] - 1e-3 < even[-1] <= t[-1]
    assert np.diff(even) == pytest.approx(1e-3)
    assert line == pytest.approx(2.0 * even)
    assert wave == pytest.approx(np.sin(5.0 * even), abs=0.5 * (5.0 * 1.5e-3) ** 2)


def test_an_even_series_stays_as_it_is() -> None:
    t = np.arange(0.0, 1.0, 0.125)
    even, (values,) = resampled(t, np.array([t**2]), 8.0)
    assert even.tolist() == t.tolist()
    assert values.tolist() == (t**2).tolist()


def test_jitter_is_relative_to_the_step() -> None:
    assert jitter(np.array([0.0, 0.1, 0.25, 0.3]), 10.0) == pytest.approx([0.0, 0.5, 0.5])


@pytest.mark.parametrize("order", [0, 1, 2])
def test_noise_of_derivatives(order: int) -> None:
    """White noise through an ideal low pass, differentiated in the frequency domain."""
    rate, count, band, deviation = 1000.0, 1 << 16, 40.0, 1e-3
    noise = deviation * np.random.default_rng(1).standard_normal(count)
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    spectrum = np.fft.rfft(noise) * (2j * np.pi * frequency) ** order * (frequency < band)
    expected = derivative_noise(2.0 * deviation**2 / rate, band, order)
    assert float(np.std(np.fft.irfft(spectrum))) == pytest.approx(expected, rel=0.05)
