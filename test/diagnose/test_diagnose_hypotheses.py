"""Where to start fitting: waves, pairs that hide each other, discontinuous effects, and none from noise of the torque."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from closed_loop_cases import telescope
from concealed_torque_cases import DT, Motion, axis, conditioned, settled

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search import hypotheses
from tcs_friction.diagnose.search.hypotheses import all_starts, pairs_of_starts, refined, starts
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.start import Kind, Start
from tcs_friction.diagnose.search.waves import _leads, told_from_torque, wave_start
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import Term, instance

STEP = 100.37  # s


def step(m: Motion) -> np.ndarray:
    return np.where(m.t >= STEP, 1.5, 0.0)


def hidden_pair(m: Motion) -> np.ndarray:
    """A bias that takes away what viscous friction by direction adds in the mean."""
    return 20.0 * (np.abs(m.v) - float(np.mean(np.abs(m.v))))


def names(found: Start) -> set[str]:
    return {kind.effect for kind in found.kinds}


def test_effects_that_hide_each_other_promise_more_together() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(3), hidden_pair))
    projected = ProjectedResidual(balance, fit)
    found = all_starts(projected, frozenset({"backlash", "flexible_mode", "cogging", "torque_ripple"}))
    pairs = pairs_of_starts(projected, found)
    pair = next(p for p in pairs if names(p) == {"torque_bias", "viscous_asymmetry"})
    alone = {s.instance.term.id: s.gain for s in found}
    assert pair.gain > 1.2 * (alone["torque_bias"] + alone["viscous_asymmetry"])
    assert all(p.gain > 0.0 and len(p.instances) == 2 for p in pairs)
    promises = [p.promise for p in pairs]
    assert promises == sorted(promises, reverse=True)


def test_nothing_promises_more_together_where_nothing_is_hidden() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(4)))
    projected = ProjectedResidual(balance, fit)
    found = [s for name in ("torque_bias", "imbalance") for s in starts(projected, effect(name), None)]
    assert all(pair.gain < 30.0 for pair in pairs_of_starts(projected, found))


def test_the_time_of_a_step_is_found_without_derivatives() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5), step))
    projected = ProjectedResidual(balance, fit)
    first = starts(projected, effect("load_step"), None)[0]
    best = refined(projected, first)
    assert abs(first.instance.values["time"] - STEP) > 1.0
    assert best.gain > first.gain
    assert best.instance.values["time"] == pytest.approx(STEP, abs=0.3)
    smooth = Start((instance(effect("torque_bias"), {"bias": 1.0}),), 1.0, 1, 1.0, np.empty((0, 0)))
    assert refined(projected, smooth) is smooth


def test_a_search_without_derivatives_stays_near_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a stiffer contact always gains a little, the search would go on until its numbers overflow."""
    values = {"gap": 1e-4, "inertia_ratio": 0.1, "contact_frequency": 50.0, "contact_damping": 0.5}

    def ever_stiffer(_: object, term: Term, shape: Mapping[str, float], signal: str | None, alternatives: float) -> Start:
        assert all(map(math.isfinite, shape.values()))
        item = instance(term, {"inertia_ratio": 0.1, **shape}, signal=signal)
        return Start((item,), math.log(shape["contact_frequency"]), 1, alternatives, np.empty((0, 0)))

    monkeypatch.setattr(hypotheses, "judged_linear", ever_stiffer)
    first = Start((instance(effect("backlash"), values),), 0.0, 1, 1.0, np.empty((0, 0)))
    best = refined(cast(ProjectedResidual, None), first).instance.shape
    assert 2.0 < best["contact_frequency"] / 50.0 < 21.0


def test_a_gap_with_a_soft_damped_contact_is_found() -> None:
    """As of gears and stops. A stiff contact that hardly damps meets such collisions at other moments."""
    values = {"gap": 2e-4, "inertia_ratio": 0.3, "contact_frequency": 25.0, "contact_damping": 0.7}
    recording, plant = telescope(0.0, 0.05, effects=(instance(effect("backlash"), values),), duration=60.0)
    balance = TorqueBalance(prepare([recording]))
    projected = ProjectedResidual(balance, settle(balance, replace(plant, effects=()), white_noise(balance.samples)))
    found = starts(projected, effect("backlash"), None)
    assert len({start.instance.values["contact_damping"] for start in found}) == len(found)
    best = max((refined(projected, start) for start in found), key=lambda start: start.gain)
    assert best.gain > 0.9 * projected.squares
    assert best.instance.values["gap"] == pytest.approx(2e-4, rel=0.1)


