"""Stepwise selection: what is chosen, placed again, dropped, and what chance and slow torques explain."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import DT, Motion, Torque, axis, conditioned, selected, settled, unfitted

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, fit_jointly, fit_without, least_squares, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search import stepwise
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.start import Start
from tcs_friction.diagnose.search.stepwise import (
    _best_of_two_close,
    _confused_with_collisions,
    _led_back,
    _placed_again,
    beyond_remaining_spectrum,
    close_behind,
    pruned,
)
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import Instance, instance

STEP = 100.37  # s
MOMENT, ONE_SWEEP = 19.0, 41.0  # s


def step(m: Motion) -> np.ndarray:
    return np.where(m.t >= STEP, 1.5, 0.0)


def bump(m: Motion) -> np.ndarray:
    place = m.q[np.argmin(np.abs(m.t - MOMENT))]
    return 6.0 * np.exp(-(((m.q - place) / 0.1) ** 2)) * np.sign(m.v)


def push_and_pull(m: Motion) -> np.ndarray:
    return 6.0 * np.sin(4.0 * (m.t - MOMENT)) * np.exp(-((m.t - MOMENT) ** 2))


def start(name: str, gain: float) -> Start:
    values = {p.name: 1.0 for p in effect(name).parameters if p.default is None}
    return Start((instance(effect(name), values),), gain, 1, 1.0, np.empty((0, 0)))


def test_an_effect_led_astray_is_found_anew() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(6), step))
    astray = settle(balance, fit.axis.with_effect(instance(effect("load_step"), {"step": 1.0, "time": 60.0})), fit.noise, 1)
    found = _placed_again(balance, astray, astray.axis.effects)
    assert astray.axis.effects[0].values["time"] == pytest.approx(60.0, abs=5.0)
    assert found.axis.effects[0].values["time"] == pytest.approx(STEP, abs=0.3)


def test_friction_with_a_slow_wave_led_astray_is_found_anew() -> None:
    """Between its order and that of a wave that does something of its torque no derivative leads."""
    balance, fit = settled(conditioned(np.random.default_rng(6), lambda m: 6.0 * np.cos(m.q) * np.sign(m.v)))
    wave = instance(effect("position_dependent_friction"), {"order": 2.2, "amplitude": 0.02, "phase": 1.0})
    astray = settle(balance, fit.axis.with_effect(wave), fit.noise, 1)
    assert abs(astray.axis.effects[0].order - 1.0) > 0.5
    (found,) = _placed_again(balance, astray, astray.axis.effects).axis.effects
    assert found.order == pytest.approx(1.0, abs=0.02)
    assert found.values["amplitude"] == pytest.approx(0.1, rel=0.05)


def test_a_step_is_selected_and_nothing_else() -> None:
    """Load-dependent friction is not asked: all noise is in the torque here, which it can make smaller."""
    balance = TorqueBalance(conditioned(np.random.default_rng(7), step))
    (item,) = selected(balance, frozenset({"backlash", "flexible_mode", "load_dependent_friction"})).found
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
        biased = settle(balance, fit.axis.with_effect(instance(effect("torque_bias"), {"bias": 0.3})), fit.noise, 1)
        assert len(beyond_remaining_spectrum(balance, biased, fit).axis.effects) == kept


def test_two_starts_are_always_fitted_and_others_only_if_they_may_win() -> None:
    found = [start(name, gain) for name, gain in (("torque_bias", 5.0), ("imbalance", 100.0), ("cable_wrap", 8.0))]
    assert [s.instance.term.id for s in close_behind(found)] == ["imbalance", "cable_wrap"]
    assert [s.instance.term.id for s in close_behind([*found, start("load_step", 50.0)])] == ["imbalance", "load_step"]
    assert close_behind([]) == []


def test_what_an_impossible_effect_leaves_behind_must_earn_its_place() -> None:
    """An encoder that counts backwards goes; a bias beside it stays only where there is one."""
    for bias, kept in ((0.3, ["torque_bias"]), (0.0, [])):
        balance, fit = settled(conditioned(np.random.default_rng(11), lambda m, bias=bias: np.full(len(m.t), bias)))
        error = instance(effect("encoder_periodic_error"), {"order": 40.0, "amplitude": 0.1, "phase": 0.0})
        both = fit.axis.with_effect(error).with_effect(instance(effect("torque_bias"), {"bias": 0.3}))
        free = [f for f in balance.free(both) if f.effect != error.identity]
        impossible = least_squares(balance, both, free, fit.noise, np.full(len(free), np.inf))
        assert [item.term.id for item in pruned(balance, impossible, fit).axis.effects] == kept


@pytest.mark.parametrize(("coefficient", "kept"), [(0.0, ["imbalance"]), (0.2, ["imbalance", "load_dependent_friction"])])
def test_friction_that_follows_the_load_by_its_noise_alone_is_dropped(coefficient: float, kept: list[str]) -> None:
    """Fitted to the logged torque it takes a share of that noise away: a gain of a thousand where there is no such friction."""

    def hidden(m: Motion) -> np.ndarray:
        gravity = 60.0 * np.sin(m.q + 0.7)
        load = 900.0 * np.gradient(m.v, DT) + gravity + 60.0 * np.sign(m.v) + 500.0 * m.v
        return gravity + coefficient / (1.0 - coefficient) * np.abs(load) * np.sign(m.v)

    balance = TorqueBalance(conditioned(np.random.default_rng(3), hidden, 120.0))
    retuned = settle(balance, axis(), white_noise(balance.samples))
    gravity = instance(effect("imbalance"), {"amplitude": 60.0, "phase": 0.7})
    base = settle(balance, axis().with_effect(gravity), white_noise(balance.samples))
    loaded = base.axis.with_effect(instance(effect("load_dependent_friction"), {"coefficient": 0.02}))
    fit = fit_jointly(balance, loaded, base.noise, iterations=10)
    assert base.squares - fit.squares > 1000.0
    assert [item.term.id for item in pruned(balance, fit, retuned).axis.effects] == kept


@pytest.mark.parametrize(("torque", "found"), [(bump, ["local_friction_bump"]), (push_and_pull, [])])
def test_a_place_passed_once_is_named_only_if_it_accounts_for_all_that_was_there(
    torque: Torque, found: list[str]
) -> None:
    data = conditioned(np.random.default_rng(12), torque, ONE_SWEEP)
    others = frozenset(effects()) - {"local_friction_bump", "position_dependent_friction", "load_step"}
    selection = selected(TorqueBalance(data), others)
    assert [item.term.id for item in selection.found] == found


def test_beside_collisions_no_swing_and_no_delay_is_looked_for() -> None:
    """What collisions leave that come a moment early or late looks like them."""
    backlash = instance(effect("backlash"), {"gap": 1e-3, "inertia_ratio": 0.1})
    balance, fit = settled(conditioned(np.random.default_rng(0), seconds=20.0))
    assert _confused_with_collisions(fit) == frozenset()
    knocking = unfitted(balance, axis().with_effect(backlash), fit.noise)
    assert _confused_with_collisions(knocking) == {
        "flexible_mode", "transport_delay", "actuator_lag"
    }  # fmt: skip


def dropping(name: str) -> Callable[..., Fit]:
    """In place of `pruned`: drops every effect of this name."""

    def pruned_of_it(balance: TorqueBalance, fit: Fit, *_: object) -> Fit:
        for item in fit.axis.effects:
            if item.term.id == name:
                fit = fit_without(balance, fit, item)
        return fit

    return pruned_of_it


def test_what_is_pruned_again_leaves_its_place_to_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search goes on without a candidate that does not stay, and ends when none is left."""
    monkeypatch.setattr(stepwise, "pruned", dropping("torque_bias"))
    balance = TorqueBalance(conditioned(np.random.default_rng(7), lambda m: 1.0 * (m.t > 20.3) + 3.0, seconds=60.0))
    selection = selected(balance, frozenset(effects()) - {"load_step", "torque_bias"})
    assert [item.term.id for item in selection.found] == ["load_step"]
    assert any("torque_bias" in {kind.effect for kind in c.kinds} for c in selection.rounds[0])


