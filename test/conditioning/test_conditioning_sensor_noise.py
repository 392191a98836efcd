"""White noise on a smooth signal, whatever the stamps, and where the signal moves."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.sensor_noise import HIGHEST, white_noise

STEP = 1e-6


def stamps(rate: float, uneven: bool, random: np.random.Generator) -> np.ndarray:
    """40 s; uneven: a fifth of a period of jitter, 3 % missing."""
    t = np.arange(int(40.0 * rate)) / rate
    if not uneven:
        return t
    return (t + random.uniform(-0.1, 0.1, len(t)) / rate)[random.random(len(t)) > 0.03]


def motion(t: np.ndarray) -> np.ndarray:
    """Radians, with a speed of 1 rad/s and more."""
    return 0.3 * np.sin(2.0 * np.pi * 0.5 * t) + 0.05 * np.sin(2.0 * np.pi * 1.7 * t)


@pytest.mark.parametrize("rate", [100.0, 250.0, 1000.0])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize(("noise", "step"), [(1e-7, 0.0), (1e-5, 0.0), (1e-3, 0.0), (5e-7, STEP), (1e-5, STEP)])
def test_noise_is_known_within_a_tenth(rate: float, uneven: bool, noise: float, step: float) -> None:
    random = np.random.default_rng(7)
    t = stamps(rate, uneven, random)
    position = motion(t) + noise * random.standard_normal(len(t))
    measured = step * np.round(position / step) if step else position
    assert white_noise(t, measured, step) == pytest.approx(noise, rel=0.1)


def test_reversals_wild_samples_and_gaps_are_passed_over() -> None:
    random = np.random.default_rng(3)
    t = stamps(500.0, False, random)
    t[len(t) // 2 :] += 7.0
    position = np.abs(t % 4.0 - 2.0) + 1e-6 * random.standard_normal(len(t))
    position[::3000] += 0.1
    assert white_noise(t, position) == pytest.approx(1e-6, rel=0.1)


def test_motion_without_noise_has_none_to_speak_of() -> None:
    """Fast beside the sampling: what is left of 2 Hz at 100 samples a second."""
    t = np.arange(4000) / 100.0
    assert white_noise(t, np.sin(4.0 * np.pi * t)) < 1e-4


def test_rounding_alone_is_no_noise_of_the_sensor() -> None:
    t = np.arange(20_000) / 500.0
    rounded = STEP * np.round(motion(t) / STEP)
    assert white_noise(t, rounded, STEP) < 0.15 * STEP
    assert white_noise(t, rounded) == pytest.approx(STEP / np.sqrt(12.0), rel=0.1)


@pytest.mark.parametrize("count", [0, 1, HIGHEST])
def test_too_few_samples_tell_nothing(count: int) -> None:
    assert white_noise(np.arange(float(count)), np.ones(count)) == 0.0
