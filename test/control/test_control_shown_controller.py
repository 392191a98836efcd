"""The controller that a recording shows: gains found again, with honest errors, or the file's where it explains as much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.config import default_control
from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.control.shown_controller import Run, Shown, filtered_speed, shown_by
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance

LUGRE = {"coulomb": 7.0, "static": 9.0, "stribeck_velocity": 5e-3, "stiffness": 9000.0, "damping": 60.0, "viscous": 11.0}
DRIVE = Drive(limit=200.0, noise=0.05)
AXIS = Axis("axis", 4.2, instance(law("lugre"), LUGRE), sensors=Sensors(noise=1e-6, velocity_bandwidth=100.0), drive=DRIVE)
TRUE = default_control(AXIS).controller
WRONG = replace(TRUE, velocity_proportional=2.0 * TRUE.velocity_proportional, inertia_feedforward=0.0)
REFERENCE = Reference(Sinusoid(amplitude=0.05, period=3.0, duration=9.0))
PROPORTIONAL = TRUE.velocity_proportional * TRUE.position_proportional + TRUE.velocity_integral
INTEGRAL = TRUE.velocity_integral * TRUE.position_proportional


def recorded(every: int = 1, controller: PidConfig = TRUE) -> LoopRun:
    return simulate_loop(AXIS, REFERENCE, controller, LoopConfig(period=2e-3), seed=every)


def run_of(loop: LoopRun, every: int = 1, late: int = 0) -> Run:
    """Every so many samples; torque so many samples earlier than the loop has it."""
    part = slice(None, len(loop.t) - late, every)
    t, torque = loop.t[part].copy(), loop.torque[late:][::every].copy()
    return Run(t, REFERENCE.over(t), loop.error[part].copy(), loop.velocity[part].copy(), torque[: len(t)])


def gains(shown: Shown) -> dict[str, float]:
    return dict(zip(("D", "P", "I", "J", "B"), shown.gains[:, 0].tolist(), strict=True))


@pytest.mark.parametrize("late", [0, 1])
def test_gains_are_found_again_whichever_instant_the_torque_stands_at(late: int) -> None:
    shown = shown_by(run_of(recorded(), late=late), WRONG, DRIVE)
    assert shown.estimated
    assert shown.explained > 0.999
    assert shown.by_file < 0.98
    found = gains(shown)
    assert found["P"] == pytest.approx(PROPORTIONAL, rel=1e-3)
    assert found["I"] == pytest.approx(INTEGRAL, rel=1e-2)
    assert found["J"] == pytest.approx(4.2, rel=0.05)
    simulated = [simulate_loop(AXIS, REFERENCE, one, LoopConfig(period=2e-3), seed=3).error for one in (TRUE, shown.controller)]
    assert np.std(simulated[1]) == pytest.approx(np.std(simulated[0]), rel=0.01), "another division, the same controller"


def test_samples_that_are_left_out_make_gains_less_sure() -> None:
    every, tenth = (shown_by(run_of(recorded(), step), WRONG, DRIVE) for step in (1, 10))
    assert tenth.gains[1, 1] > 3.0 * every.gains[1, 1]
    assert gains(tenth)["P"] == pytest.approx(PROPORTIONAL, rel=0.1)
    assert np.all(np.diag(tenth.spread.covariance) >= 0.0)


def test_the_files_controller_is_kept_where_it_explains_the_torque() -> None:
    shown = shown_by(run_of(recorded()), TRUE, DRIVE)
    assert not shown.estimated
    assert shown.controller is TRUE
    assert shown.by_file > 0.999
    assert not shown.spread
    nearly = replace(TRUE, viscous_feedforward=1e-3)
    assert shown_by(run_of(recorded()), nearly, DRIVE).controller is nearly, "what it misses is less than the drive's noise"
    assert shown_by(run_of(recorded()), nearly, replace(DRIVE, noise=0.0)).estimated


def test_a_torque_that_no_such_controller_makes_is_told() -> None:
    run = run_of(recorded())
    noise = np.random.default_rng(0).standard_normal(len(run.t))
    shown = shown_by(replace(run, torque=10.0 * noise), WRONG, DRIVE)
    assert not shown.estimated
    assert shown.explained < 0.05
    assert shown.controller is WRONG
    turned = shown_by(replace(run, torque=-run.torque), WRONG, DRIVE)
    assert not turned.estimated, "gains of the wrong sign are none"


def test_torque_that_was_added_has_to_be_taken_away() -> None:
    loop = simulate_loop(
        AXIS, REFERENCE, TRUE, LoopConfig(period=2e-3, compensation="model"), seed=1, cancellation=Cancellation(AXIS)
    )
    with_it = run_of(loop)
    without = replace(with_it, torque=with_it.torque - loop.compensation)
    assert shown_by(without, TRUE, DRIVE).by_file > 0.999
    assert shown_by(with_it, TRUE, DRIVE).by_file < 0.5


def test_torque_at_the_limit_is_no_gain() -> None:
    run = run_of(recorded())
    limit = 0.9 * float(np.abs(run.torque).max())
    cut = replace(run, torque=np.clip(run.torque, -limit, limit))
    found = shown_by(cut, WRONG, replace(DRIVE, limit=limit))
    assert gains(found)["P"] == pytest.approx(PROPORTIONAL, rel=0.01)
    assert gains(shown_by(cut, WRONG, DRIVE))["P"] != pytest.approx(PROPORTIONAL, rel=0.01)


def test_a_speed_that_was_not_recorded_is_what_the_controller_makes_of_the_position() -> None:
    loop = recorded()
    speed = filtered_speed(loop.t, loop.position, 100.0)
    assert speed[50:] == pytest.approx(loop.velocity[50:], abs=1e-9)
    assert filtered_speed(loop.t, loop.position, 0.0)[1:] == pytest.approx(np.diff(loop.position) / 2e-3)
