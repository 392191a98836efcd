"""Plant response against known plants."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from tcs_friction.errors import InputError
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
