"""A safe reference: begins where the axis is, joins its programme within the limits, comes to rest at its end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tcs_friction.config import default_control, load_axis
from tcs_friction.control.joining import JoinedReference, Phase, _way, check_programme
from tcs_friction.control.plausible import (
    MotionLimits,
    Ranges,
    compensation_limit,
    motion_limits,
    ranges,
)
from tcs_friction.control.reference import ConstantSpeed, Legs, Reference, Sinusoid, Steps
from tcs_friction.errors import InputError, JobError

CONFIG = Path(__file__).resolve().parents[2] / "config"
LIMITS = MotionLimits(speed_limit=0.08, acceleration_limit=0.2, jerk_limit=2.0, following_limit=4e-3)
TICK = 2e-3


def walked(joined: JoinedReference, begin: float, end: float) -> np.ndarray:
    """Shape (n, 3): samples every tick."""
    return np.array([joined.at(t) for t in np.arange(begin, end, TICK)])


def expect_smooth(samples: np.ndarray, jerk: float) -> None:
    """Speed and position are integrals of a limited acceleration: no jump anywhere."""
    position, speed, acceleration = samples.T
    assert np.abs(acceleration).max() <= LIMITS.acceleration_limit * (1.0 + 1e-9)
    assert np.abs(np.diff(acceleration)).max() <= jerk * TICK * (1.0 + 1e-6)
    # the trapezium rule errs by jerk h^3/12 in position and jerk h^2/8 in speed
    assert np.abs(np.diff(speed) - 0.5 * TICK * (acceleration[1:] + acceleration[:-1])).max() < jerk * TICK**2
    assert np.abs(np.diff(position) - 0.5 * TICK * (speed[1:] + speed[:-1])).max() < jerk * TICK**3


@settings(max_examples=10, deadline=None)
@given(
    position=st.floats(-0.05, 0.05),
    speed=st.floats(-0.12, 0.12),
    phase=st.floats(-3.0, 3.0),
    begin=st.floats(0.1, 1.0),
)
def test_it_joins_from_anywhere_without_a_jump(position: float, speed: float, phase: float, begin: float) -> None:
    programme = Reference(Sinusoid(amplitude=0.02, period=8.0, phase=phase, duration=4.0))
    joined = JoinedReference(LIMITS)
    joined.begin_at(0.0, position, speed)
    assert joined.at(0.0) == pytest.approx((position, speed, 0.0), abs=1e-12)
    before = walked(joined, 0.0, begin)
    until = joined.join(begin, programme)
    on_the_way = walked(joined, begin, begin + until)
    running = walked(joined, begin + until, begin + until + 3.9)
    stopping = walked(joined, begin + until + 4.0, begin + until + 6.0)
    samples = np.concatenate([before, on_the_way])
    assert np.abs(samples[:, 1]).max() <= max(LIMITS.speed_limit, abs(speed)) + 1e-9
    expect_smooth(on_the_way, LIMITS.jerk_limit)
    assert running == pytest.approx(programme.over(TICK * np.arange(len(running))), abs=1e-9)
    expect_smooth(stopping, LIMITS.jerk_limit)
    assert joined.phase is Phase.REST
    assert stopping[-1, 1:] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_it_rests_until_it_is_told_to_begin() -> None:
    joined = JoinedReference(LIMITS)
    joined.begin_at(0.0, 1.25, 0.0)
    samples = walked(joined, 0.0, 5.0)
    assert np.all(samples == [1.25, 0.0, 0.0])
    assert joined.phase is Phase.REST


def test_it_stops_within_the_limits() -> None:
    joined = JoinedReference(LIMITS)
    joined.begin_at(0.0, 0.0, 0.0)
    until = joined.join(0.0, Reference(ConstantSpeed(velocity=0.05)))
    running = walked(joined, 0.0, until + 1.0)
    assert joined.phase is Phase.RUNNING
    seconds = joined.stop(until + 1.0)
    samples = np.concatenate([running, walked(joined, until + 1.0, until + 1.0 + seconds + 0.1)])
    expect_smooth(samples[len(running) :], LIMITS.jerk_limit)
    assert joined.phase is Phase.REST
    assert samples[-1, 1] == 0.0


@given(
    speed=st.floats(-10.0, 10.0),
    acceleration=st.floats(1e-9, 1e12),
    jerk=st.floats(1e-9, 1e15),
    position=st.floats(-1e9, 1e9),
)
def test_it_always_comes_to_rest(speed: float, acceleration: float, jerk: float, position: float) -> None:
    """Whatever the limits are: a node that could not slow down would end instead."""
    joined = JoinedReference(MotionLimits(0.08, acceleration, jerk, 4e-3))
    joined.begin_at(0.0, position, speed)
    assert joined.at(0.0)[:2] == pytest.approx((position, speed), abs=1e-9)
    joined.at(1e30)
    assert joined.phase is Phase.REST
    assert joined.at(1e30)[1:] == (0.0, 0.0)


def test_it_slows_down_where_ruckig_finds_no_way() -> None:
    limits = MotionLimits(0.08, 31078.270372493276, 483098851.268068, 4e-3)
    position, speed = 1188.5004304787155, -2.766503634891139
    with pytest.raises(JobError):
        _way((position, speed, 0.0), limits)
    joined = JoinedReference(limits)
    joined.begin_at(0.0, position, speed)
    seconds = -speed / limits.acceleration_limit
    half = joined.at(0.5 * seconds)
    assert half == pytest.approx((position + 0.375 * speed * seconds, 0.5 * speed, limits.acceleration_limit), rel=1e-9)
    assert joined.at(seconds) == pytest.approx((position + 0.5 * speed * seconds, 0.0, 0.0), rel=1e-9)
    assert joined.phase is Phase.REST


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (ConstantSpeed(velocity=0.09), "a speed of 0.09, expected at most speed_limit, 0.08"),
        (Legs(speed=0.05, acceleration=0.3), "acceleration of 0.3"),
        (Steps(height=0.01), "a step of 0.01, expected at most following_limit"),
    ],
)
def test_a_programme_beyond_the_limits_is_refused(config: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_programme(Reference(config), LIMITS)


def test_the_limits_of_the_telescope() -> None:
    file = load_axis(CONFIG / "azimuth_1p2m.yaml")
    assert file.control is not None
    pid = file.control.controller
    limits, plausible = motion_limits(file.axis, pid), ranges(file.axis, pid)
    assert limits.speed_limit < pid.velocity_limit < plausible.largest_speed
    assert limits.acceleration_limit * file.axis.inertia < pid.torque_limit < plausible.largest_torque
    assert 117.2 < compensation_limit(file.axis, pid) < pid.torque_limit
    unlimited = default_control(file.axis).controller
    assert motion_limits(file.axis, unlimited).speed_limit < 1.0
    assert ranges(file.axis, unlimited).largest_speed < 10.0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e308, 1e308])
def test_nonsense_is_out_of_range(value: float) -> None:
    plausible = Ranges()
    assert plausible.state_objection(value, 0.0)
    assert plausible.state_objection(0.0, value)
    assert plausible.torque_objection(value)
    for numbers in ((value, 0.0, 0.0), (0.0, value, 0.0), (0.0, 0.0, value)):
        assert plausible.reference_objection(1000.0, *numbers)
    assert not plausible.reference_objection(1000.0, 1.0, 0.1, 0.5)
