"""The low pass keeps the phase and gives exact derivatives; a response is applied as it is."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.filters import low_pass, through


def test_derivatives_of_the_low_pass_are_those_of_the_signal() -> None:
    t = np.arange(0.0, 10.0, 1e-3)
    values, rate, second = low_pass(np.sin(3.0 * t), 1e-3, 30.0, 2)
    inside = slice(500, -500)
    assert np.max(np.abs(values - np.sin(3.0 * t))[inside]) < 1e-6
    assert np.max(np.abs(rate - 3.0 * np.cos(3.0 * t))[inside]) < 1e-4
    assert np.max(np.abs(second + 9.0 * np.sin(3.0 * t))[inside]) < 1e-2


def test_the_low_pass_halves_at_its_cutoff_and_does_not_shift() -> None:
    t = np.arange(0.0, 10.0, 1e-3)
    wave = np.sin(2 * np.pi * 20.0 * t)
    (passed,) = low_pass(wave, 1e-3, 20.0)
    inside = slice(1000, -1000)
    assert passed[inside] @ wave[inside] / (wave[inside] @ wave[inside]) == pytest.approx(0.5, abs=1e-3)


def test_a_line_stays_a_line_up_to_its_ends() -> None:
    t = np.arange(0.0, 3.0, 1e-2)
    values, rate = low_pass(2.0 + 0.5 * t, 1e-2, 5.0, 1)
    assert values == pytest.approx(2.0 + 0.5 * t)
    assert rate == pytest.approx(np.full(len(t), 0.5))


def test_a_delay_shifts_a_series_that_was_zero_before() -> None:
    pulse = np.zeros(400)
    pulse[100:200] = np.hanning(100)
    late = through(pulse, 1e-2, lambda frequency: np.exp(-2j * np.pi * frequency * 0.3))
    assert late == pytest.approx(np.roll(pulse, 30), abs=1e-3)


def test_what_a_filter_rings_does_not_come_back_at_the_beginning() -> None:
    pulse = np.zeros(400)
    pulse[-1] = 1.0
    rung = through(pulse, 1e-2, lambda frequency: 1.0 / (1.0 + 2j * np.pi * frequency * 0.1))
    assert np.abs(rung[:200]).max() < 1e-3 * rung[-1]
