"""Friction compensation from the reference: the model's friction, at the right moment and direction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcs_friction.control.compensator import (
    CompensatorConfig,
    LugreCompensator,
    LugreParameters,
    StribeckFeedforward,
)
from tcs_friction.errors import InputError

DT = 1e-3
POSITIVE = LugreParameters()
NEGATIVE = replace(POSITIVE, coulomb=70.0, static=100.0, viscous=400.0)
CONFIG = CompensatorConfig(POSITIVE, NEGATIVE)


def stribeck(p: LugreParameters, v: float) -> float:
    level = p.coulomb + (p.static - p.coulomb) * math.exp(-((v / p.stribeck_velocity) ** 2))
    return math.copysign(level, v) + p.viscous * v


@pytest.mark.parametrize("v", [2e-4, 1e-3, 5e-3, -2e-4, -1e-3])
def test_steady_sliding_is_on_the_stribeck_curve_of_its_direction(v: float) -> None:
    compensator = LugreCompensator(CONFIG, DT)
    for _ in range(30000):
        torque = compensator.step(v, 0.0)
    expected = stribeck(POSITIVE if v > 0.0 else NEGATIVE, v)
    assert torque == pytest.approx(expected, rel=1e-6)
    assert StribeckFeedforward(CONFIG, DT).step(v, 0.0) == pytest.approx(expected, rel=1e-12)
    p = POSITIVE if v > 0.0 else NEGATIVE
    assert compensator.deflection == pytest.approx((expected - p.viscous * v) / p.stiffness, rel=1e-6)


def test_reversal_is_that_of_the_bristle_equation_ahead_by_delay_and_half_a_tick() -> None:
    delay, p = 0.004, POSITIVE
    amplitude, rate = 1e-3, 1.0

    def speed(t: float) -> float:
        return amplitude * math.sin(rate * t)

    def level(v: float) -> float:
        return p.coulomb + (p.static - p.coulomb) * math.exp(-((v / p.stribeck_velocity) ** 2))

    def bristle(t: float, z: np.ndarray) -> np.ndarray:
        v = speed(t)
        return np.array([v - p.stiffness * abs(v) / level(v) * z[0]])

    lead = delay + 0.5 * DT
    ticks = np.arange(0, 8000)
    solution = solve_ivp(bristle, (lead, 8.1), [0.0], rtol=1e-9, atol=1e-13, dense_output=True, max_step=0.01)
    compensator = LugreCompensator(CompensatorConfig(p, p, actuation_delay=delay), DT)
    torque = [compensator.step(speed(k * DT), amplitude * rate * math.cos(rate * k * DT)) for k in ticks]
    expected = []
    for k in ticks:
        t = k * DT + lead
        z = float(solution.sol(t)[0])
        v = speed(t)
        expected.append(
            p.stiffness * z + p.damping * (v - p.stiffness * abs(v) / level(v) * z) + p.viscous * v
        )
    assert np.max(np.abs(np.array(torque) - expected)) < 0.02  # of 100 N m; half a tick late is 0.15


def test_another_stiffness_makes_no_step_where_the_direction_changes() -> None:
    """The bristle comes to the reversal with all of the Coulomb friction: with its deflection kept, a quarter would jump."""
    softer = replace(POSITIVE, stiffness=0.75 * POSITIVE.stiffness)
    ticks = np.arange(4000) * DT
    speeds, accelerations = 0.01 * np.cos(2.0 * ticks), -0.02 * np.sin(2.0 * ticks)
    steps = {}
    for name, negative in (("alike", POSITIVE), ("softer", softer)):
        compensator = LugreCompensator(CompensatorConfig(POSITIVE, negative), DT)
        torque = [compensator.step(v, a) for v, a in zip(speeds, accelerations, strict=True)]
        steps[name] = np.abs(np.diff(torque)).max()
    assert steps["softer"] <= 1.1 * steps["alike"]


def test_feedforward_at_rest_is_zero() -> None:
    assert StribeckFeedforward(CONFIG, DT).step(0.0, 0.0) == 0.0


def test_lead_sees_the_reversal_coming() -> None:
    early = StribeckFeedforward(replace(CONFIG, actuation_delay=0.01), DT)
    assert early.step(-1e-5, 2e-3) > 0.0
    assert StribeckFeedforward(CONFIG, DT).step(-1e-5, 2e-3) < 0.0


def test_reset_forgets_the_bristle() -> None:
    compensator = LugreCompensator(CONFIG, DT)
    first = compensator.step(1e-3, 0.0)
    for _ in range(1000):
        compensator.step(1e-3, 0.0)
    compensator.reset()
    assert compensator.step(1e-3, 0.0) == first


def test_new_parameters_keep_the_bristle() -> None:
    compensator = LugreCompensator(CONFIG, DT)
    for _ in range(1000):
        compensator.step(1e-3, 0.0)
    before = compensator.deflection
    compensator.configure(replace(CONFIG, actuation_delay=0.002))
    assert compensator.deflection == before


@pytest.mark.parametrize(
    ("config", "found"),
    [
        (replace(CONFIG, actuation_delay=math.nan), "compensator: actuation_delay is nan"),
        (replace(CONFIG, positive=replace(POSITIVE, coulomb=0.0)), r"positive\.coulomb is 0"),
        (replace(CONFIG, negative=replace(POSITIVE, viscous=-1.0)), r"negative\.viscous is -1"),
    ],
)
def test_bad_parameters_are_refused_and_change_nothing(config: CompensatorConfig, found: str) -> None:
    compensator = LugreCompensator(CONFIG, DT)
    with pytest.raises(InputError, match=found):
        compensator.configure(config)
    assert compensator.config == CONFIG


def test_a_share_of_it_is_commanded() -> None:
    whole, part = LugreCompensator(CONFIG, DT), LugreCompensator(replace(CONFIG, share=0.7), DT)
    for k in range(500):
        v = 1e-3 * math.sin(0.01 * k)
        assert part.step(v, 0.0) == pytest.approx(0.7 * whole.step(v, 0.0), rel=1e-12)


@pytest.mark.parametrize("kind", [LugreCompensator, StribeckFeedforward])
def test_the_rest_band_bounds_friction_at_rest_and_leaves_it_from_its_speed_on(kind: type[LugreCompensator]) -> None:
    band = replace(CONFIG, rest_speed=1e-3, rest_torque=5.0)
    whole, banded = kind(CONFIG, DT), kind(band, DT)
    speeds = np.concatenate([np.linspace(2e-3, 0.0, 2001), np.zeros(10)])
    pairs = np.array([(whole.step(v, 0.0), banded.step(v, 0.0)) for v in speeds])
    outside = speeds >= 1e-3
    assert np.array_equal(pairs[outside, 0], pairs[outside, 1])
    assert pairs[-1, 1] == min(pairs[-1, 0], 5.0)
    assert np.abs(np.diff(pairs[:2000, 1])).max() < 0.2, "no step, but the last one that a law without memory has itself"


def test_a_share_above_one_is_refused() -> None:
    with pytest.raises(InputError, match=r"share.*from 0 to 1"):
        replace(CONFIG, share=1.1).validate()
