"""Where the position sinks into its noise, how large that is, and whether an encoder's steps show."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcs_friction.conditioning.bands import (
    HIGHEST_CUTOFF,
    LOWEST_CUTOFF,
    PASSED,
    SAMPLES_PER_PERIOD,
    bands,
    choose_cutoff,
    step_of,
    usual_spacing,
    visible_step,
)

DT = 2e-3
NOISE = 1e-6


def tones(highest: float, seconds: float = 60.0) -> np.ndarray:
    """A position (n,) that moves at every frequency up to `highest`, Hz, in noise."""
    rng = np.random.default_rng(0)
    count = int(seconds / DT)
    frequency = np.fft.rfftfreq(count, DT)
    spectrum = np.exp(2j * np.pi * rng.random(len(frequency))) * (frequency < highest)
    moved = np.fft.irfft(spectrum, count)
    return 1e-3 * moved / np.std(moved) + NOISE * rng.standard_normal(count)


def test_the_cutoff_lies_beyond_the_motion_and_the_noise_is_the_encoder_s() -> None:
    cutoff, noise = choose_cutoff(tones(20.0), DT)
    assert cutoff == pytest.approx(PASSED * 20.0, rel=0.1)
    assert noise == pytest.approx(NOISE, rel=0.05)


def test_the_cutoff_has_limits() -> None:
    rng = np.random.default_rng(1)
    assert choose_cutoff(rng.standard_normal(30_000), DT)[0] == pytest.approx(LOWEST_CUTOFF)
    assert choose_cutoff(np.cumsum(rng.standard_normal(30_000)), DT)[0] <= HIGHEST_CUTOFF / DT


def test_every_band_has_enough_samples() -> None:
    for highest in (3.0, 20.0, 60.0):
        found = bands([tones(highest)], DT, DT)
        assert found.step * DT * found.motion * SAMPLES_PER_PERIOD <= 1.0 or found.step == 1
        assert found.step * found.stride * DT * found.cutoff * SAMPLES_PER_PERIOD <= 1.0
        assert found.motion < 0.5 / DT


def test_samples_that_come_seldom_lower_the_cutoff() -> None:
    position = tones(60.0)
    assert bands([position], DT, 4.0 * DT).cutoff == pytest.approx(HIGHEST_CUTOFF / (4.0 * DT))
    assert bands([position], DT, DT).cutoff > 80.0


def test_a_few_late_samples_do_not_count() -> None:
    t = np.cumsum(np.where(np.arange(1000) % 50 == 0, 0.1, 0.01))
    assert usual_spacing([t]) == pytest.approx(0.01)
    assert usual_spacing([t, np.arange(0.0, 3.0, 0.02)]) == pytest.approx(0.02)


def test_the_step_of_a_coarse_encoder_is_found() -> None:
    position = 1.0 + np.cumsum(np.random.default_rng(0).uniform(-1e-5, 3e-5, 20_000))
    assert step_of(position) == 0.0
    assert step_of(2e-6 * np.round(position / 2e-6)) == pytest.approx(2e-6, rel=1e-6)
    assert step_of(np.array([0.0, 2.0 * math.pi / 4096, 2.0 * math.pi / 1024])) == pytest.approx(2.0 * math.pi / 4096)


def test_steps_that_noise_blurs_do_not_show() -> None:
    position = 1e-3 * np.round(np.cumsum(np.random.default_rng(0).uniform(-1.0, 3.0, 5000)))
    assert visible_step([position], 1e-4) == pytest.approx(1e-3)
    assert visible_step([position], 6e-4) == 0.0
