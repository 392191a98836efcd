"""Plant response and the calibration of an observer against known plants and gains."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from tcs_friction.errors import InputError
from tcs_friction.identify.dob_calibration import calibrate, uniform_motion
from tcs_friction.identify.plant_response import (
    fit_second_order,
    fit_two_inertias,
    frequency_response,
    two_inertias,
)

RATE = 2000.0


def driven(
    numerator: list[float], denominator: list[float], noise: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, white torque and the speed of a transfer function with measurement noise."""
    random = np.random.default_rng(0)
    t = np.arange(60_000) / RATE
    torque = random.standard_normal(len(t))
    top, bottom, _ = cont2discrete((numerator, denominator), 1.0 / RATE, method="bilinear")
    speed = lfilter(top.ravel(), bottom, torque)
    return t, torque, speed + noise * np.std(speed) * random.standard_normal(len(t))


def test_equation_10_is_recovered() -> None:
    t, torque, speed = driven([1.0], [0.0003, 0.1082, 39.3918], 0.05)
    measured = frequency_response(t, torque, speed, 2.0, 150.0)
    assert measured.coherence[measured.frequency < 60.0].min() > 0.9
    found = fit_second_order(measured)
    assert found.parameters["second"] == pytest.approx(0.0003, rel=0.03)
    assert found.parameters["first"] == pytest.approx(0.1082, rel=0.03)
    assert found.parameters["constant"] == pytest.approx(39.3918, rel=0.03)
    assert 0.0 < found.std["constant"] < 0.05 * 39.3918


def test_two_inertias_are_recovered() -> None:
    inertia, viscous, ratio, damping, corner = 2.0, 5.0, 0.4, 0.05, 2.0 * np.pi * 20.0
    spring = [2.0 * damping * corner, corner**2]
    body = [1.0, *spring]
    near = np.polymul([inertia * (1.0 - ratio), viscous], body)
    far = np.polymul([ratio * inertia, 0.0], spring)
    t, torque, speed = driven(body, np.polyadd(near, far).tolist(), 0.02)
    found = fit_two_inertias(frequency_response(t, torque, speed, 2.0, 150.0))
    truth = {"inertia": inertia, "ratio": ratio, "frequency": 20.0, "damping": damping}
    for name, value in truth.items():
        assert found.parameters[name] == pytest.approx(value, rel=0.08), name


def test_two_inertias_far_below_resonance_are_one() -> None:
    s = 2.0j * np.pi * np.array([0.1])
    assert two_inertias(s, 2.0, 5.0, 0.4, 50.0, 0.05) == pytest.approx(1.0 / (2.0 * s + 5.0), rel=1e-4)


def test_too_short_a_recording_is_named() -> None:
    t = np.arange(1000) / RATE
    with pytest.raises(InputError, match="plant response"):
        frequency_response(t, t, t, 1.0, 10.0)


def test_calibration_finds_gain_offset_and_inertia() -> None:
    """Legs at constant speed with turns between; the observer has gain, offset, lag and a wrong inertia."""
    t = 1e-3 * np.arange(40_000)
    velocity = 1.7e-3 * np.clip(4.0 * np.sin(2.0 * np.pi * t / 10.0), -1.0, 1.0)
    acceleration = np.gradient(velocity, t)
    friction = 78.0 * np.tanh(velocity / 1e-4) + 500.0 * velocity
    late = np.interp(t - 0.02, t, (friction - 1.5 - 60.0 * acceleration) / 1.08)
    measured = friction + 0.1 * np.random.default_rng(0).standard_normal(len(t))
    found = calibrate(t, velocity, late, measured, lag=0.02)
    assert found.gain == pytest.approx(1.08, rel=1e-3)
    assert found.offset == pytest.approx(1.5, abs=0.02)
    assert found.inertia_error == pytest.approx(60.0, rel=0.1)
    assert found.accuracy_uniform > 0.995
    assert found.accuracy > 0.98 > found.accuracy_before
    assert found.corrected(late, acceleration).shape == t.shape


def test_uniform_motion_is_found() -> None:
    t = 1e-2 * np.arange(1000)
    velocity = np.where(t < 5.0, 1.0, 1.0 + np.sin(3.0 * t))
    steady = uniform_motion(t, velocity)
    assert steady[100:450].all()
    assert not steady[560:900].any()
    assert not uniform_motion(t, 0.0 * t).any()


def test_without_uniform_motion_there_is_no_calibration() -> None:
    t = 1e-2 * np.arange(1000)
    with pytest.raises(InputError, match="uniform motion"):
        calibrate(t, np.sin(9.0 * t), np.sin(9.0 * t), np.sin(9.0 * t))