def test_harmonics_belong_to_a_first_one() -> None:
    cogging = effect("cogging")
    plain = {"order": 18.0, "amplitude": 1.0, "phase": 0.0}
    assert _leads(instance(cogging, plain | {"amplitude_2": 1.5}))
    assert not _leads(instance(cogging, plain | {"amplitude_4": 4.0}))


def test_a_wave_that_is_there_is_not_proposed_again() -> None:
    """Nor as the fundamental of another one, of which that is the fourth harmonic."""

    def two(m: Motion) -> np.ndarray:
        return 4.0 * np.cos(7.0 * m.q) + 2.0 * np.cos(28.0 * m.q + 1.0)

    balance, fit = settled(conditioned(np.random.default_rng(5), two))
    nearly = instance(effect("cogging"), {"order": 7.3, "amplitude": 3.0, "phase": 0.0})
    for known, orders in ((fit.axis, {7.0, 28.0}), (fit.axis.with_effect(nearly), {28.0})):
        found = starts(ProjectedResidual(balance, replace(fit, axis=known)), effect("cogging"), None)
        near = {order for order in (7.0, 28.0) for s in found if abs(s.instance.values["order"] - order) < 0.5}
        assert near == orders


def test_noise_of_the_torque_is_no_load_dependence() -> None:
    """All noise is in the logged torque, which the effect could make smaller; a gravity load makes it identifiable."""
    term = effect("load_dependent_friction")
    for coefficient in (0.0, 0.05):
        data = conditioned(np.random.default_rng(9))
        s = data.stretches[0]
        gravity = 100.0 * np.sin(s.position)
        load = 900.0 * s.acceleration + 500.0 * s.velocity + 60.0 * np.sign(s.velocity) + gravity
        torque = s.torque + gravity + coefficient * np.abs(load) * np.sign(s.velocity)
        balance, fit = settled_with_gravity(replace(data, stretches=(replace(s, torque=torque),)))
        found = starts(ProjectedResidual(balance, fit), term, None)
        if coefficient == 0.0:
            assert all(start.gain < 30.0 for start in found)
        else:
            assert found[0].gain > 1000.0
            assert found[0].instance.values["coefficient"] == pytest.approx(coefficient, rel=0.35)


def settled_with_gravity(data: DataSet) -> tuple[TorqueBalance, Fit]:
    believed = axis().with_effect(instance(effect("imbalance"), {"amplitude": 100.0, "phase": 0.0}))
    balance = TorqueBalance(data)
    return balance, settle(balance, believed, white_noise(balance.samples))


def test_a_kind_is_an_effect_and_the_signal_that_it_acts_through() -> None:
    data = conditioned(np.random.default_rng(8), seconds=40.0)
    (s,) = data.stretches
    data = replace(data, names=("flow", "pressure"), stretches=(replace(s, signals=np.vstack([s.signals, s.signals[1] ** 2])),))
    balance, fit = settled(data)
    others = frozenset(effects()) - {"exogenous", "wind_torque", "torque_bias"}
    found = {start.kinds for start in all_starts(ProjectedResidual(balance, fit), others)}
    assert found == {(Kind("exogenous", "flow"),), (Kind("exogenous", "pressure"),), (Kind("torque_bias"),)}
    known = fit.axis.with_effect(instance(effect("exogenous"), {"linear": 1.0}, signal="flow"))
    found = {start.kinds for start in all_starts(ProjectedResidual(balance, replace(fit, axis=known)), others)}
    assert found == {(Kind("exogenous", "pressure"),), (Kind("torque_bias"),)}


@pytest.mark.parametrize("periods", [0.6, 3.0])
def test_a_wave_of_friction_is_told_from_a_torque_with_the_same_wave(periods: float) -> None:
    """It goes on for 41 s, then back, over so many periods: what the wave does on the way back tells the two apart."""
    friction, cogging = effect("position_dependent_friction"), effect("cogging")
    still = conditioned(np.random.default_rng(1), seconds=80.0).joined("velocity")
    order = periods * 2.0 * math.pi / (DT * float(-still[still < 0.0].sum()))
    for sign, told in ((np.sign, True), (np.ones_like, False)):
        data = conditioned(np.random.default_rng(1), lambda m, s=sign: 3.0 * np.cos(order * m.q) * s(m.v), seconds=80.0)
        projected = ProjectedResidual(*settled(data))
        found = wave_start(projected, friction, order, 1.0)
        assert found is not None
        assert found.promise > 100.0, "one way they are the same"
        assert told_from_torque(projected, found) is told
        torque = wave_start(projected, cogging, order, 1.0)
        assert torque is not None
        assert told_from_torque(projected, torque)
