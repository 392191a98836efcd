"""The closed loop offline: the same numbers as tick by tick, nothing cancelled twice, errors in words."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.control.compensator import CompensatorConfig, LugreCompensator, LugreParameters
from tcs_friction.control.loop import LoopConfig, LoopRun, simulate_loop, without_friction
from tcs_friction.control.observer import FrictionObserver, NominalPlant
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.pid import DoubleLoopPid, PidConfig
from tcs_friction.control.reference import Legs, Reference
from tcs_friction.control.tracking import ARCSEC, tracking_errors
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance

LUGRE = LugreParameters()
AXIS = Axis(
    "azimuth",
    1000.0,
    instance(
        law("lugre"),
        dict(
            zip(
                ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous"),
                LUGRE.packed(),
                strict=True,
            )
        ),
    ),
    (instance(effect("cogging"), {"order": 72, "amplitude": 0.5, "phase": 0.3}),),
    actuation_delay=0.001,
    sensors=Sensors(0.005 * ARCSEC, 0.01 * ARCSEC, 100.0),
    drive=Drive(1000.0, 0.25, 10.0),
)
LATE = 0.0016
CONTROLLER = PidConfig(
    position_proportional=32.0,
    velocity_proportional=1.5e5,
    velocity_integral=3.5e6,
    inertia_feedforward=1000.0,
    velocity_delay=LATE,
)
DOB = ObserverSettings(NominalPlant(0.0, 1000.0, 0.0), 15.0, actuation_delay=0.001, velocity_delay=LATE)
COMPENSATOR = CompensatorConfig(LUGRE, LUGRE, actuation_delay=0.001)
REFERENCE = Reference(Legs(speed=1.745e-3, leg=3.0, acceleration=5e-3, duration=15.0))


def run(config: LoopConfig, axis: Axis = AXIS, scale: float = 1.0, seed: int = 0) -> LoopRun:
    told = LugreParameters(*(scale * x for x in LUGRE.packed()))
    return simulate_loop(
        axis, REFERENCE, CONTROLLER, config, DOB, CompensatorConfig(told, told, actuation_delay=0.001), seed
    )


def rms(run: LoopRun) -> float:
    return tracking_errors(run.t, run.reference_velocity, run.error / ARCSEC, settle=2.0).rms


PLAIN = run(LoopConfig())
DOB_ONLY = run(LoopConfig(feed_back=True))
LUGRE_ONLY = run(LoopConfig(compensation="lugre"))
BOTH = run(LoopConfig(compensation="lugre", feed_back=True))


def tick_by_tick(feed_back_everything: bool = False) -> LoopRun:
    """The loop as the nodes run it, from the classes; optionally with friction wrongly fed back twice."""
    plant = Simulator(AXIS, 1e-3, seed=0, position=REFERENCE.at(0.0)[0])
    pid, dob = DoubleLoopPid(CONTROLLER, 1e-3), FrictionObserver(DOB, 1e-3)
    compensator = LugreCompensator(COMPENSATOR, 1e-3)
    torque, cancelled, rows = 0.0, 0.0, []
    for k in range(len(BOTH.t)):
        q_ref, v_ref, a_ref = REFERENCE.at(k * 1e-3)
        position, velocity = plant.measured_position, plant.measured_velocity
        estimate = dob.step(torque, velocity, cancelled)
        rows.append(
            (
                q_ref,
                v_ref,
                position,
                velocity,
                torque,
                cancelled,
                estimate,
                dob.rest,
                plant.friction,
                plant.opposing,
                plant.position,
                plant.velocity,
            )
        )
        cancelled = compensator.step(v_ref, a_ref)
        added = cancelled + (estimate if feed_back_everything else dob.rest)
        torque = plant.step(pid.step(position, velocity, q_ref, v_ref, a_ref, added))
    return LoopRun(BOTH.t.copy(), *np.array(rows).T.copy())


def test_compiled_loop_is_the_classes_tick_by_tick_bit_for_bit() -> None:
    stepped = tick_by_tick()
    for name in ("position", "torque", "compensation", "friction_estimate", "rest_estimate", "friction"):
        np.testing.assert_array_equal(getattr(BOTH, name), getattr(stepped, name), err_msg=name)


def test_same_seed_same_run() -> None:
    np.testing.assert_array_equal(run(LoopConfig()).position, PLAIN.position)
    assert np.any(run(LoopConfig(), seed=1).position != PLAIN.position)


def test_each_help_improves_and_none_spoils_the_other() -> None:
    assert rms(DOB_ONLY) < 0.4 * rms(PLAIN)
    assert rms(LUGRE_ONLY) < 0.2 * rms(PLAIN)
    assert rms(BOTH) < 1.2 * rms(LUGRE_ONLY)
    assert rms(BOTH) < rms(DOB_ONLY)


def test_friction_is_cancelled_once() -> None:
    """Compensation and feedback together give the friction; the whole estimate fed back gives it twice."""
    sliding = (np.abs(BOTH.reference_velocity) > 1.7e-3) & (BOTH.t > 2.0)
    for scale in (1.0, 0.5):
        both = run(LoopConfig(compensation="lugre", feed_back=True), scale=scale)
        cancelled = both.compensation + both.rest_estimate
        assert np.mean(cancelled[sliding] / both.friction[sliding]) == pytest.approx(1.0, abs=0.02)
    twice = tick_by_tick(feed_back_everything=True)
    assert rms(twice) > 2.0 * rms(BOTH)


def test_rest_is_what_the_compensator_lacks() -> None:
    sliding = (np.abs(BOTH.reference_velocity) > 1.7e-3) & (BOTH.t > 2.0)
    half = run(LoopConfig(compensation="lugre", feed_back=True), scale=0.5)
    assert np.mean(half.rest_estimate[sliding] / half.friction[sliding]) == pytest.approx(0.5, abs=0.05)
    assert np.mean(half.friction_estimate[sliding] / half.friction[sliding]) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("loop", [PLAIN, DOB_ONLY, LUGRE_ONLY, BOTH])
def test_observer_measures_friction_within_three_percent(loop: LoopRun) -> None:
    keep = loop.t > 2.0
    error = np.sqrt(np.mean((loop.friction_estimate - loop.friction)[keep] ** 2))
    # the time since the last reversal is short here, so this run is harder than the bar's
    assert error / np.sqrt(np.mean(loop.friction[keep] ** 2)) < 0.045


def test_torque_is_that_of_the_tick_before() -> None:
    assert PLAIN.torque[0] == 0.0
    acceleration = 5e-3  # of the reference at the start, which the controller expects to measure late
    late = CONTROLLER.velocity_proportional * CONTROLLER.velocity_delay * acceleration
    assert PLAIN.torque[1] == pytest.approx(1000.0 * acceleration - late)


def test_limits_hold() -> None:
    weak = simulate_loop(AXIS, REFERENCE, replace(CONTROLLER, torque_limit=50.0))
    assert np.max(np.abs(weak.torque)) <= 50.0


def test_friction_switched_off_keeps_the_other_effects() -> None:
    free = run(LoopConfig(), axis=without_friction(AXIS))
    assert np.max(np.abs(free.friction)) < 1e-6
    assert np.max(np.abs(free.opposing)) > 0.4
    assert rms(free) < 0.2 * rms(PLAIN)


def test_arrays_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        PLAIN.position[0] = 1.0


def test_unstable_loop_is_told() -> None:
    tipping = instance(effect("cable_wrap"), {"stiffness": -1e10})
    with pytest.raises(JobError, match="azimuth: the loop became unstable at"):
        simulate_loop(AXIS.with_effect(tipping), REFERENCE, CONTROLLER)


@pytest.mark.parametrize(
    ("config", "found"),
    [
        (LoopConfig(feed_back=True), "feed_back is on but there is no observer"),
        (LoopConfig(compensation="lugre"), "compensation is lugre without parameters"),
        (LoopConfig(compensation="magic"), "compensation is 'magic'"),
        (LoopConfig(period=math.nan), "period is nan"),
    ],
)
def test_bad_loop_is_refused(config: LoopConfig, found: str) -> None:
    with pytest.raises(InputError, match=found):
        simulate_loop(AXIS, REFERENCE, CONTROLLER, config)
