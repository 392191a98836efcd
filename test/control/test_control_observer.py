"""Disturbance observers: exact discretisation, known friction, delays, nothing cancelled twice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from tcs_friction.control.kalman import kalman_bandwidth
from tcs_friction.control.observer import PAPER_PLANT, FrictionObserver, NominalPlant, ObserverConfig
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import InputError

DT = 1e-3
INERTIA = 1000.0
AXIS = NominalPlant(0.0, INERTIA, 0.0)
DESIGNS: list[ObserverSettings] = [
    ObserverSettings(AXIS, bandwidth=10.0),
    ObserverSettings(AXIS, bandwidth=20.0, estimator="kalman"),
]


def q_filter(bandwidth: float) -> tuple[list[float], list[float]]:
    w = 2.0 * math.pi * bandwidth
    return [w**3], [1.0, 2.0 * w, 2.0 * w**2, w**3]


@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.001, 0.0027])
def test_torque_path_is_the_exact_held_response(delay: float) -> None:
    rng = np.random.default_rng(2)
    torque = np.repeat(rng.standard_normal(40), 5)
    observer = FrictionObserver(ObserverSettings(AXIS, bandwidth=20.0, actuation_delay=delay), DT)
    observer.step(0.0, 0.0)
    estimates = [observer.step(u, 0.0) for u in torque]
    # the continuous filter on a grid that holds the delayed edges exactly
    fine = 1e-4
    held = np.concatenate([np.zeros(round(delay / fine)), np.repeat(torque, 10)])[: 10 * len(torque)]
    b, a, _ = signal.cont2discrete(q_filter(20.0), fine, method="zoh")
    expected = signal.lfilter(np.ravel(b), a, np.append(held, 0.0))[10::10]
    np.testing.assert_allclose(estimates, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("plant", [AXIS, NominalPlant(0.0, 900.0, 500.0), PAPER_PLANT])
def test_speed_path_is_the_exact_response_to_a_linear_course(plant: NominalPlant) -> None:
    speed = np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).standard_normal(200))]) * 1e-3
    observer = FrictionObserver(ObserverSettings(plant, bandwidth=15.0), DT)
    estimates = np.array([observer.step(0.0, v) for v in speed])
    numerator, denominator = q_filter(15.0)
    inverse = -numerator[0] * np.array([plant.second, plant.first, plant.constant])
    inverse = np.trim_zeros(inverse, "f")
    _, expected, _ = signal.lsim((inverse, denominator), speed, DT * np.arange(len(speed)), interp=True)
    np.testing.assert_allclose(estimates, expected, rtol=0, atol=1e-8 * np.max(np.abs(expected)))


@pytest.mark.parametrize("design", DESIGNS)
def test_constant_friction_is_found_exactly(design: ObserverConfig) -> None:
    observer = FrictionObserver(design, DT)
    speed, friction = 0.01, 78.1
    for k in range(2000):
        torque = 100.0 * math.sin(0.01 * k)
        speed += (torque - friction) / INERTIA * DT
        observer.step(torque, speed)
    assert observer.estimate == pytest.approx(friction, rel=1e-6)


@pytest.mark.parametrize("frequency", [0.5, 3.0, 10.0])
def test_sinusoidal_friction_is_seen_through_q(frequency: float) -> None:
    config = ObserverSettings(AXIS, bandwidth=10.0)
    w = 2.0 * math.pi * frequency
    t = DT * np.arange(4000)
    speed = 50.0 / (INERTIA * w) * np.cos(w * t)  # the motion that friction 50 sin(w t) alone makes
    observer = FrictionObserver(config, DT)
    estimates = np.array([observer.step(0.0, v) for v in speed])
    _, response = signal.freqs(*q_filter(10.0), worN=[w])
    expected = 50.0 * np.imag(response[0] * np.exp(1j * w * t))
    np.testing.assert_allclose(estimates[2000:], expected[2000:], rtol=0, atol=0.02)
    if frequency < 1.0:
        delayed = 50.0 * np.sin(w * (t - config.filter_delay))
        np.testing.assert_allclose(estimates[2000:], delayed[2000:], rtol=0, atol=0.1)


def test_kalman_gain_is_where_the_recursion_settles() -> None:
    walk, noise = 30.0, 2e-5
    transition = np.array([[1.0, -DT / INERTIA], [0.0, 1.0]])
    grown = walk**2 * np.array([[DT**3 / 3 / INERTIA**2, -(DT**2) / 2 / INERTIA], [-(DT**2) / 2 / INERTIA, DT]])
    covariance = np.diag([1e-4, 1e4])
    for _ in range(20000):
        predicted = transition @ covariance @ transition.T + grown
        gain = predicted[:, 0] / (predicted[0, 0] + noise**2)
        covariance = predicted - np.outer(gain, predicted[0])
    config = ObserverSettings(AXIS, kalman_bandwidth(AXIS, walk, noise, DT), "kalman")
    np.testing.assert_allclose(config.design(DT).speed_now, gain, rtol=1e-6)


@pytest.mark.parametrize("plant", [AXIS, NominalPlant(0.0, 900.0, 5000.0), PAPER_PLANT])
def test_kalman_bandwidth_and_noises_are_two_ways_to_say_one_thing(plant: NominalPlant) -> None:
    s = 2j * math.pi * 12.0
    density = 1e-3 / abs(s * (plant.second * s * s + plant.first * s + plant.constant))
    assert kalman_bandwidth(plant, 1e-3, density / math.sqrt(DT), DT) == pytest.approx(12.0)


def test_kalman_error_has_the_promised_spread() -> None:
    """On friction that really is a random walk, with the noise it was told of, nothing does better."""
    rng = np.random.default_rng(4)
    n, walk, noise = 100_000, 50.0, 1e-5
    friction = np.cumsum(rng.standard_normal(n)) * walk * math.sqrt(DT)
    speed = np.cumsum(-friction / INERTIA * DT)
    measured = speed + noise * rng.standard_normal(n)

    def spread(design: ObserverConfig) -> float:
        observer = FrictionObserver(design, DT)
        estimates = np.array([observer.step(0.0, v) for v in measured])
        return float(np.sqrt(np.mean((estimates - friction)[1000:] ** 2)))

    best = kalman_bandwidth(AXIS, walk, noise, DT)
    least = spread(ObserverSettings(AXIS, best, "kalman"))
    assert least < min(spread(ObserverSettings(AXIS, factor * best, "kalman")) for factor in (0.7, 1.4))
    assert least < min(spread(ObserverSettings(AXIS, bandwidth)) for bandwidth in (5.0, 10.0, 20.0, 40.0))


@pytest.mark.parametrize("kind", ["dob", "kalman"])
@pytest.mark.parametrize("plant", [AXIS, NominalPlant(0.0, 900.0, 5000.0), PAPER_PLANT])
def test_the_delay_that_is_stated_is_the_delay_of_the_estimate(plant: NominalPlant, kind: str) -> None:
    """Friction that rises slowly, on a plant held at rest: the estimate is the same ramp, later."""
    fine = ObserverSettings(plant, 12.0, kind, velocity_delay=0.002)
    observer = FrictionObserver(fine, 1e-4)
    for k in range(20_000):
        observer.step(3.0 * (k - 0.5) * 1e-4, 0.0)  # the torque that balances it, held through the tick
    late = 2.0 - 1e-4 - observer.estimate / 3.0
    assert late == pytest.approx(fine.filter_delay, rel=5e-3)


@pytest.mark.parametrize("design", DESIGNS)
def test_a_torque_that_is_logged_wrongly_is_corrected(design: ObserverSettings) -> None:
    told = FrictionObserver(replace(design, torque_scale=1.25, torque_offset=3.0), DT)
    right = FrictionObserver(design, DT)
    random = np.random.default_rng(6)
    for _ in range(300):
        u, v, c = random.standard_normal(3) * (100.0, 1e-3, 50.0)
        assert told.step(u, v, c) == pytest.approx(right.step(1.25 * u + 3.0, v, 1.25 * c), abs=1e-9)
        assert 1.25 * told.rest == pytest.approx(right.rest, abs=1e-9), "the rest is a command"


@pytest.mark.parametrize("design", [ObserverSettings(PAPER_PLANT), ObserverSettings(PAPER_PLANT, estimator="kalman")])
def test_second_order_plant_of_eq_10(design: ObserverConfig) -> None:
    dynamics = np.array([[0.0, 1.0], [-39.3918 / 0.0003, -0.1082 / 0.0003]])
    step = signal.cont2discrete(
        (dynamics, np.array([[0.0], [1.0 / 0.0003]]), np.eye(2), np.zeros((2, 1))), DT, method="zoh"
    )
    state = np.zeros(2)
    observer = FrictionObserver(design, DT)
    for k in range(3000):
        torque = 20.0 + math.sin(0.002 * k)
        state = step[0] @ state + step[1][:, 0] * (torque - 7.0)
        observer.step(torque, state[0])
    assert observer.estimate == pytest.approx(7.0, abs=0.05)


@pytest.mark.parametrize("design", DESIGNS)
def test_known_delays_are_allowed_for(design: ObserverSettings) -> None:
    """A torque that acts late on a free axis whose speed is read late: there is no friction to see."""
    told = FrictionObserver(replace(design, actuation_delay=0.0024, velocity_delay=0.0006), DT)
    untold = FrictionObserver(design, DT)
    torque = 300.0 * np.sign(np.sin(2.0 * math.pi * 2.0 * DT * np.arange(3000)))
    late = np.concatenate([np.zeros(3), torque])[:3000]
    speed = np.cumsum(late) / INERTIA * DT
    seen, missed = [], []
    for u, v in zip(torque, speed, strict=True):
        seen.append(told.step(u, v))
        missed.append(untold.step(u, v))
    assert np.max(np.abs(seen)) < 1e-6
    assert np.max(np.abs(missed)) > 5.0


@pytest.mark.parametrize("design", DESIGNS)
def test_rest_is_the_estimate_without_the_compensation(design: ObserverConfig) -> None:
    """Linear: estimate(u) - rest(u, c) is the response to c alone, and rest(u, c) equals estimate(u - c)."""
    rng = np.random.default_rng(5)
    both, difference = FrictionObserver(design, DT), FrictionObserver(design, DT)
    for _ in range(500):
        u, c, v = rng.standard_normal(3) * (100.0, 50.0, 1e-3)
        both.step(u, v, c)
        difference.step(u - c, v)
        assert both.rest == pytest.approx(difference.estimate, abs=1e-7)


@pytest.mark.parametrize("design", DESIGNS)
def test_perfect_compensation_leaves_no_rest(design: ObserverConfig) -> None:
    observer = FrictionObserver(design, DT)
    speed = 0.0
    for k in range(3000):
        friction = 78.0 * math.sin(0.01 * k)
        observer.step(friction + 10.0, speed := speed + 10.0 / INERTIA * DT, friction)
    assert abs(observer.rest) < 1e-6
    assert abs(observer.estimate - friction) < 20.0


@pytest.mark.parametrize("design", DESIGNS)
def test_starting_in_motion_makes_no_transient(design: ObserverConfig) -> None:
    observer = FrictionObserver(design, DT)
    estimates = [observer.step(30.0, 0.7) for _ in range(50)]
    np.testing.assert_allclose(estimates, 30.0, atol=1e-5)
    observer.reset()
    assert observer.step(-5.0, 0.2) == pytest.approx(-5.0, abs=1e-5)


def test_wrong_inertia_shows_as_its_share_of_the_acceleration() -> None:
    observer = FrictionObserver(ObserverSettings(replace(AXIS, first=1.1 * INERTIA)), DT)
    for k in range(2000):
        observer.step(0.2 * INERTIA + 40.0, 0.2 * k * DT)
    assert observer.estimate == pytest.approx(40.0 - 0.1 * 0.2 * INERTIA, rel=1e-6)


@pytest.mark.parametrize(
    ("design", "found"),
    [
        (ObserverSettings(bandwidth=math.nan), "bandwidth is nan"),
        (ObserverSettings(plant=NominalPlant(first=0.0)), r"plant\.first is 0"),
        (ObserverSettings(estimator="luenberger"), "estimator is 'luenberger', expected one of dob, kalman"),
        (ObserverSettings(estimator="kalman", plant=NominalPlant(constant=math.inf)), r"plant\.constant is inf"),
    ],
)
def test_bad_configuration_is_refused_and_changes_nothing(design: ObserverConfig, found: str) -> None:
    observer = FrictionObserver(ObserverSettings(), DT)
    observer.step(1.0, 0.0)
    with pytest.raises(InputError, match=found):
        observer.configure(design)
    assert observer.config == ObserverSettings()
    assert observer.estimate == pytest.approx(1.0)
