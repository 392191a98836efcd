"""Bias of the inertia by noise that residual and acceleration share: measured, corrected, and nothing without a drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope
from open_loop_cases import axis, item

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.errors_in_variables import AttenuationBias, attenuation_bias
from tcs_friction.diagnose.fit.joint_fit import fit_untimed, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.fit.noise_estimate import driven_part
from tcs_friction.diagnose.fit.parameters import Part, free_parameters, read_numbers, with_numbers
from tcs_friction.diagnose.fit.second_body import log_inertia, motion_gain
from tcs_friction.physics.axis import Axis

FREQUENCY = np.linspace(0.0, 20.0, 129)


def spectra(answer: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Noise of variance one, and an inertial torque that takes a multiple of it away again beside noise of its own."""
    rng = np.random.default_rng(seed)
    noise, other = ((rng.normal(size=(2, 40, 129)) * [[[1.0]], [[1.0j]]]).sum(axis=0) / np.sqrt(2.0) for _ in range(2))
    return noise, 0.5 * other - answer * noise


@pytest.mark.parametrize("answer", [0.0, 0.8])
def test_what_noise_and_acceleration_share_is_seen_where_nothing_drives_the_axis(answer: float) -> None:
    residual, inertial = spectra(answer)
    residual[:, 20:40], inertial[:, 20:40] = residual[:, 20:40] + 3.0, inertial[:, 20:40] + 100.0  # driven, mismatched
    residual[:, 60] += 50.0  # a line
    found = attenuation_bias(axis(), 1e7, FREQUENCY, residual, inertial, 100.0, np.zeros(129))
    assert np.sum(found.whole) == pytest.approx(2.0 * 100.0 * answer * 129.0, rel=0.06, abs=700.0)


def test_where_no_frequency_is_quiet_nothing_is_corrected() -> None:
    residual, inertial = spectra(0.8)
    found = attenuation_bias(axis(), 1e7, FREQUENCY, residual, inertial + 100.0, 100.0, np.zeros(129))
    assert found.squares(replace(axis(), inertia=1.0)) == 0.0


@pytest.mark.parametrize("answer", [-0.8, 0.8])
def test_far_from_the_axis_noise_gives_no_more_than_near_it(answer: float) -> None:
    """The squares that noise gives to another inertia are never counted as too few."""
    found = attenuation_bias(axis(), 1e7, FREQUENCY, *spectra(answer), 100.0, np.zeros(129))
    whole = float(np.sum(found.whole))
    for factor in (0.5, 0.8, 1.25, 2.0):
        squares = found.squares(replace(axis(), inertia=factor * axis().inertia))
        assert squares >= max(whole * (1.0 - factor), -whole * np.log(factor)) - 1e-9


def test_where_hardly_anything_drives_the_axis_noise_gives_no_squares() -> None:
    found = attenuation_bias(axis(), 1e5, FREQUENCY, *spectra(0.8), 100.0, np.zeros(129))
    lighter, heavier = (found.squares(replace(axis(), inertia=factor * axis().inertia)) for factor in (0.5, 2.0))
    assert lighter > 0.0
    assert heavier == 0.0


def test_the_driven_part_of_an_acceleration_has_the_reference_and_not_the_noise() -> None:
    recording, plant = telescope(drive_noise=0.3, speed=0.01)
    balance = TorqueBalance(prepare([recording], memory=10.0 * plant.bristle))
    fit = settle(balance, plant, white_noise(balance.samples))
    noise = np.random.default_rng(1).standard_normal(len(balance.train)) * 0.1
    wave = 5.0 * np.sin(0.5 * balance.data.joined("t"))
    assert np.std(driven_part(fit.noise, noise)) < 0.1 * np.std(noise)
    found = driven_part(fit.noise, noise + wave)
    assert np.std(found - wave) < 0.2 * np.std(noise + wave)


def test_a_lighter_axis_owes_more_to_noise() -> None:
    swinging = axis(item("flexible_mode", frequency=30.0, damping=0.02, inertia_ratio=0.2))
    residual, inertial = spectra(0.8)
    found = attenuation_bias(swinging, 1e7, FREQUENCY, residual, inertial, 100.0, 0.1 * np.ones(129))
    free = free_parameters(swinging)
    numbers = read_numbers(swinging, free)
    for k, number in enumerate(free):
        step = 1e-3 * np.eye(len(free))[k]
        more, less = (found.squares(with_numbers(swinging, free, numbers + way * step)) for way in (1.0, -1.0))
        slope = (more - less) / 2e-3
        assert found.gradient(swinging, free)[k] == pytest.approx(slope, rel=0.01, abs=1e-6)
        assert (slope != 0.0) == (number.part in (Part.INERTIA, Part.EFFECT))  # the mode's
    lighter, heavier = (found.squares(replace(swinging, inertia=inertia)) for inertia in (990.0, 1010.0))
    assert lighter > found.squares(swinging) > heavier


