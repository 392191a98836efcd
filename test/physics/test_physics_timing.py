"""An instant means one thing for every term: what it gives for a logged instant is its torque at that instant.

A term that is late by part of a step is in error in proportion to the step. What is in time is in error by its square.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from physics_cases import INERTIA, SIGNALS, VALUES, axis_with, plain, rms

from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import rate_at

DURATION, STEP, FINE = 6.0, 4e-3, 64  # s; s of the coarser log; parts of it that count as exact
SETTLED = 1.0  # s, after which what a memory did not know at the start is forgotten
SECOND_ORDER = 2.5  # at half the step an error of second order is a quarter (a third where friction jumps), one of first a half
ROUNDING = 1e-9  # of the effect
KNOCKS = {"backlash"}  # an instant of contact is known to a step; but for that it is `pressed`


def sines(t: np.ndarray, *parts: tuple[float, float, float]) -> np.ndarray:
    """(3, n): a sum of sines, amplitude, rad/s and phase of each, with its first two derivatives."""
    waves = [
        [a * np.sin(w * t + p), a * w * np.cos(w * t + p), -a * w * w * np.sin(w * t + p)]
        for a, w, p in parts
    ]
    return np.ascontiguousarray(np.sum(waves, axis=0))


def demand(axis: Axis, step: float) -> np.ndarray:
    """Required less available torque (n,) of one motion, logged every `step` (s), N m."""
    t = step * np.arange(round(DURATION / step) + 1)
    q, v, a = sines(t, (0.05, 2.0, 0.3), (0.004, 9.0, 1.0), (0.0005, 31.0, 2.0)) + np.array(
        [[0.3], [0.0], [0.0]]
    )
    torque = INERTIA * a + 100.0 * np.tanh(v / 0.01)
    other, wind = sines(t, (0.3, 8.2, 0.0))[0], 1.0 + sines(t, (2.0, 2.5, 0.0))[0]
    signals = np.stack([20.0 + 5.0 * np.sin(t), other, wind])
    out = np.empty((len(t), 8))
    built = machine.build(axis, step, 1, SIGNALS, q[0])
    machine.evaluate(built, t, q, v, a, torque, signals, 1e-7, out)
    return np.asarray(out[:, machine.REQUIRED] - out[:, machine.ROTOR])


def pressed() -> Axis:
    """A backlash without a gap: always in contact."""
    knocking = plain("backlash").replace(gap=0.0, contact_frequency=12.0)
    return replace(axis_with(), effects=(knocking,))


def errors(axis: Axis) -> tuple[float, float, float]:
    """Rms of an effect's torque, of its error in a log of STEP and in one of half of it, N m."""
    base = axis_with(friction=axis.friction)

    def own(step: float) -> np.ndarray:
        every, begin = round(STEP / step), round(SETTLED / STEP)
        return np.asarray((demand(axis, step) - demand(base, step))[::every][begin:-2])

    exact = own(STEP / FINE)
    return rms(exact), rms(own(STEP) - exact), rms(own(0.5 * STEP) - exact)


@pytest.mark.parametrize(
    "axis",
    [*map(axis_with, sorted(set(VALUES) - KNOCKS)), pressed()],
    ids=lambda x: str(x.effects[0].term.id),
)
def test_an_effect_is_in_time(axis: Axis) -> None:
    size, coarse, fine = errors(axis)
    print(
        f"{axis.effects[0].term.id}: {size:.3g} N m, {coarse / size:.2g} left at {STEP:g} s, {fine / size:.2g} at half of it"
    )
    assert fine < max(coarse / SECOND_ORDER, ROUNDING * size)


def test_a_rate_is_in_phase() -> None:
    """A difference to the sample before is half a step late."""
    t = 0.01 * np.arange(400)
    for per_period, least in ((24, 0.998), (6, 0.95)):
        w = 2.0 * math.pi / (per_period * 0.01)
        rates = np.array([rate_at(np.sin(w * t), i, 0.01) for i in range(len(t))])[2:-2]
        columns = np.stack([np.cos(w * t), np.sin(w * t)], axis=1)[2:-2]
        in_phase, out_of_phase = np.linalg.lstsq(columns, rates / w, rcond=None)[0]
        assert least < in_phase < 1.0
        assert abs(out_of_phase) < 1e-9
    assert rate_at(t, 5, 0.0) == 0.0
    assert [rate_at(3.0 * t, i, 0.01) for i in (0, 1, 398, 399)] == pytest.approx([3.0] * 4)


def test_a_simulated_coupling_is_in_time() -> None:
    """What the other axis does by the middle of a period acts in that period, though its next value is not known yet."""
    period, w = 2e-3, 8.2
    simulator = Simulator(axis_with("cross_axis_coupling"), period, signals=SIGNALS, substeps=1)
    late = []
    for k in range(1000):
        simulator.step(0.0, exogenous=(0.3 * math.sin(w * k * period), 0.0))
        late.append(simulator.opposing - 60.0 * 0.3 * w * math.cos(w * (k + 0.5) * period))
    one_period_late = 60.0 * 0.3 * w * w * period
    assert rms(np.array(late[3:])) < 0.02 * one_period_late
