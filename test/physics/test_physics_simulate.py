"""The simulator: determinism, sensors, drive, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from physics_cases import COULOMB, LUGRE, SIGNALS, VALUES, axis_with, plain, run

from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.simulate import Simulator, simulate_open_loop

NOISY = Axis(
    "noisy",
    1000.0,
    LUGRE,
    (plain("cogging"), plain("flexible_mode"), plain("transport_delay")),
    sensors=Sensors(resolution=2.4e-8, noise=4.8e-8, velocity_bandwidth=100.0),
    drive=Drive(limit=200.0, noise=0.25),
)


def ticks(axis: Axis, seed: int, count: int = 3000) -> np.ndarray:
    simulator = Simulator(axis, seed=seed)
    rows = []
    for i in range(count):
        simulator.step(150.0 * math.sin(5e-3 * i))
        rows.append((simulator.measured_position, simulator.measured_velocity, simulator.friction))
    return np.array(rows)


def test_same_seed_same_motion_bit_for_bit() -> None:
    assert np.array_equal(ticks(NOISY, 7), ticks(NOISY, 7))
    assert not np.array_equal(ticks(NOISY, 7), ticks(NOISY, 8))


def test_all_effects_at_once_are_deterministic_and_finite() -> None:
    axis = axis_with(*sorted(set(VALUES) - {"stribeck", "presliding"}), friction=LUGRE)
    first, second = run(axis, duration=0.5), run(axis, duration=0.5)
    assert np.array_equal(first.position, second.position)
    assert np.isfinite(first.position).all()


@pytest.mark.parametrize("command", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_torque_is_refused_and_moves_nothing(command: float) -> None:
    simulator = Simulator(Axis("a", 1.0, COULOMB), position=0.5)
    with pytest.raises(InputError, match="torque command"):
        simulator.step(command)
    assert simulator.ticks == 0
    assert simulator.position == 0.5


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan])
def test_period_has_to_be_positive(period: float) -> None:
    with pytest.raises(InputError, match="period"):
        Simulator(Axis("a", 1.0, COULOMB), period)


def test_saturation_limits_what_is_applied() -> None:
    simulator = Simulator(replace(NOISY, drive=Drive(limit=5.0)))
    assert simulator.step(7.0) == 5.0
    assert simulator.step(-7.0) == -5.0
    assert simulator.step(3.0) == 3.0


def test_encoder_rounds_to_its_resolution_after_noise() -> None:
    axis = Axis("a", 1000.0, COULOMB, sensors=Sensors(resolution=1e-6, noise=3e-6))
    simulator = Simulator(axis, seed=1, position=0.1)
    seen = []
    for _ in range(4000):
        simulator.step(0.0)
        seen.append(simulator.measured_position)
    counts = np.array(seen) / 1e-6
    assert np.abs(counts - np.rint(counts)).max() < 1e-6
    assert np.std(seen) == pytest.approx(math.hypot(3e-6, 1e-6 / math.sqrt(12.0)), rel=0.05)
    assert np.mean(seen) == pytest.approx(0.1, abs=3e-7)
    assert simulator.position == 0.1


def test_velocity_is_the_filtered_difference_of_measured_positions() -> None:
    axis = replace(NOISY, sensors=Sensors(resolution=2.4e-8, noise=4.8e-8, velocity_bandwidth=100.0))
    rows = ticks(axis, 3, 500)
    gain = 1.0 - math.exp(-2.0 * math.pi * 100.0 * 1e-3)
    expected = 0.0
    for before, row in zip(np.vstack([np.zeros(3), rows]), rows, strict=False):
        expected += gain * ((row[0] - before[0]) / 1e-3 - expected)
        assert row[1] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    plain_difference = ticks(replace(NOISY, sensors=Sensors()), 3, 500)
    assert plain_difference[1:, 1] == pytest.approx(np.diff(plain_difference[:, 0]) / 1e-3)


def test_torque_noise_has_its_size_and_colour() -> None:
    """Seen through a frictionless inertia: the noise is all that accelerates it."""
    free = COULOMB.replace(coulomb=1e-9, viscous=0.0)
    axis = Axis("a", 1.0, free, drive=Drive(noise=0.25, noise_bandwidth=10.0))
    simulator = Simulator(axis, seed=2, substeps=1)
    velocity = [0.0]
    for _ in range(60000):
        simulator.step(0.0)
        velocity.append(simulator.velocity)
    torque = np.diff(velocity) / 1e-3
    assert torque.std() == pytest.approx(0.25, rel=0.06)
    correlation = np.corrcoef(torque[:-16], torque[16:])[0, 1]
    assert correlation == pytest.approx(math.exp(-2.0 * math.pi * 10.0 * 0.016), abs=0.08)


def test_true_values_are_those_of_the_equation_of_motion() -> None:
    simulator = Simulator(Axis("a", 1000.0, LUGRE, (plain("cogging"),)), period=1e-4, substeps=1)
    for i in range(20000):
        before = simulator.velocity
        applied = simulator.step(200.0 * math.sin(1e-3 * i))
        acceleration = (simulator.velocity - before) / 1e-4
        assert 1000.0 * acceleration == pytest.approx(
            applied - simulator.friction - simulator.opposing, abs=1e-6
        )


def test_open_loop_is_the_simulator_without_noise() -> None:
    torque = 150.0 * np.sin(5e-3 * np.arange(2000))
    axis = Axis("a", 1000.0, LUGRE, (plain("cogging"),))
    result = simulate_open_loop(axis, torque, 1e-3, position=0.2)
    simulator = Simulator(axis, position=0.2)
    for value in torque:
        simulator.step(value)
    assert result.position[-1] == simulator.position
    assert result.t[0] == pytest.approx(1e-3)
    assert len(result.friction) == len(result.opposing) == len(result.velocity) == 2000


def test_temperature_and_recorded_signals_act_when_given() -> None:
    simulator = Simulator(axis_with("wind_torque", friction=COULOMB), signals=SIGNALS)
    simulator.step(0.0, exogenous=(0.0, 3.0))
    assert simulator.opposing == pytest.approx(18.0)


def test_an_axis_is_linear_when_it_says_so() -> None:
    """A linear axis with the same numbers moves as the rotary one; only orders count per metre."""
    torque = 150.0 * np.sin(5e-3 * np.arange(1000))
    rotary = simulate_open_loop(Axis("a", 1000.0, LUGRE), torque, 1e-3)
    linear = simulate_open_loop(Axis("a", 1000.0, LUGRE, kind="linear"), torque, 1e-3)
    assert np.array_equal(rotary.position, linear.position)
    per_turn = plain("cogging").replace(order=72.0 * 2.0 * math.pi)
    one = simulate_open_loop(Axis("a", 1000.0, LUGRE, (per_turn,)), torque, 1e-3)
    other = simulate_open_loop(Axis("a", 1000.0, LUGRE, (plain("cogging"),), kind="linear"), torque, 1e-3)
    assert other.position == pytest.approx(one.position, abs=1e-12)


def test_encoder_error_at_the_start_is_no_jump() -> None:
    """The encoder has seen the start position already: at rest its velocity is zero from the first tick on."""
    simulator = Simulator(axis_with("encoder_periodic_error", friction=COULOMB), position=0.3)
    assert simulator.measured_position == pytest.approx(0.3 + 1e-4 * math.sin(40.0 * 0.3 + 0.4))
    simulator.step(0.0)
    assert simulator.measured_velocity == 0.0
