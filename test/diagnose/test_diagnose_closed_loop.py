"""Axis models under the controller of an axis file, beside what a recording of that loop shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile, load_axis, shipped
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.reference import Legs, Reference
from tcs_friction.diagnose.outcome.closed_loop import ClosedLoop, closed_loop
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

FILE = load_axis(shipped("azimuth_1p2m.yaml"))
COGGING = instance(effect("cogging"), {"order": 400.0, "amplitude": 15.0, "phase": 0.3})
TRUE = FILE.axis.with_effect(COGGING)
MOTION = Reference(Legs(speed=5e-3, leg=2.0, acceleration=2e-2, duration=24.0))
WINDOW = 1.0  # s


def recorded(run: LoopRun, reference: bool = True) -> DataSet:
    return prepare([Recording(run.t, run.position, run.torque, reference=run.reference if reference else None)])


@pytest.fixture(scope="module")
def run() -> LoopRun:
    """What the axis with cogging did under the file's controller."""
    assert FILE.control is not None
    return simulate_loop(TRUE, MOTION, FILE.control.controller, FILE.control.loop, seed=1)


def loop_of(data: DataSet, file: AxisFile = FILE) -> ClosedLoop:
    found = closed_loop(data, file, WINDOW)
    assert found is not None
    return found


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def test_the_true_axis_follows_as_recorded_and_the_believed_one_does_not(run: LoopRun) -> None:
    loop = loop_of(recorded(run))
    true, believed = loop.errors(TRUE), loop.errors(FILE.axis)
    tracking = rms((run.reference - run.position)[run.t > 1.0])
    assert len(true) >= 4
    assert rms(true) < 0.2 * tracking
    assert rms(believed) > 3.0 * rms(true)
    assert loop.predicts(true)


def test_another_controller_than_the_files_is_noticed(run: LoopRun) -> None:
    assert FILE.control is not None
    gains = FILE.control.controller
    stiff = replace(gains, velocity_proportional=4.0 * gains.velocity_proportional, position_proportional=60.0)
    loop = loop_of(recorded(run), replace(FILE, control=replace(FILE.control, controller=stiff)))
    assert not loop.predicts(loop.errors(TRUE))


def test_without_a_controller_or_a_reference_there_is_nothing_to_compare(run: LoopRun) -> None:
    assert closed_loop(recorded(run), replace(FILE, control=None), WINDOW) is None
    loop = loop_of(recorded(run, reference=False))
    errors = loop.errors(TRUE)
    assert len(errors) == 0
    assert not loop.predicts(errors)


def test_an_axis_that_is_unstable_misses_by_the_whole_travel(run: LoopRun) -> None:
    data = recorded(run)
    late = replace(TRUE, actuation_delay=0.2)
    assert loop_of(data).errors(late) == pytest.approx(np.ptp(data.joined("position")))


def test_signals_and_temperature_are_those_of_the_recording(run: LoopRun) -> None:
    """A torque from a signal that the loop did not have is missed without it and with its mirror image."""
    assert FILE.control is not None
    wind = instance(effect("wind_torque"), {"coefficient": 4.0}, signal="wind_speed")
    blown: Axis = FILE.axis.with_effect(wind)
    t = run.t
    gusts = 3.0 + 2.0 * np.sin(2.0 * np.pi * 1.5 * t)
    moved = simulate_loop(blown, MOTION, FILE.control.controller, FILE.control.loop, exogenous={"wind_speed": gusts})

    def missed(speed: np.ndarray) -> float:
        signals = {"wind_speed": speed}
        data = prepare([Recording(moved.t, moved.position, moved.torque, reference=moved.reference, exogenous=signals)])
        return rms(loop_of(data).errors(blown))

    assert missed(gusts) < 0.2 * missed(np.zeros_like(gusts))
