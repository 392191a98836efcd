"""The search for missing effects: pairs that hide each other, jagged effects, what chance explains, who competes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import proof_cases
import pytest
from proof_cases import recorded
from scipy import stats
from structure_cases import DT, Motion, Torque, axis, conditioned, settled

from tcs_friction.diagnose.dataset.preprocessing import condition
from tcs_friction.diagnose.fit.balance import Balance, Fit
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.parameters import free_parameters
from tcs_friction.diagnose.search.candidates import chance
from tcs_friction.diagnose.search.hypotheses import Start, _leads, all_starts, climbed, starts, together
from tcs_friction.diagnose.search.projection import Background
from tcs_friction.diagnose.search.stepwise import (
    _mimicked,
    as_harmonics,
    close_behind,
    contest,
    outstanding,
    prune,
    searched_anew,
    select,
)
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import instance

STEP = 100.37  # s
MOMENT, ONE_SWEEP = 19.0, 41.0  # s


def step(m: Motion) -> np.ndarray:
    return np.where(m.t >= STEP, 1.5, 0.0)


def hidden_pair(m: Motion) -> np.ndarray:
    """A bias that takes away what viscous friction by direction adds in the mean."""
    return 20.0 * (np.abs(m.v) - float(np.mean(np.abs(m.v))))


def bump(m: Motion) -> np.ndarray:
    place = m.q[np.argmin(np.abs(m.t - MOMENT))]
    return 6.0 * np.exp(-(((m.q - place) / 0.1) ** 2)) * np.sign(m.v)


def push_and_pull(m: Motion) -> np.ndarray:
    return 6.0 * np.sin(4.0 * (m.t - MOMENT)) * np.exp(-((m.t - MOMENT) ** 2))


def start(name: str, gain: float) -> Start:
    values = {p.name: 1.0 for p in effect(name).parameters if p.default is None}
    return Start((instance(effect(name), values),), gain, 1, 1.0, np.empty((0, 0)))


def names(found: Start) -> set[str]:
    return {item.term.id for item in found.instances}


def test_effects_that_hide_each_other_promise_more_together() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(3), hidden_pair))
    background = Background(balance, fit.axis, fit.free)
    found = all_starts(background, frozenset({"backlash", "flexible_mode", "cogging", "torque_ripple"}))
    pairs = together(background, found)
    pair = next(p for p in pairs if names(p) == {"torque_bias", "viscous_asymmetry"})
    alone = {s.instance.term.id: s.gain for s in found}
    assert pair.gain > 1.2 * (alone["torque_bias"] + alone["viscous_asymmetry"])
    assert all(p.gain > 0.0 and len(p.instances) == 2 for p in pairs)
    promises = [p.gain / p.excess for p in pairs]
    assert promises == sorted(promises, reverse=True)


def test_nothing_promises_more_together_where_nothing_is_hidden() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(4)))
    background = Background(balance, fit.axis, fit.free)
    found = [s for name in ("torque_bias", "imbalance") for s in starts(background, effect(name), None)]
    assert all(pair.gain < 30.0 for pair in together(background, found))


def test_the_time_of_a_step_is_climbed_to() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5), step))
    background = Background(balance, fit.axis, fit.free)
    first = starts(background, effect("load_step"), None)[0]
    best = climbed(background, first)
    assert abs(first.instance.values["time"] - STEP) > 1.0
    assert best.gain > first.gain
    assert best.instance.values["time"] == pytest.approx(STEP, abs=0.3)
    smooth = start("torque_bias", 1.0)
    assert climbed(background, smooth) is smooth


def test_an_effect_led_astray_is_found_anew() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(6), step))
    astray = settle(balance, fit.axis.with_effect(instance(effect("load_step"), {"step": 1.0, "time": 60.0})), 1)
    found = searched_anew(balance, astray, range(1))
    assert astray.axis.effects[0].values["time"] == pytest.approx(60.0, abs=5.0)
    assert found.axis.effects[0].values["time"] == pytest.approx(STEP, abs=0.3)


def test_a_step_is_selected_and_nothing_else() -> None:
    """Load-dependent friction is not asked: all noise is in the torque here, which it can make smaller."""
    balance, _ = settled(conditioned(np.random.default_rng(7), step))
    chosen = select(balance, axis(), barred=frozenset({"backlash", "flexible_mode", "load_dependent_friction"})).chosen
    (item,) = chosen.axis.effects
    assert item.term.id == "load_step"
    assert item.values["step"] == pytest.approx(1.5, rel=0.1)


def test_a_bias_that_a_slow_torque_explains_is_not_named() -> None:
    """The same bias is named where the rest is noise."""
    rng = np.random.default_rng(8)
    corner = 2.0 * np.pi * 0.02 * DT
    drift = np.zeros(30_000)
    for k in range(1, len(drift)):
        drift[k] = (1.0 - corner) * drift[k - 1] + math.sqrt(2.0 * corner) * rng.standard_normal()
    for slow, kept in ((2.0 * drift, 0), (0.0 * drift, 1)):
        balance, fit = settled(conditioned(rng, lambda m, slow=slow: np.full(len(m.t), 0.3) + slow))
        biased = settle(balance, fit.axis.with_effect(instance(effect("torque_bias"), {"bias": 0.3})), 1)
        assert len(outstanding(balance, biased, 0).axis.effects) == kept


def test_two_starts_are_always_fitted_and_others_only_if_they_may_win() -> None:
    found = [start(name, gain) for name, gain in (("torque_bias", 5.0), ("imbalance", 100.0), ("cable_wrap", 8.0))]
    assert [s.name for s in close_behind(found)] == ["imbalance", "cable_wrap"]
    assert [s.name for s in close_behind([*found, start("load_step", 50.0)])] == ["imbalance", "load_step"]
    assert close_behind([]) == []


def test_chance_is_chi_squared_over_all_that_was_looked_at() -> None:
    assert stats.chi2.sf(chance(2, 50.0), 2) * 50.0 * len(effects()) == pytest.approx(0.01)
    assert chance(1, 1.0) < chance(1, 10.0) < chance(2, 10.0)


def test_what_an_impossible_effect_leaves_behind_must_earn_its_place() -> None:
    """An encoder that counts backwards goes; a bias beside it stays only where there is one."""
    for bias, kept in ((0.3, ["torque_bias"]), (0.0, [])):
        balance, fit = settled(conditioned(np.random.default_rng(11), lambda m, bias=bias: np.full(len(m.t), bias)))
        error = instance(effect("encoder_periodic_error"), {"order": 40.0, "amplitude": 0.1, "phase": 0.0})
        both = fit.axis.with_effect(error).with_effect(instance(effect("torque_bias"), {"bias": 0.3}))
        free = [f for f in balance.free(both) if f.owner != 0]
        pruned = prune(balance, balance.fit(both, free), fit)
        assert [item.term.id for item in pruned.axis.effects] == kept


def test_harmonics_belong_to_a_first_one() -> None:
    cogging = effect("cogging")
    plain = {"order": 18.0, "amplitude": 1.0, "phase": 0.0}
    assert _leads(instance(cogging, plain | {"amplitude_2": 1.5}))
    assert not _leads(instance(cogging, plain | {"amplitude_4": 4.0}))


def test_a_wave_at_twice_the_order_is_a_harmonic() -> None:
    def waves(m: Motion) -> np.ndarray:
        return 3.0 * np.cos(20.0 * m.q + 0.4) + 0.8 * np.cos(40.0 * m.q + 2.0)

    balance, _ = settled(conditioned(np.random.default_rng(4), waves))
    apart = axis()
    for order, amplitude, phase in ((20.0, 3.0, 0.4), (40.0, 0.8, 2.0)):
        numbers = {"order": order, "amplitude": amplitude, "phase": phase}
        apart = apart.with_effect(instance(effect("cogging"), numbers))
    fit = settle(balance, apart, rounds=1)
    (one,) = as_harmonics(balance, fit, 0).axis.effects
    assert (one.values["order"], one.values["amplitude_2"]) == pytest.approx((20.0, 0.8), rel=0.05)
    assert one.values["phase_2"] == pytest.approx(2.0, abs=0.1)
    assert as_harmonics(balance, fit, 1).axis == fit.axis, "what is believed stays as it is"


def test_a_wave_whose_size_drifts_is_not_two_of_one_order() -> None:
    """Of two of nearly the same order the sum drifts; the fourth harmonic of another wave would do for one of them."""

    def waves(m: Motion) -> np.ndarray:
        return 3.0 * np.cos(5.0 * m.q + 0.4) + (2.0 + m.t / m.t[-1]) * np.cos(20.0 * m.q)

    balance, _ = settled(conditioned(np.random.default_rng(4), waves))
    first = {"order": 5.0, "amplitude": 3.0, "phase": 0.4, "amplitude_4": 1.0, "phase_4": 3.0}
    both = axis()
    for numbers in (first, {"order": 20.01, "amplitude": 3.0, "phase": 0.0}):
        both = both.with_effect(instance(effect("cogging"), numbers))
    fit = settle(balance, both, rounds=1)
    assert fit.axis.effects[0].values["amplitude_4"] > 0.1
    one, other = as_harmonics(balance, fit, 0).axis.effects
    assert (one.values["amplitude"], one.values["amplitude_4"]) == pytest.approx((3.0, 0.0), rel=0.05)
    assert other.values["amplitude"] == pytest.approx(2.5, rel=0.05)


@pytest.mark.parametrize(("torque", "found"), [(bump, ["local_friction_bump"]), (push_and_pull, [])])
def test_a_place_passed_once_is_named_only_if_it_accounts_for_all_that_was_there(
    torque: Torque, found: list[str]
) -> None:
    data = conditioned(np.random.default_rng(12), torque, ONE_SWEEP)
    others = frozenset(effects()) - {"local_friction_bump", "position_dependent_friction", "load_step"}
    selection = select(Balance(data), axis(), barred=others)
    assert [item.term.id for item in selection.chosen.axis.effects] == found


def test_beside_collisions_no_swing_and_no_delay_is_looked_for() -> None:
    """What collisions leave that come a moment early or late looks like them."""
    backlash = instance(effect("backlash"), {"gap": 1e-3, "inertia_ratio": 0.1})
    free = free_parameters(axis(), 1.0)
    fit = Fit(axis(), tuple(free), np.eye(len(free)), 1.0, True)
    assert _mimicked(fit) == frozenset()
    assert _mimicked(replace(fit, axis=axis().with_effect(backlash))) == {
        "flexible_mode", "transport_delay", "actuator_lag"
    }  # fmt: skip


def test_a_mode_that_does_not_ring_is_impossible() -> None:
    assert not effect("flexible_mode").warn({"frequency": 20.0, "damping": 0.1, "inertia_ratio": 0.3})
    assert "resonance" in effect("flexible_mode").warn({"frequency": 3.0, "damping": 0.9, "inertia_ratio": 0.3})[0]


@pytest.mark.parametrize(("linear", "name"), [(0.0, "wind_torque"), (1.0, "exogenous")])
def test_a_wind_is_no_signal_of_any_kind_unless_it_acts_like_one(linear: float, name: str) -> None:
    """What is found first may hold more numbers than it needs, its special case hidden by what was missing then."""
    plain = recorded(proof_cases.axis())
    wind = 6.0 + 2.0 * np.sin(0.31 * plain.t) + np.sin(0.83 * plain.t)
    r = replace(plain, torque=plain.torque + 0.2 * wind**2 + linear * wind, exogenous={"wind_speed": wind})
    balance = Balance(condition([r]))
    general = instance(effect("exogenous"), {"linear": 0.1, "squared": 0.1}, signal="wind_speed")
    fit = settle(balance, proof_cases.axis(general))
    chosen, rivals = contest(balance, fit, 0, [])
    assert chosen.axis.effects[0].term.id == name
    assert len({candidate.name for candidate in rivals.candidates}) == len(rivals.candidates)
