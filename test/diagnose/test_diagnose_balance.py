"""Conditioning, balance and selection: filters, free numbers, spectra, and a concealed effect found again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.dataset.preprocessing import condition, low_pass, step_of
from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.parameters import at_bound, free_parameters, get, moved, put
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.search.candidates import feeds_on_noise
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.machine import build, tick
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording

COGGING = instance(effect("cogging"), {"order": 24.0, "amplitude": 0.6, "phase": 1.0})


def axis(*effects: Instance) -> Axis:
    values = {"coulomb": 2.0, "stiffness": 800.0, "viscous": 1.5}
    return Axis("turntable", 1.2, instance(law("dahl_viscous"), values), effects)


def recording(real: Axis, seconds: float = 60.0, seed: int = 1) -> Recording:
    """A proportional-integral velocity loop with torque and encoder noise follows legs at three speeds and sinusoids."""
    period, noise = 2e-3, np.random.default_rng(seed)
    machine = build(real, period / 20, 20)
    t = period * np.arange(int(seconds / period))
    speed = 0.8 * np.sin(2 * np.pi * t / 12.0) + 0.3 * np.sin(2 * np.pi * 0.9 * t)
    position, torque = np.empty(len(t)), np.empty(len(t))
    integral, command, drift = 0.0, 0.0, 0.0
    for k, wanted in enumerate(speed):
        position[k] = machine.body[0] + 2e-6 * noise.standard_normal()
        error = wanted - machine.body[1]
        integral += period * error
        command = 20.0 * error + 60.0 * integral
        torque[k] = command
        drift = 0.9 * drift + 0.05 * noise.standard_normal()
        tick(machine, command + drift, 0.0, 0.0)
    return Recording(t, position, torque)


@pytest.fixture(scope="module")
def plain() -> Recording:
    return recording(axis())


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


def test_free_numbers_go_in_as_they_came_out() -> None:
    subject = axis(COGGING, instance(effect("torque_bias"), {"bias": -0.3}))
    free = free_parameters(subject, 1.0)
    again = put(subject, free, get(subject, free))
    assert again.inertia == pytest.approx(subject.inertia)
    for old, new in zip(subject.effects, again.effects, strict=True):
        assert dict(new.values) == pytest.approx(dict(old.values))


def test_one_number_moves_and_all_others_stay_as_they_are() -> None:
    subject = axis(COGGING, instance(effect("actuator_lag"), {"time_constant": 1e-3}))
    free = free_parameters(subject, 1.0)
    numbers = get(subject, free)
    for k, f in enumerate(free):
        after = moved(subject, free, k, f.scale)
        assert get(after, free) == pytest.approx(numbers + f.scale * (np.arange(len(free)) == k), rel=1e-9)
        untouched = [item for index, item in enumerate(after.effects) if index != f.owner]
        assert all(any(item is old for old in subject.effects) for item in untouched)
        assert at_bound(subject, free, k) == 0
    longest = subject.without_effect(subject.effects[1]).with_effect(subject.effects[1].replace(time_constant=10.0))
    assert at_bound(longest, free, len(free) - 1) == 1


def test_held_out_data_are_no_train_data(plain: Recording) -> None:
    data = condition([plain])
    train, held = data.joined("train"), data.joined("held_out")
    assert not (train & held).any()
    assert 0.15 < held.mean() < 0.3


def test_the_true_axis_leaves_whitened_noise(plain: Recording) -> None:
    balance = Balance(condition([plain]))
    fit = settle(balance, axis())
    assert fit.squares / balance.effective_count == pytest.approx(1.0, abs=0.25)
    assert fit.axis.inertia == pytest.approx(1.2, rel=0.05)
    assert fit.axis.friction.values["coulomb"] == pytest.approx(2.0, rel=0.03)  # the feedback takes 2 % of it


def test_only_effects_that_feed_on_noise_have_to_be_material() -> None:
    assert feeds_on_noise(effect("load_dependent_friction"))
    assert feeds_on_noise(effect("cable_hysteresis"))
    assert feeds_on_noise(effect("position_dependent_inertia"))
    assert not feeds_on_noise(effect("coulomb_asymmetry"))
    assert not feeds_on_noise(effect("torque_ripple"))
    assert not feeds_on_noise(effect("cogging"))


def test_the_step_of_a_coarse_encoder_is_found() -> None:
    position = 1.0 + np.cumsum(np.random.default_rng(0).uniform(-1e-5, 3e-5, 20_000))
    assert step_of(position) == 0.0
    assert step_of(2e-6 * np.round(position / 2e-6)) == pytest.approx(2e-6, rel=1e-6)
    assert step_of(np.array([0.0, 2.0 * math.pi / 4096, 2.0 * math.pi / 1024])) == pytest.approx(2.0 * math.pi / 4096)


def test_a_recording_without_motion_is_refused() -> None:
    t = np.arange(0.0, 10.0, 1e-2)
    with pytest.raises(InputError, match="position never changes"):
        diagnose([Recording(t, np.zeros(len(t)), np.sin(t))], AxisFile(axis()))
