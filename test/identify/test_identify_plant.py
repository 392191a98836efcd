"""Plant response against known plants: open and closed loop, with its uncertainty; models fitted to it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from tcs_friction.errors import InputError
from tcs_friction.identify.plant_response import (
    Excited,
    Response,
    fit_second_order,
    fit_two_inertias,
    frequency_response,
    of_recordings,
    second_order,
    stretches,
    two_inertias,
)
from tcs_friction.recording.recording import Recording

RATE = 2000.0
EQUATION_10 = [0.0003, 0.1082, 39.3918]


def driven(numerator: list[float], denominator: list[float], noise: float, seed: int = 0) -> Excited:
    """White torque and the speed of a transfer function with measurement noise."""
    random = np.random.default_rng(seed)
    torque = random.standard_normal(60_000)
    top, bottom, _ = cont2discrete((numerator, denominator), 1.0 / RATE, method="bilinear")
    speed = lfilter(top.ravel(), bottom, torque)
    return Excited(RATE, torque, speed + noise * np.std(speed) * random.standard_normal(len(torque)))


def test_equation_10_is_recovered() -> None:
    measured = frequency_response([driven([1.0], EQUATION_10, 0.05)], 2.0, 150.0)
    assert measured.coherence[measured.frequency < 60.0].min() > 0.9
    found = fit_second_order(measured)
    for name, value in zip(("second", "first", "constant"), EQUATION_10, strict=True):
        assert found.parameters[name] == pytest.approx(value, rel=0.03)
    assert found.misfit < 0.1
    assert found.parameters["delay"] == pytest.approx(0.0, abs=2e-4)


def test_two_inertias_are_recovered() -> None:
    truth = {"inertia": 2.0, "viscous": 5.0, "inertia_ratio": 0.4, "frequency": 25.0, "damping": 0.05}
    lower = np.sqrt(1.0 - truth["inertia_ratio"])
    corner, ratio = 2.0 * np.pi * truth["frequency"] * lower, truth["damping"] * lower
    spring = [2.0 * ratio * corner, corner**2]
    body = [1.0, *spring]
    near = np.polymul([truth["inertia"] * (1.0 - truth["inertia_ratio"]), truth["viscous"]], body)
    far = np.polymul([truth["inertia_ratio"] * truth["inertia"], 0.0], spring)
    part = driven(body, np.polyadd(near, far).tolist(), 0.02)
    found = fit_two_inertias(frequency_response([part], 2.0, 150.0))
    for name in ("inertia", "inertia_ratio", "frequency", "damping"):
        assert found.parameters[name] == pytest.approx(truth[name], rel=0.08), name
    assert fit_second_order(frequency_response([part], 2.0, 150.0)).misfit > 3.0 * found.misfit


def test_the_fit_says_how_sure_it_is() -> None:
    """Response with errors of the stated size: the parameters' errors are of the stated size too."""
    random = np.random.default_rng(0)
    frequency = np.geomspace(2.0, 150.0, 80)
    truth = second_order(2j * np.pi * frequency, *EQUATION_10)
    std, scores = np.full(80, 0.02), []
    for _ in range(30):
        noise = random.standard_normal((2, 80)) * std
        found = fit_second_order(
            Response(frequency, truth * (1.0 + noise[0] + 1j * noise[1]), np.ones(80), std)
        )
        scores += [
            (found.parameters[name] - value) / found.std[name]
            for name, value in zip(("second", "first", "constant"), EQUATION_10, strict=True)
        ]
    assert 0.75 < float(np.std(scores)) < 1.25


def test_two_inertias_far_below_resonance_are_one() -> None:
    s = 2.0j * np.pi * np.array([0.1])
    assert two_inertias(s, 2.0, 5.0, 0.4, 50.0, 0.05) == pytest.approx(1.0 / (2.0 * s + 5.0), rel=1e-4)


def test_the_stated_uncertainty_is_that_of_the_errors() -> None:
    ratios = []
    for seed in range(8):
        measured = frequency_response([driven([1.0], EQUATION_10, 0.3, seed)], 4.0, 40.0)
        truth = second_order(2j * np.pi * measured.frequency, *EQUATION_10)
        ratios.append((np.abs(measured.response) / np.abs(truth) - 1.0) / measured.std)
    assert 0.8 < float(np.std(np.concatenate(ratios))) < 1.2


