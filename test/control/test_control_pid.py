"""The double-loop PID: exact filters, step response, limits, windup."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from tcs_friction.control.pid import DoubleLoopPid, PidConfig
from tcs_friction.errors import InputError

DT = 1e-3
OPEN = PidConfig(
    position_proportional=0.0,
    velocity_proportional=0.0,
    velocity_integral=0.0,
    velocity_feedforward=0.0,
    velocity_limit=1e6,
    torque_limit=1e12,
)


def held_response(numerator: list[float], denominator: list[float], samples: np.ndarray) -> np.ndarray:
    b, a, _ = signal.cont2discrete((numerator, denominator), DT, method="zoh")
    return np.asarray(signal.lfilter(np.ravel(b), a, samples))


@pytest.fixture
def noise() -> np.ndarray:
    samples = np.random.default_rng(1).standard_normal(500)
    samples[0] = 0.0  # the filters start at the first sample
    return samples


def test_velocity_loop_is_the_held_equivalent(noise: np.ndarray) -> None:
    p, i, d, tau = 3.0, 40.0, 0.2, 0.013
    config = replace(
        OPEN, velocity_proportional=p, velocity_integral=i, velocity_derivative=d, derivative_filter=tau
    )
    pid = DoubleLoopPid(config, DT)
    torque = [pid.step(0.0, -x, 0.0, 0.0, 0.0) for x in noise]
    expected = p * noise + held_response([i], [1.0, 0.0], noise) + held_response([d, 0.0], [tau, 1.0], noise)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-9)


def test_position_loop_is_the_held_equivalent(noise: np.ndarray) -> None:
    p, i, d, tau = 5.0, 7.0, 0.3, 0.02
    config = replace(
        OPEN,
        position_proportional=p,
        position_integral=i,
        position_derivative=d,
        derivative_filter=tau,
        velocity_proportional=1.0,
    )
    pid = DoubleLoopPid(config, DT)
    speed = [pid.step(-x, 0.0, 0.0, 0.0, 0.0) for x in noise]
    expected = p * noise + held_response([i], [1.0, 0.0], noise) + held_response([d, 0.0], [tau, 1.0], noise)
    np.testing.assert_allclose(speed, expected, rtol=0, atol=1e-9)


def test_disturbance_step_on_a_free_inertia() -> None:
    """Three equal poles at -w: the position after a step T of torque is T t^2 / (2 J) exp(-w t)."""
    inertia, w, dt, push = 1000.0, 20.0, 1e-4, 100.0
    # J s^3 + kv s^2 + kv kp s + kv Ki = J (s + w)^3
    kp, kv = w, 3.0 * inertia * w
    config = replace(
        OPEN,
        position_proportional=kp,
        position_integral=w**2 / 3.0,
        velocity_proportional=kv,
    )
    pid = DoubleLoopPid(config, dt)
    position, velocity, errors = 0.0, 0.0, []
    t = dt * np.arange(5000)
    for _ in t:
        errors.append(position)
        net = pid.step(position, velocity, 0.0, 0.0, 0.0) + push
        position += velocity * dt + 0.5 * net / inertia * dt * dt
        velocity += net / inertia * dt
    expected = push * t**2 / (2.0 * inertia) * np.exp(-w * t)
    np.testing.assert_allclose(errors, expected, rtol=0, atol=0.01 * np.max(expected))


def test_reference_is_followed_by_feedforward_alone() -> None:
    inertia, viscous, rate = 50.0, 8.0, 3.0
    config = replace(OPEN, inertia_feedforward=inertia, viscous_feedforward=viscous, velocity_feedforward=1.0)
    pid = DoubleLoopPid(config, DT)
    v, a = math.sin(rate), rate * math.cos(rate)
    assert pid.step(0.0, 0.0, 0.0, v, a) == pytest.approx(inertia * a + viscous * v)
    assert pid.step(0.0, 0.0, 0.0, v, a, added=12.5) == pytest.approx(inertia * a + viscous * v + 12.5)


def test_late_speed_of_an_accelerating_axis_is_no_error() -> None:
    pid = DoubleLoopPid(replace(PidConfig(), velocity_delay=0.002), DT)
    assert pid.step(0.0, 0.5 - 0.002 * 3.0, 0.0, 0.5, 3.0) == pytest.approx(0.0, abs=1e-9)


def test_integrator_leaves_the_limit_at_once_when_the_error_turns() -> None:
    config = PidConfig(torque_limit=10.0)
    pid = DoubleLoopPid(config, DT)
    for _ in range(20000):
        assert pid.step(0.0, 0.0, 0.01, 0.0, 0.0) == 10.0
    ticks = 0
    while pid.step(0.0, 0.0, -0.001, 0.0, 0.0) > 0.0:
        ticks += 1
    # wound up freely it would take 200 s to unwind; held at the limit, a few of the loop's own times
    assert ticks * DT < 5.0 * config.velocity_proportional / config.velocity_integral


def test_position_integrator_stops_at_the_limits() -> None:
    config = replace(
        OPEN, position_integral=1.0, position_proportional=1.0, velocity_proportional=1.0, velocity_limit=0.5
    )
    pid = DoubleLoopPid(config, DT)
    for _ in range(10000):
        pid.step(-1.0, 0.0, 0.0, 0.0, 0.0)
    assert pid.step(0.2, 0.0, 0.0, 0.0, 0.0) < 0.0  # 10 s of integral would outweigh this error


def test_first_tick_has_no_derivative_kick() -> None:
    pid = DoubleLoopPid(replace(OPEN, position_derivative=1.0, velocity_proportional=1.0), DT)
    assert pid.step(0.0, 0.0, 1.0, 0.0, 0.0) == 0.0
    assert pid.step(0.0, 0.0, 1.001, 0.0, 0.0) > 0.0


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=5), st.floats(1e-3, 1e3))
def test_torque_stays_within_its_limit(values: list[float], limit: float) -> None:
    pid = DoubleLoopPid(replace(PidConfig(), torque_limit=limit, position_integral=3.0), DT)
    for _ in range(5):
        assert abs(pid.step(*values)) <= limit


def test_reset_forgets() -> None:
    pid = DoubleLoopPid(PidConfig(), DT)
    first = pid.step(0.0, 0.0, 1e-5, 0.0, 0.0)
    assert pid.step(0.0, 0.0, 1e-5, 0.0, 0.0) != first
    pid.reset()
    assert pid.step(0.0, 0.0, 1e-5, 0.0, 0.0) == first


def test_change_is_whole_or_refused() -> None:
    pid = DoubleLoopPid(PidConfig(), DT)
    for _ in range(10):
        before = pid.step(0.0, 0.0, 1e-5, 0.0, 0.0)
    with pytest.raises(InputError, match="velocity_proportional is nan"):
        pid.configure(replace(PidConfig(), position_proportional=1.0, velocity_proportional=math.nan))
    assert pid.config == PidConfig()
    pid.configure(PidConfig())
    assert pid.step(0.0, 0.0, 1e-5, 0.0, 0.0) > before  # the integrator went on