def test_a_torque_that_is_not_logged_makes_no_axis_lighter() -> None:
    recording, plant = telescope(drive_noise=0.87, speed=0.01)
    balance = TorqueBalance(prepare([recording], memory=10.0 * plant.bristle))
    fit = settle(balance, plant, white_noise(balance.samples))
    plain = fit_untimed(balance, fit.axis, replace(fit.noise, bias=AttenuationBias()), 12)
    assert plain.axis.inertia < 0.992 * plant.inertia
    assert abs(fit.axis.inertia - plant.inertia) < 0.6 * abs(plain.axis.inertia - plant.inertia)


def noise_of(
    known: Axis, frequency: np.ndarray, sensitivity: np.ndarray, position: np.ndarray = FREQUENCY[:1]
) -> AttenuationBias:
    """The bias by noise of an axis, 50 whitened numbers for each frequency."""
    inertia, gain = log_inertia(known, position), motion_gain(known, frequency)
    return AttenuationBias(frequency, sensitivity, inertia, gain, position, 50.0, np.zeros(len(frequency)))


def test_the_jacobian_of_a_closed_loop_is_that_of_its_controller() -> None:
    """What bodies change in it is log |J G s^2 + C|^2, whatever the controller C, in amplitude and in phase."""
    inertia, s = axis().inertia, 2j * np.pi * FREQUENCY[1:]
    controller = inertia * (40.0 * s + 600.0 + 900.0 / s)
    swinging = {ratio: axis(item("flexible_mode", frequency=8.0, damping=0.05, inertia_ratio=ratio)) for ratio in (0.1, 0.3)}

    def jacobian(plant: Axis) -> np.ndarray:
        return np.log(np.abs(inertia * motion_gain(plant, FREQUENCY[1:]) * s**2 + controller) ** 2)

    known = swinging[0.1]
    sensitivity = 1.0 / (1.0 + controller / (inertia * motion_gain(known, FREQUENCY[1:]) * s**2))
    bias = noise_of(known, FREQUENCY[1:], sensitivity)
    change = bias.squares(swinging[0.3]) - bias.squares(known)
    assert change == pytest.approx(-50.0 * float(np.sum(jacobian(swinging[0.3]) - jacobian(known))), rel=1e-9)
    without = bias.squares(axis()) - bias.squares(known)
    assert without == pytest.approx(-50.0 * float(np.sum(jacobian(axis()) - jacobian(known))), rel=1e-9)


def test_at_the_edge_of_stability_the_correction_stays_finite() -> None:
    held = noise_of(axis(), FREQUENCY, np.full(129, 2.0))
    rigid = axis(item("flexible_mode", frequency=1e3, damping=0.05, inertia_ratio=0.5))
    assert np.isfinite(held.squares(rigid))


def test_an_inertia_that_changes_over_the_position_moves_its_mean() -> None:
    position = np.linspace(0.0, 0.5, 65)
    bias = noise_of(axis(), FREQUENCY, np.full(129, 0.8), position)
    changing = axis(item("position_dependent_inertia", amplitude=0.3, phase=0.4))
    mean = float(np.exp(np.mean(np.log(1.0 + 0.3 * np.cos(2.0 * position + 0.4)))))
    assert mean > 1.1
    assert bias.squares(changing) == pytest.approx(bias.squares(replace(axis(), inertia=mean * axis().inertia)), rel=1e-9)
    free = free_parameters(changing)
    slopes = {number.name: slope for number, slope in zip(free, bias.gradient(changing, free), strict=True) if slope}
    assert set(slopes) == {"inertia", "amplitude"}


def test_where_few_blocks_are_quiet_the_answer_is_that_of_more_frequencies() -> None:
    """One block at each of half of the frequencies: alone it would be as uncertain as the noise is large."""
    residual, inertial = spectra(0.8)
    inertial[1:, 40:104] += 100.0
    found = attenuation_bias(axis(), 1e7, FREQUENCY, residual, inertial, 100.0, np.zeros(129)).sensitivity
    alone = -(np.conj(residual) * inertial)[0]
    assert np.std(found[44:100] - 0.8) < 0.3 * np.std(alone[44:100] - 0.8)
    assert np.abs(found - 0.8).max() < 0.4
