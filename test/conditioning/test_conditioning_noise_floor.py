"""The noise floor: white noise has its own rms, lines and bursts do not raise it, and it is never above what is left."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.noise_floor import noise_floor


@pytest.fixture
def noise() -> np.ndarray:
    return 0.3 * np.random.default_rng(1).standard_normal(20_000)


def test_the_floor_of_white_noise_is_its_rms(noise: np.ndarray) -> None:
    assert noise_floor(noise) == pytest.approx(0.3, rel=0.05)


def test_coloured_noise_counts_with_all_its_power(noise: np.ndarray) -> None:
    coloured = np.zeros(len(noise))
    for k in range(1, len(noise)):
        coloured[k] = 0.9 * coloured[k - 1] + noise[k]
    assert noise_floor(coloured) == pytest.approx(float(np.std(coloured)), rel=0.15)


def test_a_line_and_a_burst_are_no_noise(noise: np.ndarray) -> None:
    k = np.arange(len(noise))
    structure = 2.0 * np.sin(0.7 * k) + 5.0 * ((k > 4000) & (k < 4400))
    assert noise_floor(noise + structure) == pytest.approx(0.3, rel=0.1)


def test_it_is_never_above_what_is_left_of_any_part(noise: np.ndarray) -> None:
    """Held-out data may happen to be quieter."""
    held = np.arange(len(noise)) >= 15_000
    quieter = np.where(held, 0.5, 1.0) * noise
    parts = (~held, held)
    assert noise_floor(quieter, None, parts) == pytest.approx(float(np.sqrt(np.mean(quieter[held] ** 2))))
    assert noise_floor(quieter, 0.01, parts) == 0.01
    assert noise_floor(noise[:20]) == pytest.approx(float(np.sqrt(np.mean(noise[:20] ** 2))))
    assert noise_floor(noise[:0]) == 0.0
