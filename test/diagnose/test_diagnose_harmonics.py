"""Waves of one kind that belong together are one effect, and what is believed stays as it is."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import Motion, axis, conditioned, settled

from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.search.harmonics import added_effects, with_harmonics_joined
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance


def test_a_wave_at_twice_the_order_is_a_harmonic() -> None:
    def waves(m: Motion) -> np.ndarray:
        return 3.0 * np.cos(20.0 * m.q + 0.4) + 0.8 * np.cos(40.0 * m.q + 2.0)

    balance, plain = settled(conditioned(np.random.default_rng(4), waves))
    apart = axis()
    for order, amplitude, phase in ((20.0, 3.0, 0.4), (40.0, 0.8, 2.0)):
        numbers = {"order": order, "amplitude": amplitude, "phase": phase}
        apart = apart.with_effect(instance(effect("cogging"), numbers))
    fit = settle(balance, apart, plain.noise, rounds=1)
    (one,) = with_harmonics_joined(balance, fit, axis()).axis.effects
    assert (one.values["order"], one.values["amplitude_2"]) == pytest.approx((20.0, 0.8), rel=0.05)
    assert one.values["phase_2"] == pytest.approx(2.0, abs=0.1)
    believed = axis().with_effect(fit.axis.effects[0])
    assert with_harmonics_joined(balance, fit, believed).axis == fit.axis, "what is believed stays as it is"


def test_a_wave_whose_size_drifts_is_not_two_of_one_order() -> None:
    """Of two of nearly the same order the sum drifts; the fourth harmonic of another wave would do for one of them."""

    def waves(m: Motion) -> np.ndarray:
        return 3.0 * np.cos(5.0 * m.q + 0.4) + (2.0 + m.t / m.t[-1]) * np.cos(20.0 * m.q)

    balance, plain = settled(conditioned(np.random.default_rng(4), waves))
    first = {"order": 5.0, "amplitude": 3.0, "phase": 0.4, "amplitude_4": 1.0, "phase_4": 3.0}
    both = axis()
    for numbers in (first, {"order": 20.01, "amplitude": 3.0, "phase": 0.0}):
        both = both.with_effect(instance(effect("cogging"), numbers))
    fit = settle(balance, both, plain.noise, rounds=1)
    assert fit.axis.effects[0].values["amplitude_4"] > 0.1
    one, other = with_harmonics_joined(balance, fit, axis()).axis.effects
    assert (one.values["amplitude"], one.values["amplitude_4"]) == pytest.approx((3.0, 0.0), rel=0.05)
    assert other.values["amplitude"] == pytest.approx(2.5, rel=0.05)


def test_added_effects_are_told_by_identity_and_not_by_values() -> None:
    bias = instance(effect("torque_bias"), {"bias": 1.0})
    twin = bias.again()
    base = axis().with_effect(bias)
    improved = axis().with_effect(bias.replace(bias=2.0)).with_effect(twin)
    assert added_effects(improved, base) == (twin,)
    assert added_effects(base, improved) == ()
