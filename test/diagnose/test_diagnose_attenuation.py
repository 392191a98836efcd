"""Recordings of a closed loop with noise that nobody logs: inertia without its bias, alignment, an unknown history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope, telescope_file
from proof_cases import axis, item, recorded

from tcs_friction.diagnose.dataset.preprocessing import condition
from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.fit.errors_in_variables import Attenuation, attenuation
from tcs_friction.diagnose.fit.joint_fit import settle, untimed
from tcs_friction.diagnose.fit.parameters import free_parameters, get, put
from tcs_friction.diagnose.pipeline import diagnose

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
    found = attenuation(axis(), 1e7, FREQUENCY, residual, inertial, 100.0, np.zeros(129))
    assert np.sum(found.whole) == pytest.approx(2.0 * 100.0 * answer * 129.0, rel=0.06, abs=700.0)


def test_where_hardly_anything_drives_the_axis_nothing_is_corrected() -> None:
    assert attenuation(axis(), 1e5, FREQUENCY, *spectra(0.8), 100.0, np.zeros(129)).feigned(replace(axis(), inertia=1.0)) == 0.0


def test_a_lighter_axis_owes_more_to_noise() -> None:
    swinging = axis(item("flexible_mode", frequency=30.0, damping=0.02, inertia_ratio=0.2))
    residual, inertial = spectra(0.8)
    found = attenuation(swinging, 1e7, FREQUENCY, residual, inertial, 100.0, 0.1 * np.ones(129))
    free = free_parameters(swinging, 1.0)
    numbers = get(swinging, free)
    for k, number in enumerate(free):
        step = 1e-3 * np.eye(len(free))[k]
        slope = (found.feigned(put(swinging, free, numbers + step)) - found.feigned(put(swinging, free, numbers - step))) / 2e-3
        assert found.slope(swinging, free)[k] == pytest.approx(slope, rel=0.01, abs=1e-6)
        assert (slope != 0.0) == (number.owner in (-2, 0))  # the inertia, the mode's
    lighter, heavier = (found.feigned(replace(swinging, inertia=inertia)) for inertia in (990.0, 1010.0))
    assert lighter > found.feigned(swinging) > heavier


def test_a_torque_that_is_not_logged_makes_no_axis_lighter() -> None:
    recording, plant = telescope(drive_noise=0.87, speed=0.01)
    balance = Balance(condition([recording], memory=10.0 * plant.bristle), plant.actuation_delay)
    fit = settle(balance, plant)
    balance.attenuation = Attenuation()
    plain = untimed(balance, fit.axis, 12)
    assert plain.axis.inertia < 0.992 * plant.inertia
    assert abs(fit.axis.inertia - plant.inertia) < 0.6 * abs(plain.axis.inertia - plant.inertia)


def test_nothing_is_named_for_a_torque_that_is_not_logged() -> None:
    recording, plant = telescope(drive_noise=0.87, speed=0.027)
    assert diagnose([recording], telescope_file().with_axis(plant)).verdict == "match"


def test_alignment_is_no_wrong_parameter() -> None:
    """A torque is held for a period, so the logged one acts half of it early; the plant's own delay is stated."""
    recording, plant = telescope(drive_noise=0.05, speed=0.01)
    found = diagnose([recording], telescope_file().with_axis(plant))
    late = found.axis_file.axis.actuation_delay - plant.actuation_delay
    assert late == pytest.approx(-0.5e-3, abs=0.15e-3)
    assert found.believed.held_out > 1.5 * found.retuned.held_out
    assert found.verdict == "match"
    assert f"acts {-1e3 * late:.2g} ms earlier than stated" in found.statement


def test_friction_before_a_recording_is_not_held_against_the_model() -> None:
    """It begins at a reversal, the bristles bent by where the axis came from."""
    recording, plant = telescope(drive_noise=0.05, speed=0.01)
    ways = np.sign(np.diff(recording.position[::100]))
    turns = 100 * (1 + np.flatnonzero(ways[1:] * ways[:-1] < 0.0))
    part = recording.part(slice(turns[0], len(recording)))
    wrong = Balance(condition([part]), plant.actuation_delay)
    right = Balance(condition([part], memory=10.0 * plant.bristle), plant.actuation_delay)
    assert np.abs(wrong.residual(plant)[wrong.train]).max() > 10.0
    assert np.abs(right.residual(plant)[right.train]).max() < 1.0
    assert diagnose([part], telescope_file().with_axis(plant)).verdict == "match"


def test_a_start_that_lasts_too_long_is_compared() -> None:
    recording = recorded(axis())
    span = float(np.ptp(recording.position))
    kept = [condition([recording], held_out=False, memory=m).joined("train").argmax() for m in (0.0, 0.01 * span, 0.99 * span)]
    assert kept[0] == kept[2] < kept[1]
