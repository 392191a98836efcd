"""Errors of the encoder are judged by what they explain in a recording that no fit has seen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope_file

from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Multisine, Reference
from tcs_friction.diagnose.verification import sensor_effects, sensor_gains
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

TRUE = {"order": 800.0, "amplitude": 2e-6, "phase": 0.5}
WRONG = {
    "sign": {**TRUE, "amplitude": -2e-6},
    "phase": {**TRUE, "phase": 0.5 + 0.5 * math.pi},
    "order": {**TRUE, "order": 900.0},
    "three times the size": {**TRUE, "amplitude": 6e-6},
}


def with_error(axis: Axis, *errors: dict[str, float]) -> Axis:
    return replace(axis, effects=tuple(instance(effect("encoder_periodic_error"), one) for one in errors))


@pytest.fixture(scope="module")
def fresh() -> Recording:
    """60 s of the telescope with an error of its encoder."""
    file = telescope_file()
    assert file.control is not None
    motion = Multisine(0.02, lowest_frequency=0.02, frequency_step=0.05, components=6, duration=60.0)
    control = file.control
    axis = with_error(file.axis, TRUE)
    run = simulate_loop(axis, Reference(motion), control.controller, control.loop, control.observer, control.compensator, 7)
    return Recording(run.t, run.position, run.torque, source="simulated")


def test_an_error_that_is_there_is_proven(fresh: Recording) -> None:
    model = with_error(telescope_file().axis, TRUE)
    assert sensor_effects(model) == ["encoder_periodic_error"]
    gain = sensor_gains([fresh], model, sensor_effects(model))["encoder_periodic_error"]
    assert gain.proven
    assert gain.cancelled < 1.2 < gain.without, "what is left is noise"


@pytest.mark.parametrize("how", WRONG)
def test_an_error_that_is_not_there_is_not(fresh: Recording, how: str) -> None:
    model = with_error(telescope_file().axis, WRONG[how])
    gain = sensor_gains([fresh], model, sensor_effects(model))["encoder_periodic_error"]
    assert not gain.proven
    assert gain.improvement.ratio > 1.0


def test_of_two_errors_the_right_one_is_proven(fresh: Recording) -> None:
    model = with_error(telescope_file().axis, WRONG["order"], TRUE)
    gains = sensor_gains([fresh], model, sensor_effects(model))
    assert [name for name, gain in gains.items() if gain.proven] == ["encoder_periodic_error_2"]


def test_a_recording_without_motion_is_refused() -> None:
    t = np.arange(4000) * 1e-3
    still = Recording(t, np.zeros(4000), np.zeros(4000))
    with pytest.raises(InputError, match="the position never changes"):
        sensor_gains([still], with_error(telescope_file().axis, TRUE), ["encoder_periodic_error"])
