"""Matched filters: a wave is found at its order, strong lines are no noise, and one wave has one name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from concealed_torque_cases import DT, axis, conditioned, settled

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.search.hypotheses import starts
from tcs_friction.diagnose.search.matched_filter import noise_excess, order_spectrum, same_wave
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes, survey
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording


def test_a_wave_is_found_at_its_order_and_not_at_one_that_samples_pretend() -> None:
    """At one speed a wave of which whole periods are passed from sample to sample looks the same."""
    order, speed = 40.0, 0.15
    data = conditioned(np.random.default_rng(5), lambda m: 2.0 * np.cos(order * m.q), speed=speed)
    pretended = order + 2.0 * math.pi / (speed * DT)
    balance, fit = settled(data)
    projected = ProjectedResidual(balance, fit)
    grid, gain, _ = order_spectrum(projected, effect("cogging"), survey(balance, fit.axis))
    assert grid[np.argmax(gain)] == pytest.approx(order, abs=2.0)
    assert grid[-1] > pretended
    assert gain[abs(grid - pretended) < 10.0].max() < 0.1 * gain.max()
    item = instance(effect("cogging"), {"order": pretended, "amplitude": 2.0, "phase": 0.0})
    assert np.std(projected.change(item)[np.abs(data.joined("velocity")) == speed]) < 0.1


@pytest.mark.parametrize(("lines", "size"), [((11.3,), 60.0), ((11.3,), 200.0), (tuple(np.arange(10.0, 13.0, 0.1)), 60.0)])
def test_a_strong_line_is_not_taken_for_noise(lines: tuple[float, ...], size: float) -> None:
    """Gaps of held-out data spread it over its neighbourhood; a resonance of the noise, which is many lines, is noise."""
    term = effect("periodic_vibration")
    balance, fit = settled(conditioned(np.random.default_rng(5), seconds=12.0))
    projected, view = ProjectedResidual(balance, fit), survey(balance, fit.axis)
    for line in lines:
        column = projected.columns(probes(term, {"frequency": line}, None))[:, 0]
        projected.white = projected.white + size * column / np.linalg.norm(column) * math.cos(9.0 * line**2)
    grid, gain, _ = order_spectrum(projected, term, view)
    assert abs(grid[np.argmax(gain)] - 11.3) < 2.0
    assert gain.max() > 1000.0
    excess = noise_excess(projected, term, view, grid, gain)[np.argmax(gain)]
    assert excess < 1.5 if len(lines) == 1 else excess > 100.0
    found = {start.instance.values["frequency"]: start for start in starts(projected, term, None)}
    near = [start for frequency, start in found.items() if abs(frequency - 11.3) < 2.0]
    assert len(lines) > 1 or max(start.gain for start in near) > 1000.0
    assert all(start.noise_excess < 2.0 if len(lines) == 1 else start.noise_excess > 100.0 for start in near)


@pytest.mark.parametrize(("swing", "same"), [(0.02, True), (0.5, False)])
def test_a_wave_over_time_is_one_over_the_position_where_the_axis_moves_steadily(swing: float, same: bool) -> None:
    """At 0.5 rad/s the fourth wave per turn passes 0.318 times a second, its second harmonic 0.637 times."""
    t = np.arange(0.0, 20.0, DT)
    q = 0.5 * t + swing * np.sin(3.0 * t)
    rng = np.random.default_rng(5)
    balance = TorqueBalance(prepare([Recording(t, q + 1e-7 * rng.normal(size=len(t)), rng.normal(size=len(t)))]))
    harmonic = {"order": 4.0, "amplitude": 1.0, "phase": 0.0, "amplitude_2": 0.5, "phase_2": 1.0}
    over_position, its_second = (
        instance(effect("cogging"), values) for values in (harmonic, harmonic | {"amplitude": 0.0})
    )
    for frequency, item in ((1.0 / math.pi, over_position), (2.0 / math.pi, its_second)):
        over_time = instance(effect("periodic_vibration"), {"frequency": frequency, "amplitude": 1.0, "phase": 0.0})
        assert same_wave(balance, axis(), over_time, item) is same
        assert same_wave(balance, axis(), item, over_time) is same
    ripple = instance(effect("torque_ripple"), {"order": 4.0, "amplitude": 0.01, "phase": 0.0})
    assert not same_wave(balance, axis(), ripple, over_position)


def test_a_spectrum_of_one_frequency_has_no_neighbourhood() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5), seconds=12.0))
    projected, view = ProjectedResidual(balance, fit), survey(balance, fit.axis)
    assert noise_excess(projected, effect("periodic_vibration"), view, np.array([3.0]), np.array([0.1])) == [1.0]
