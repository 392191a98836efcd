"""What chance gives: chi-squared over all that was looked at, and a share of the noise to what feeds on it."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled, unfitted
from scipy import stats

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.search.significance import (
    FALSE_ALARM,
    IMPERFECT,
    IMPERFECT_AT_MOST,
    NOISE_SHARE,
    chance,
    feeds_on_noise,
    imperfection,
    threshold,
)
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import instance


def test_only_effects_that_feed_on_noise_have_to_be_material() -> None:
    assert feeds_on_noise(effect("load_dependent_friction"))
    assert feeds_on_noise(effect("cable_hysteresis"))
    assert feeds_on_noise(effect("position_dependent_inertia"))
    assert not feeds_on_noise(effect("coulomb_asymmetry"))
    assert not feeds_on_noise(effect("torque_ripple"))
    assert not feeds_on_noise(effect("cogging"))


def test_chance_is_chi_squared_over_all_that_was_looked_at() -> None:
    assert stats.chi2.sf(chance(2, 50.0), 2) * 50.0 * len(effects()) == pytest.approx(0.01)
    assert chance(1, 1.0) < chance(1, 10.0) < chance(2, 10.0)


@pytest.mark.parametrize("count", [1, 2, 9])
@pytest.mark.parametrize("alternatives", [1.0, 30.0, 1e5])
def test_chance_is_the_quantile_of_chi_squared(count: int, alternatives: float) -> None:
    """By simulation too far out; the quantile is found from the distribution function by bisection."""
    lower, upper = 0.0, 200.0
    for _ in range(80):
        middle = 0.5 * (lower + upper)
        above = stats.chi2.sf(middle, count) * alternatives * len(effects()) > FALSE_ALARM
        lower, upper = (middle, upper) if above else (lower, middle)
    assert chance(count, alternatives) == pytest.approx(lower, rel=1e-9)


def test_chance_grows_with_numbers_and_with_alternatives() -> None:
    grid = np.array([[chance(count, alternatives) for count in range(1, 12)] for alternatives in (0.5, 1.0, 2.0, 1e2, 1e4)])
    assert (np.diff(grid, axis=0) > 0.0).all()
    assert (np.diff(grid, axis=1) > 0.0).all()
    assert chance(0) == chance(1), "an effect without free numbers was chosen all the same"


def test_a_threshold_adds_a_share_of_the_noise_once_and_a_number_for_each_further_effect() -> None:
    balance = TorqueBalance(conditioned(np.random.default_rng(1), seconds=20.0))
    plain, fed = effect("torque_bias"), effect("load_dependent_friction")
    share = NOISE_SHARE * balance.samples.effective_count
    assert threshold(balance, [plain], 1, 5.0) == pytest.approx(chance(1, 5.0))
    assert threshold(balance, [fed], 1, 5.0) == pytest.approx(chance(1, 5.0) + share)
    assert threshold(balance, [fed, fed], 2) == pytest.approx(chance(2) + share + chance(1))


def test_what_is_left_to_others_is_a_share_of_what_effects_explain_up_to_one_of_the_noise() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(2), lambda m: np.full(len(m.t), 1.0), seconds=40.0))
    count = balance.samples.effective_count
    for bias, expected in ((0.0, 0.0), (0.5, None), (1000.0, IMPERFECT_AT_MOST * count)):
        wrong = unfitted(balance, axis().with_effect(instance(effect("torque_bias"), {"bias": 1.0 - bias})), fit.noise)
        right = unfitted(balance, axis().with_effect(instance(effect("torque_bias"), {"bias": 1.0})), fit.noise)
        if expected is None:
            expected = IMPERFECT * (wrong.squares - right.squares) / right.squares.dispersion
            assert 0.0 < expected < IMPERFECT_AT_MOST * count
        assert imperfection(wrong, right, balance) == pytest.approx(expected, abs=1e-9)
