"""What a diagnosis writes into the axis file: what it names, within what was seen, and never effects that cancel each other."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled, unfitted

from tcs_friction.config import AxisFile
from tcs_friction.diagnose import rules
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.outcome.conclusion import conclude
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.proof import found_effects
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.outcome.written import named_only, seen, with_described
from tcs_friction.diagnose.rules import Refusal
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

BIAS = instance(effect("torque_bias"), {"bias": 2.0})
WAVE = instance(effect("cogging"), {"order": 40.0, "amplitude": 3.0, "phase": 0.0})


@pytest.fixture(scope="module")
def fits() -> tuple[TorqueBalance, Fit, Fit]:
    """The balance, the retuned fit, and one with both effects as they were concealed."""
    data = conditioned(np.random.default_rng(3), lambda m: 2.0 + 3.0 * np.cos(40.0 * m.q), seconds=80.0)
    balance, retuned = settled(data)
    return balance, retuned, unfitted(balance, axis().with_effect(BIAS).with_effect(WAVE), retuned.noise)


def found(fits: tuple[TorqueBalance, Fit, Fit], *refusals: Refusal | None) -> list[Found]:
    """Both effects, the first and the second refused or not."""
    balance, retuned, both = fits
    every = {one.effect: one for one in found_effects(balance, Explanation(retuned, both, both, None), axis(), 0.3)}
    named = [every[item.term.id] for item in (BIAS, WAVE)]
    return [Found(**{**vars(one), "refused": (why,) if why else ()}) for one, why in zip(named, refusals, strict=True)]


def test_what_is_described_is_written_if_asked_for(fits: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, both = fits
    explanation = Explanation(retuned, both, both, None)
    every = found(fits, Refusal(rules.LEFT, "what is left could be it"), None)
    named, all_of_it = (of(balance, explanation, every, axis()).axis for of in (named_only, with_described))
    assert [item.term.id for item in named.effects] == ["cogging"]
    assert named.effects[0].values["amplitude"] == pytest.approx(3.0, rel=0.1)
    assert named.friction.values["coulomb"] != both.axis.friction.values["coulomb"], "all else is fitted again"
    assert [item.term.id for item in all_of_it.effects] == ["torque_bias", "cogging"]


@pytest.mark.parametrize("rule", [rules.CANCELLED, rules.TOO_LARGE])
def test_what_cancels_or_is_larger_than_the_drive_is_written_for_nobody(
    fits: tuple[TorqueBalance, Fit, Fit], rule: rules.Rule
) -> None:
    balance, retuned, both = fits
    every, explanation = found(fits, Refusal(rule, "no"), None), Explanation(retuned, both, both, None)
    assert [item.term.id for item in with_described(balance, explanation, every, axis()).axis.effects] == ["cogging"]


def test_where_nothing_is_named_the_retuned_axis_is_written(fits: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, both = fits
    no = Refusal(rules.COMES_BACK, "it does not come back")
    assert named_only(balance, Explanation(retuned, both, both, None), found(fits, no, no), axis()) is retuned


def test_a_torque_larger_than_the_drive_s_is_not_named(fits: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, _ = fits
    huge = instance(effect("torque_bias"), {"bias": 3.0 * balance.torque_size})
    fit = unfitted(balance, axis().with_effect(huge), retuned.noise)
    (one,) = found_effects(balance, Explanation(retuned, fit, fit, None), axis(), 0.3)
    assert rules.TOO_LARGE in [refusal.rule for refusal in one.refused]


def test_ranges_that_were_seen_are_said(fits: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, both = fits
    ranges = seen(balance.data, axis())
    position = balance.data.joined("position")[balance.data.train | balance.data.held_out]
    assert ranges.position == (position.min(), position.max())
    assert ranges.words.startswith("Told from position ")
    assert ranges.temperature is None or ranges.temperature[0] < ranges.temperature[1]
    content = conclude(balance, AxisFile(axis()), Explanation(retuned, both, both, None)).to_mapping()
    assert content["seen"] == ranges.to_mapping()
    assert content["fit"]["written"]["held_out"] > 0.0