def test_of_two_effects_of_which_one_is_dropped_at_once_the_other_is_found_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The one that was dropped may have led the other astray."""
    monkeypatch.setattr(stepwise, "pruned", dropping("quadratic_drag"))
    data = conditioned(np.random.default_rng(7), lambda m: 300.0 * m.v * np.abs(m.v) + 9.0 * np.sin(m.q), seconds=60.0)
    selection = selected(TorqueBalance(data), frozenset(effects()) - {"quadratic_drag", "imbalance"})
    best = [{kind.effect for kind in candidates[0].kinds} for candidates in selection.rounds[:2]]
    assert best == [{"quadratic_drag", "imbalance"}, {"imbalance"}]
    assert [item.term.id for item in selection.found] == ["imbalance"]


def test_a_better_place_of_the_same_effects_is_kept_when_what_led_there_is_dropped() -> None:
    data = conditioned(np.random.default_rng(7), lambda m: 9.0 * np.sin(m.q), seconds=60.0)
    balance, plain = settled(data)
    gravity = instance(effect("imbalance"), {"amplitude": 9.0, "phase": 0.0})
    right = settle(balance, plain.axis.with_effect(gravity), plain.noise, rounds=1)
    stuck = unfitted(balance, plain.axis.with_effect(gravity.replace(amplitude=6.0)), right.noise)
    assert _led_back(balance, stuck, right)
    assert not _led_back(balance, right, stuck), "it does worse"
    assert not _led_back(balance, plain, right), "it has another effect"


@pytest.mark.parametrize(
    ("gain", "limit", "name"),
    [(99.0, 20.0, "cogging"), (97.0, 20.0, "torque_bias"), (99.0, 20.1, "torque_bias"), (19.9, 20.0, "torque_bias")],
)
def test_of_two_that_gain_nearly_the_same_in_a_round_the_better_fit_is_taken(gain: float, limit: float, name: str) -> None:
    """A wave is there and no bias; the second one is asked if it gains within 2 %, more than chance, and is as simple."""
    balance, fit = settled(conditioned(np.random.default_rng(12), lambda m: np.cos(40.0 * m.q), seconds=80.0))

    def candidate(gain: float, limit: float, term: str, **values: float) -> Candidate:
        item = instance(effect(term), values)
        fitted = settle(balance, fit.axis.with_effect(item), fit.noise, 1)
        return Candidate(gain, limit, fitted, replace(start(term, gain), instances=(item,)))

    best = candidate(20.1 if gain < limit else 100.0, 20.0, "torque_bias", bias=0.1)
    second = candidate(gain, limit, "cogging", order=40.0, amplitude=1.0)
    chosen, left = _best_of_two_close(balance, axis(), best, [best, second])
    assert [item.term.id for item in left.axis.effects] == [name]
    assert chosen is (second if name == "cogging" else best)


@pytest.mark.parametrize(("gain", "names"), [(99.0, ["cogging"]), (97.0, ["cogging", "torque_bias"])])
def test_of_a_pair_one_effect_that_gains_nearly_all_is_taken_alone(gain: float, names: list[str]) -> None:
    """A wave is there and a small bias: the pair fits better, but what the other one is shows better beside the first."""
    data = conditioned(np.random.default_rng(12), lambda m: np.cos(40.0 * m.q) + 0.1, seconds=80.0)
    balance, fit = settled(data)
    wave = instance(effect("cogging"), {"order": 40.0, "amplitude": 1.0, "phase": 0.0})
    bias = instance(effect("torque_bias"), {"bias": 0.1})

    def candidate(gain: float, *items: Instance) -> Candidate:
        fitted = settle(balance, functools.reduce(Axis.with_effect, items, fit.axis), fit.noise, 1)
        return Candidate(gain, 20.0, fitted, replace(start("cogging", gain), instances=items))

    both, lone = candidate(100.0, wave, bias), candidate(gain, wave)
    chosen, left = _best_of_two_close(balance, axis(), both, [both, lone])
    assert [item.term.id for item in left.axis.effects] == names
    assert chosen is (lone if len(names) == 1 else both)


def test_what_takes_an_earlier_effect_with_it_is_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second effect may lead the first one astray, so that both are dropped: the search keeps the first one."""

    def without_both(*arguments: Fit) -> Fit:
        fit, base = arguments[1:3]
        return fit if len(fit.axis.effects) < 2 else base

    monkeypatch.setattr(stepwise, "pruned", without_both)
    balance = TorqueBalance(conditioned(np.random.default_rng(7), lambda m: 1.0 * (m.t > 20.3) + 3.0, seconds=60.0))
    selection = selected(balance, frozenset(effects()) - {"load_step", "torque_bias"})
    assert [item.term.id for item in selection.found] == ["torque_bias"]
    assert len(selection.rounds) == 3, "the first effect, the second one, and nothing that is left"


def test_a_search_repeated_finds_the_same_to_the_last_digit() -> None:
    """No stage leaves anything behind in the balance."""
    balance = TorqueBalance(conditioned(np.random.default_rng(7), lambda m: 1.5 * (m.t > 20.3) + 0.4, seconds=60.0))
    excluded = frozenset(effects()) - {"load_step", "torque_bias", "cogging"}
    first, again = selected(balance, excluded), selected(balance, excluded)
    assert {item.term.id for item in first.found} >= {"load_step"}
    assert [item.term.id for item in first.found] == [item.term.id for item in again.found]
    assert [dict(item.values) for item in first.found] == [dict(item.values) for item in again.found]
    assert first.chosen.squares.value == again.chosen.squares.value
    gains = [[(c.kinds, c.gain, c.threshold) for r in selection.rounds for c in r] for selection in (first, again)]
    assert gains[0] == gains[1]
    assert len(gains[0]) > 1
