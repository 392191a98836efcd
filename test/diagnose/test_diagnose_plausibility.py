"""Whether a fitted effect can be what it says: every reason for doubt, and none where there is none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import DT, conditioned, settled, unfitted

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.search.plausibility import Doubt, doubt
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    """300 s to and fro, noise of 0.3 N m rms."""
    return settled(conditioned(np.random.default_rng(5)))


def vibration(frequency: float) -> Instance:
    return instance(effect("periodic_vibration"), {"frequency": frequency, "amplitude": 2.0, "phase": 0.0})


@pytest.mark.parametrize(
    ("name", "values", "moved"),
    [
        ("encoder_periodic_error", {"order": 40.0, "amplitude": 1e-3, "phase": 0.0}, 1e-3),
        ("periodic_vibration", {"frequency": 8.0, "amplitude": 2.0, "phase": 0.0}, 2.0 / (900.0 * (16.0 * math.pi) ** 2)),
    ],
)
def test_a_wave_within_the_steps_of_a_coarse_encoder_is_not_named(
    fitted: tuple[TorqueBalance, Fit], name: str, values: dict[str, float], moved: float
) -> None:
    """What the steps leave repeats with time and position, too."""
    item = instance(effect(name), values)
    balance, fit = fitted
    with_wave = unfitted(balance, fit.axis.with_effect(item), fit.noise)
    for step, expected in ((0.0, None), (1.8 * moved, None), (2.2 * moved, Doubt.QUANTISATION)):
        coarse = TorqueBalance(replace(balance.data, position_step=step))
        assert doubt(coarse, with_wave, item, fit.axis) is expected


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("torque_bias", {"bias": 1e-6}, Doubt.TOO_SMALL),
        ("torque_bias", {"bias": 1.0}, None),
        ("torque_bias", {"bias": 1e3}, Doubt.TOO_LARGE),
        ("transport_delay", {"delay": 0.4 * DT}, Doubt.ALIGNMENT),  # torque and position in the log are no better aligned
        ("transport_delay", {"delay": 0.6 * DT}, None),
        ("periodic_vibration", {"frequency": 8.001, "amplitude": 2.0, "phase": 0.0}, Doubt.TWICE),  # beside one of 8 Hz
        ("periodic_vibration", {"frequency": 8.01, "amplitude": 2.0, "phase": 0.0}, None),
        ("flexible_mode", {"frequency": 0.51 / DT, "damping": 0.05, "inertia_ratio": 0.3}, Doubt.BEYOND_SAMPLING),
        ("flexible_mode", {"frequency": 0.49 / DT, "damping": 0.05, "inertia_ratio": 0.3}, Doubt.TOO_SMALL),
        ("actuator_lag", {"time_constant": 0.3 * DT}, Doubt.BEYOND_SAMPLING),
        (
            "backlash",
            {"gap": 1e-4, "inertia_ratio": 0.3, "contact_frequency": 0.6 / DT, "contact_damping": 0.2},
            Doubt.BEYOND_SAMPLING,
        ),
        ("flexible_mode", {"frequency": 3.0, "damping": 0.9, "inertia_ratio": 0.3}, Doubt.WARNED),
        ("flexible_mode", {"frequency": 3.0, "damping": 0.05, "inertia_ratio": 0.3}, None),
        ("coulomb_asymmetry", {"asymmetry": 0.9499}, Doubt.AT_BOUND),
        ("coulomb_asymmetry", {"asymmetry": 0.2}, None),
        ("load_step", {"step": 1.5, "time": 1.0}, Doubt.NOT_RESOLVED),  # searched from the tenth second on
        ("load_step", {"step": 1.5, "time": 100.0}, None),
    ],
)
def test_an_effect_that_cannot_be_what_it_says_is_doubted(
    fitted: tuple[TorqueBalance, Fit], name: str, values: dict[str, float], expected: Doubt | None
) -> None:
    balance, fit = fitted
    base, item = fit.axis.with_effect(vibration(8.0)), instance(effect(name), values)
    assert doubt(balance, unfitted(balance, base.with_effect(item), fit.noise), item, base) is expected


def test_a_mode_that_does_not_ring_is_impossible() -> None:
    assert not effect("flexible_mode").warn({"frequency": 20.0, "damping": 0.1, "inertia_ratio": 0.3})
    assert "resonance" in effect("flexible_mode").warn({"frequency": 3.0, "damping": 0.9, "inertia_ratio": 0.3})[0]


def test_an_order_may_be_whole_if_that_loses_little_of_the_wave(fitted: tuple[TorqueBalance, Fit]) -> None:
    """What else is missing moves an order by more than the noise says, but a wave that fits no turn loses more than that."""
    balance, fit = fitted
    item = instance(effect("cogging"), {"order": 40.01, "amplitude": 20.0, "phase": 0.0})
    waved = fit.axis.with_effect(item)
    white = fit.noise.whiten(balance.torque_residual(fit.axis) - balance.torque_residual(waved))
    own, away = float(white @ white), math.log(40.01 / 40.0)
    assert 0.01 * own > chance(1) * fit.squares.dispersion
    for share, expected in ((0.01, None), (0.03, Doubt.NOT_WHOLE)):
        known = unfitted(balance, waved, fit.noise, variance=away**2 / (share * own))
        assert doubt(balance, known, item, fit.axis) is expected
