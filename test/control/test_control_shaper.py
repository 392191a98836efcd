"""Shaped references: what a body on a spring does after them, and that nothing else of the reference changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.config import load_axis, shipped
from tcs_friction.control.loop import Cancellation, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.control.reference import UNSHAPED, ConstantSpeed, Legs, Reference, Sinusoid, Steps
from tcs_friction.control.shaper import NONE, ZV, ZVD, Shaper
from tcs_friction.control.swing import swing
from tcs_friction.errors import InputError
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import INERTIA, VELOCITY, instance

PERIOD = 1e-3
FREQUENCY, DAMPING = 9.0, 0.01
START = ConstantSpeed(1e-3, duration=8.0)


def left(kind: str, wrong: float = 1.0) -> float:
    """Largest deflection, a second after a start from rest, over that after an unshaped one."""
    times = np.arange(0.0, START.duration, PERIOD)
    late = times > 1.0

    def largest(shaper: Shaper) -> float:
        position = Reference(START, shaper).over(times)[:, 0]
        return float(np.abs(swing(position, PERIOD, FREQUENCY, DAMPING)[late]).max())

    return largest(Shaper(kind, FREQUENCY * wrong, DAMPING)) / largest(UNSHAPED)


def test_the_mode_is_left_at_rest() -> None:
    assert left(ZV) < 1e-3
    assert left(ZVD) < 1e-3


def test_three_impulses_tolerate_a_wrong_frequency() -> None:
    """To first order: a tenth of the error leaves a tenth with two impulses, and a hundredth with three."""
    assert left(ZV, 1.10) == pytest.approx(np.sin(0.5 * np.pi * 0.1), rel=0.15)
    assert left(ZVD, 1.10) == pytest.approx(np.sin(0.5 * np.pi * 0.1) ** 2, rel=0.3)


@given(st.sampled_from([ZV, ZVD]), st.floats(0.1, 100.0), st.floats(0.0, 0.9))
def test_weights_are_shares(kind: str, frequency: float, damping: float) -> None:
    shaper = Shaper(kind, frequency, damping)
    weights, delays = shaper.impulses().T
    assert weights.sum() == pytest.approx(1.0)
    assert (weights > 0.0).all()
    assert delays[0] == 0.0
    assert np.diff(delays) == pytest.approx(0.5 / (frequency * np.sqrt(1.0 - damping**2)))
    assert 0.0 < shaper.delay < delays[-1]


@pytest.mark.parametrize("config", [Sinusoid(duration=5.0), Legs(duration=5.0), Steps(duration=5.0)])
def test_without_a_shaper_nothing_changes(config: Sinusoid | Legs | Steps) -> None:
    times = np.linspace(-1.0, 5.0, 1001)
    plain, shaped = Reference(config), Reference(config, Shaper(NONE, 3.0, 0.2))
    assert np.array_equal(plain.over(times), shaped.over(times))
    assert plain.at(0.7) == shaped.at(0.7)


def test_a_shaped_reference_is_the_weighted_sum_of_delayed_ones() -> None:
    config, shaper = Sinusoid(amplitude=0.02, period=3.0, duration=5.0), Shaper(ZVD, 2.0, 0.05)
    shaped, plain = Reference(config, shaper), Reference(config)
    t = 2.3
    expected = sum(weight * np.array(plain.at(t - delay)) for weight, delay in shaper.impulses())
    assert np.array(shaped.at(t)) == pytest.approx(expected, rel=1e-12)
    assert shaped.over([t])[0] == pytest.approx(expected, rel=1e-12)
    assert shaped.duration == plain.duration


def test_a_shaped_reference_rests_before_it_begins() -> None:
    shaped = Reference(ConstantSpeed(1e-3, start=0.4, duration=5.0), Shaper(ZV, 2.0, 0.0))
    assert shaped.at(-0.1) == (pytest.approx(0.4), 0.0, 0.0)
    assert shaped.at(0.1)[:2] == (pytest.approx(0.4 + 0.5e-4), pytest.approx(0.5e-3))


def test_a_reference_keeps_the_shaper_it_has() -> None:
    own, other = Shaper(ZV, 2.0), Shaper(ZVD, 3.0)
    assert Reference(START, own).shaped_unless(other).shaper == own
    assert Reference(START).shaped_unless(other).shaper == other


def test_the_swing_is_that_of_the_effect() -> None:
    """The torque of `flexible_mode` is that of its deflection, for the same motion of the shaft."""
    mode = effect("flexible_mode")
    values = {"frequency": 12.0, "damping": 0.03, "inertia_ratio": 0.3}
    assert mode.rings is not None
    frequency, damping = mode.rings(values)
    times = np.arange(0.0, 3.0, PERIOD)
    position = Reference(Legs(speed=2e-3, leg=0.5, acceleration=0.02, duration=3.0)).over(times)[:, 0]
    deflection = swing(position, PERIOD, frequency, damping)
    motion, state, inertia = np.zeros(16), np.zeros(4), 100.0
    speed = np.gradient(position, PERIOD)
    omega = 2.0 * np.pi * frequency
    rate = np.gradient(deflection, PERIOD)
    expected = -values["inertia_ratio"] * inertia * (omega**2 * deflection + 2.0 * damping * omega * rate)
    found = np.zeros_like(times)
    for k, value in enumerate(speed):
        motion[:] = 0.0
        motion[VELOCITY], motion[INERTIA] = value, inertia
        found[k] = mode.kernel(motion, np.array(list(values.values())), state, PERIOD)
    assert found == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_the_body_behind_a_controlled_axis_comes_to_rest() -> None:
    """A step of the 1.2 m telescope, whose friction and mode are cancelled."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    assert file.control is not None
    mode = instance(effect("flexible_mode"), {"frequency": 9.0, "damping": 0.01, "inertia_ratio": 0.3})
    axis = replace(file.axis, effects=(mode,))
    assert mode.term.rings is not None
    frequency, damping = mode.term.rings(mode.values)
    loop = replace(file.control.loop, compensation="model")

    def left_after_the_step(shaper: Shaper) -> float:
        reference = Reference(Steps(height=1e-4, dwell=1.0, duration=2.0), shaper)
        run = simulate_loop(axis, reference, file.control.controller, loop, cancellation=Cancellation(axis, CancellationConfig()))
        deflection = swing(run.true_position, float(run.t[1] - run.t[0]), frequency, damping)
        return float(np.abs(deflection[run.t > 1.5]).max())

    before = left_after_the_step(UNSHAPED)
    assert before > 0.2e-4
    assert left_after_the_step(Shaper(ZVD, frequency, damping)) < 0.05 * before


@pytest.mark.parametrize(
    ("shaper", "expected"),
    [
        (Shaper("zvdd"), "kind is 'zvdd', expected one of none, zv, zvd"),
        (Shaper(ZV, 0.0), "frequency is 0, expected a number from 0.001"),
        (Shaper(ZV, 1.0, 1.0), "damping is 1, expected a number from 0 to 0.99"),
    ],
)
def test_a_bad_shaper_is_refused(shaper: Shaper, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        Reference(START, shaper)