def closed_loop(disturbance: float) -> Excited:
    """An inertia under a stiff speed loop: the disturbance comes into the torque through the controller."""
    random = np.random.default_rng(3)
    n, inertia, gain = 80_000, 2.0, 400.0
    wanted, pushed = random.standard_normal((2, n))
    torque, speed = np.zeros(n), np.zeros(n)
    v = 0.0
    for k in range(n):
        torque[k] = gain * (0.01 * wanted[k] - v)
        speed[k] = v
        v += (torque[k] - disturbance * pushed[k] - 5.0 * v) / (inertia * RATE)
    return Excited(RATE, torque, speed, wanted)


def test_a_loop_that_answers_disturbances_does_not_bias_the_response() -> None:
    part = closed_loop(1.5)
    with_instrument = frequency_response([part], 4.0, 40.0)
    without = frequency_response([Excited(RATE, part.torque, part.velocity)], 4.0, 40.0)
    truth = 1.0 / (2.0 * 2j * np.pi * with_instrument.frequency + 5.0)
    delay = np.exp(-2j * np.pi * with_instrument.frequency * 0.5 / RATE)  # Euler's step: half a period late
    assert np.abs(np.mean(with_instrument.response / (truth * delay)) - 1.0) < 0.05
    assert np.abs(np.mean(without.response / (truth * delay)) - 1.0) > 0.25


def held_recording(inertia: float = 2.0, delay: int = 3) -> Recording:
    """A torque held through the period that ends with its stamp, acting some periods late, on an inertia; exact motion."""
    random = np.random.default_rng(1)
    period, n = 1.0 / RATE, 60_000
    torque = random.standard_normal(n)
    late = np.concatenate([np.zeros(delay), torque])[:n]
    speed = np.concatenate([[0.0], np.cumsum(late[1:] * period / inertia)])
    position = np.concatenate([[0.0], np.cumsum(period * (speed[:-1] + 0.5 * late[1:] * period / inertia))])
    return Recording(period * np.arange(n), position, torque)


def test_what_is_known_of_a_recording_is_corrected() -> None:
    found = of_recordings([held_recording()], 4.0, 400.0, actuation_delay=3.0 / RATE)
    truth = 1.0 / (2.0 * 2j * np.pi * found.frequency)
    keep = found.coherence > 0.99
    assert np.max(np.abs(found.response / truth - 1.0)[keep]) < 0.1
    late = of_recordings([held_recording()], 4.0, 400.0)
    turned = np.unwrap(np.angle(late.response / truth)[keep])
    np.testing.assert_allclose(turned, -2.0 * np.pi * found.frequency[keep] * 3.0 / RATE, atol=0.1)
    assert fit_second_order(late).parameters["delay"] == pytest.approx(3.0 / RATE, abs=1e-4)


def test_a_gap_divides_a_recording() -> None:
    whole = held_recording()
    half = len(whole.t) // 2
    keep = np.r_[0 : half - 1000, half : len(whole.t)]
    parts = stretches(
        Recording(
            whole.t[keep], whole.position[keep], whole.torque[keep], reference=whole.position[keep],
            segments=(slice(0, half - 1000), slice(half - 1000, len(keep))),
        )
    )  # fmt: skip
    assert len(parts) == 2
    assert all(part.instrument is not None for part in parts)
    assert (
        frequency_response(parts, 4.0, 40.0).coherence.shape
        == frequency_response(parts[:1], 4.0, 40.0).coherence.shape
    )


def test_what_cannot_be_done_is_named() -> None:
    t = np.arange(1000) / RATE
    part = Excited(RATE, t, t)
    with pytest.raises(InputError, match="of recording"):
        frequency_response([part], 1.0, 10.0)
    with pytest.raises(InputError, match="half the sample rate"):
        frequency_response([part], 1.0, 1000.0)
    with pytest.raises(InputError, match="half the sample rate"):
        frequency_response([part], 5.0, 2.0)
    with pytest.raises(InputError, match="too short"):
        stretches(Recording(t, t, t))
    noise = np.full(20, 0.1)
    with pytest.raises(InputError, match="coherence"):
        fit_second_order(Response(np.arange(1.0, 21.0), np.ones(20, dtype=complex), noise, noise))
