"""The conclusion: a next experiment for the right pair, on an axis without either, and a verdict with its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from concealed_torque_cases import Motion, axis, conditioned, settled, unfitted

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.noise_estimate import estimated
from tcs_friction.diagnose.outcome import conclusion
from tcs_friction.diagnose.outcome.conclusion import conclude
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.proof import (
    _far_larger,
    _not_resolved,
    _Proof,
    found_effects,
)
from tcs_friction.diagnose.outcome.result import Diagnosis, Errors, Found, Verdict
from tcs_friction.diagnose.rules import LEFT, Refusal
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.rivals import Contest
from tcs_friction.diagnose.search.start import Kind, Start, kind_of
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance

BIAS = instance(effect("torque_bias"), {"bias": 2.0})
ASYMMETRY = instance(effect("coulomb_asymmetry"), {"asymmetry": 0.1})  # of 60 N m: larger than the bias
SHARED = instance(effect("viscous_asymmetry"), {"asymmetry": 40.0})
KNOWN = 1e-6  # variance of every number
Pair = tuple[Axis, Instance, Instance]


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit, Fit]:
    """The balance, the retuned fit, the axis with both effects as concealed."""
    balance, retuned = settled(
        conditioned(np.random.default_rng(1), lambda m: np.full(len(m.t), 2.0 + 6.0), seconds=80.0)
    )
    return balance, retuned, unfitted(balance, axis().with_effect(BIAS).with_effect(ASYMMETRY), retuned.noise, KNOWN)


def contest(
    balance: TorqueBalance, improved: Fit, identity: int, *rivals: Instance, gain: float = 100.0
) -> Contest:
    """Of one of the effects; rivals are as good."""
    item = next(x for x in improved.axis.effects if x.identity == identity)
    alone = unfitted(balance, improved.axis.without_effect(item), improved.noise)
    fits = [unfitted(balance, alone.axis.with_effect(rival), alone.noise) for rival in rivals]
    starts = [Start((rival,), gain, 1, 1.0, np.empty((0, 0))) for rival in rivals]
    candidates = tuple(Candidate(gain, 10.0, fit, start) for fit, start in zip(fits, starts, strict=True))
    return Contest(identity, kind_of(item), alone, gain, 5.0, candidates)


def concluded(
    fitted: tuple[TorqueBalance, Fit, Fit], *contests: Contest, improved: Fit | None = None
) -> Diagnosis:
    balance, retuned, both = fitted
    return conclude(balance, AxisFile(axis()), Explanation(retuned, improved or both, improved or both, None, (), contests))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Pair]:
    """Every experiment that is asked for: the axis and the two effects. None is found."""
    pairs: list[Pair] = []

    def next_experiment(base: Axis, a: Instance, b: Instance, *_: object) -> Mapping[str, Any] | None:
        pairs.append((base, a, b))
        return None

    monkeypatch.setattr(conclusion, "next_experiment", next_experiment)
    return pairs


def test_an_experiment_is_designed_on_an_axis_without_either_of_the_two(
    fitted: tuple[TorqueBalance, Fit, Fit], asked: list[Pair]
) -> None:
    """Both effects have the same rival; the larger effect is not the one that was found first."""
    balance, _, improved = fitted
    contests = [contest(balance, improved, item.identity, SHARED.again()) for item in (BIAS, ASYMMETRY)]
    found = concluded(fitted, *contests)
    assert [item.effect for item in found.effects] == ["coulomb_asymmetry", "torque_bias"]
    assert [(a.term.id, b.term.id) for _, a, b in asked] == [
        ("coulomb_asymmetry", "viscous_asymmetry"),
        ("torque_bias", "viscous_asymmetry"),
    ]
    for base, a, b in asked:
        assert not {a.term.id, b.term.id} & {item.term.id for item in base.effects}
        assert len(base.effects) == 1, "the other effect stays"


def test_an_experiment_separates_an_effect_from_its_own_rival(
    fitted: tuple[TorqueBalance, Fit, Fit], asked: list[Pair]
) -> None:
    """Though a contest of another effect has such a rival, too, with other values and not as good."""
    balance, _, improved = fitted
    other, own = SHARED.again().replace(asymmetry=1.0), SHARED.again().replace(asymmetry=2.0)
    lost = contest(balance, improved, BIAS.identity, other)
    lost = replace(lost, rivals=(replace(lost.rivals[0], gain=10.0),))
    concluded(fitted, lost, contest(balance, improved, ASYMMETRY.identity, own))
    ((base, a, b),) = asked
    assert a.identity == ASYMMETRY.identity
    assert b.identity == own.identity
    assert [item.term.id for item in base.effects] == ["torque_bias"]


def test_without_equivalents_no_experiment_is_proposed(
    fitted: tuple[TorqueBalance, Fit, Fit], asked: list[Pair]
) -> None:
    balance, _, improved = fitted
    found = concluded(fitted, contest(balance, improved, BIAS.identity))
    assert asked == []
    assert found.next_experiment is None


@pytest.mark.usefixtures("asked")
def test_effects_are_told_with_their_own_contests(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, _, improved = fitted
    rivals = {BIAS.identity: (), ASYMMETRY.identity: (SHARED.again(),)}
    contests = [contest(balance, improved, identity, *own, gain=50.0 + len(own)) for identity, own in rivals.items()]
    found = {item.effect: item for item in concluded(fitted, *contests).effects}
    assert found["torque_bias"].equivalent == ()
    assert found["coulomb_asymmetry"].equivalent == (Kind("viscous_asymmetry"),)
    assert found["coulomb_asymmetry"].probability == pytest.approx(0.5 * found["torque_bias"].probability, rel=1e-3)
    difference = found["torque_bias"].delta_bic - found["coulomb_asymmetry"].delta_bic
    assert difference == pytest.approx(1.0), "the gains are those of their contests"
    for item, size in ((found["torque_bias"], 2.0), (found["coulomb_asymmetry"], 6.0)):
        assert item.torque_rms == pytest.approx(size, rel=0.1)
        assert item.before > 1.2 * item.after
    bias = found["torque_bias"].parameters["bias"]
    assert bias["value"] == 2.0
    assert bias["std"] == pytest.approx(1e-3 * improved.squares.dispersion**0.5), "of a number known to a thousandth"
    assert bias["unit"] == "N m"


def test_verdicts_follow_from_what_was_found(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, improved = fitted
    contests = [contest(balance, improved, item.identity) for item in improved.axis.effects]
    assert concluded(fitted, *contests).verdict is Verdict.MISSING_PHYSICS
    doubted = [replace(one, gain=0.0) for one in contests]
    assert concluded(fitted, *doubted).verdict is Verdict.UNEXPLAINED, "what is not established is described"
    assert {one.effect for one in concluded(fitted, *doubted).described} == {"torque_bias", "coulomb_asymmetry"}
    spare = [replace(one, without=improved) for one in doubted]
    assert concluded(fitted, *spare).verdict is Verdict.MATCH, "nothing is missed without them, however large they are"
    far = concluded(fitted, improved=retuned)
    assert far.verdict is Verdict.UNEXPLAINED, "nothing is named, and far more than noise is left"
    assert far.unexplained.where is not None
    assert far.unexplained.where["coordinates"] == ["time"]
    known = AxisFile(improved.axis)
    assert conclude(balance, known, Explanation(improved, improved, improved, None)).verdict is Verdict.MATCH
    wrong = AxisFile(replace(improved.axis, inertia=1.3 * improved.axis.inertia))
    assert conclude(balance, wrong, Explanation(improved, improved, improved, None)).verdict is Verdict.PARAMETERS


@pytest.mark.parametrize(("times", "verdict"), [(1.05, Verdict.MATCH), (30.0, Verdict.UNEXPLAINED)])
def test_an_axis_that_leaves_more_than_a_constant_torque_is_no_match(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch, times: float, verdict: Verdict
) -> None:
    """Although all that it leaves is taken for noise: of an acceleration that a wrong inertia multiplies, say."""
    balance, _, improved = fitted
    wrong = unfitted(balance, replace(improved.axis, inertia=times * improved.axis.inertia), improved.noise)
    left = np.std(balance.residual(wrong.axis, wrong.noise)[balance.held_out])
    monkeypatch.setattr(conclusion, "noise_floor", lambda *_: float(left))
    found = conclude(balance, AxisFile(wrong.axis), Explanation(wrong, wrong, wrong, None))
    assert found.verdict is verdict
    told = "Not to be judged from this: anything, since a constant torque leaves only" in found.statement
    assert told == (verdict is Verdict.UNEXPLAINED)


@pytest.mark.parametrize(("floors", "told"), [(1.4, False), (1.6, True)])
def test_what_is_half_as_large_again_as_the_noise_is_unexplained(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch, floors: float, told: bool
) -> None:
    """Although no map of it was found."""
    _, _, improved = fitted
    contests = [contest(fitted[0], improved, item.identity) for item in improved.axis.effects]
    left = concluded(fitted, *contests).improved
    monkeypatch.setattr(conclusion, "noise_floor", lambda *_: max(left.train, left.held_out) / floors)
    assert concluded(fitted, *contests).unexplained.present == told


@pytest.mark.parametrize(("floors", "equivalent"), [(1.4, ()), (1.6, ("cable_wrap",))])
def test_a_spring_is_equivalent_to_gravity_where_far_more_than_noise_is_left(
    fitted: tuple[TorqueBalance, Fit, Fit], floors: float, equivalent: tuple[str, ...]
) -> None:
    """It explains nine tenths as much. So does friction by direction, which is no torque of the position."""
    balance, retuned, _ = fitted
    gravity = instance(effect("imbalance"), {"amplitude": 5.0, "phase": 0.3})
    spring = instance(effect("cable_wrap"), {"stiffness": 5.0, "cubic": 0.0, "neutral": 0.0})
    improved = unfitted(balance, axis().with_effect(gravity), retuned.noise, KNOWN)
    (item,) = improved.axis.effects
    found = contest(balance, improved, item.identity, spring, SHARED)
    found = replace(found, rivals=tuple(replace(rival, gain=92.0) for rival in found.rivals))
    left = rms(balance.residual(improved.axis, improved.noise)[balance.held_out])
    (one,) = found_effects(balance, Explanation(retuned, improved, improved, None, (), (found,)), axis(), left / floors)
    assert tuple(kind.effect for kind in one.equivalent) == equivalent


def test_an_effect_with_which_a_simulation_moves_worse_is_not_named(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It predicts the torque well, but what it says of the motion is wrong."""
    _, _, improved = fitted
    contests = [contest(fitted[0], improved, item.identity) for item in improved.axis.effects]

    def with_asymmetry(_: object, model: Axis, **_rest: float) -> np.ndarray:
        return np.full(50, 1.0 + sum(item.term.id == "coulomb_asymmetry" for item in model.effects))

    monkeypatch.setattr(conclusion, "window_errors", with_asymmetry)
    found = concluded(fitted, *contests)
    assert found.verdict is Verdict.UNEXPLAINED
    assert [one.effect for one in found.effects] == ["torque_bias"]
    assert [one.effect for one in found.described] == ["coulomb_asymmetry"]
    assert "A simulation with coulomb asymmetry predicts torque better and moves worse" in found.statement
    assert "can cancel torque bias." in found.statement


def test_nothing_is_named_where_the_believed_axis_moves_best(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The retuned axis moves worse than both: what is wrong with its numbers may be what the effects mend."""
    balance, retuned, improved = fitted
    contests = [contest(balance, improved, item.identity) for item in improved.axis.effects]
    strays = {id(retuned.axis): 4.0, id(improved.axis): 2.0}
    monkeypatch.setattr(conclusion, "window_errors", lambda _, model, **__: np.full(50, strays.get(id(model), 1.0)))
    found = concluded(fitted, *contests)
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.effects == ()
    assert {one.effect for one in found.described} == {"torque_bias", "coulomb_asymmetry"}
    assert "coulomb asymmetry and torque bias predicts torque better and moves worse" in found.statement


class _Loop:
    """A closed loop in which the effects of one kind make an axis follow worse. known: whether the controller is the file's."""

    def __init__(self, kind: str, known: bool) -> None:
        self._kind, self._known = kind, known

    def errors(self, model: Axis) -> np.ndarray:
        return np.full(50, 1.0 + sum(item.term.id == self._kind for item in model.effects))

    def predicts(self, errors: np.ndarray) -> bool:  # noqa: ARG002
        return self._known


@pytest.mark.parametrize("known", [True, False])
def test_an_effect_with_which_a_controlled_axis_follows_worse_is_not_named(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """If the recording was made under the controller that the axis file knows."""
    _, _, improved = fitted
    contests = [contest(fitted[0], improved, item.identity) for item in improved.axis.effects]
    monkeypatch.setattr(conclusion, "closed_loop", lambda *_: _Loop("torque_bias", known))
    found = concluded(fitted, *contests)
    assert [one.effect for one in found.described] == (["torque_bias"] if known else [])
    assert dict(found.closed_loop) == (pytest.approx({"believed": 1.0, "retuned": 1.0, "improved": 2.0}) if known else {})
    assert (found.to_mapping()["closed_loop"] is not None) == known
    assert ("moves worse" in found.statement) == known


def test_effects_stay_named_where_none_of_them_alone_makes_a_simulation_move_worse(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, improved = fitted
    contests = [contest(fitted[0], improved, item.identity) for item in improved.axis.effects]
    monkeypatch.setattr(conclusion, "window_errors", lambda _, axis, **_rest: np.full(50, 1.0 + len(axis.effects)))
    found = concluded(fitted, *contests)
    assert found.verdict is Verdict.UNEXPLAINED
    assert {one.effect for one in found.effects} == {"torque_bias", "coulomb_asymmetry"}
    assert "but a simulation with that moves no better" in found.statement


def test_collisions_are_not_named_where_a_simulation_moves_worse(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    """None comes at its exact time, so that only a better motion proves them; here each effect alone makes it worse."""
    balance, retuned, both = fitted
    slack = instance(effect("backlash"), {"gap": 1e-3, "inertia_ratio": 0.2})
    rattling = unfitted(balance, both.axis.with_effect(slack), both.noise, KNOWN)
    contests = [contest(balance, rattling, item.identity) for item in rattling.axis.effects]
    named = found_effects(balance, Explanation(retuned, rattling, rattling, None, (), tuple(contests)), axis(), 0.1)
    certain = tuple(replace(one, refused=()) for one in named)
    monkeypatch.setattr(conclusion, "found_effects", lambda *_: certain)
    monkeypatch.setattr(conclusion, "window_errors", lambda _, axis, **_rest: np.full(50, 1.0 + len(axis.effects)))
    found = concluded(fitted, *contests, improved=rattling)
    assert [one.effect for one in found.described] == ["backlash"]
    assert {one.effect for one in found.effects} == {"torque_bias", "coulomb_asymmetry"}
    monkeypatch.setattr(conclusion, "window_errors", lambda _, axis, **_rest: np.full(50, 9.0 - len(axis.effects)))
    assert "backlash" in [one.effect for one in concluded(fitted, *contests, improved=rattling).effects]


def test_a_map_with_which_a_simulation_moves_worse_takes_no_name_away(
    fitted: tuple[TorqueBalance, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    balance, retuned, both = fitted
    little = SHARED.replace(asymmetry=0.01)  # stands for a map that does no harm to held-out data
    mapped = unfitted(balance, both.axis.with_effect(little), both.noise, KNOWN)
    contests = tuple(contest(balance, both, item.identity) for item in both.axis.effects)
    runs = {2: 1.0, 3: 3.0}  # of the axis with the two effects, and with the map
    monkeypatch.setattr(conclusion, "window_errors", lambda _, axis, **_rest: np.full(50, runs.get(len(axis.effects), 2.0)))
    found = conclude(balance, AxisFile(axis().with_effect(little)), Explanation(retuned, both, mapped, None, (), contests))
    assert {one.effect for one in found.effects} == {"torque_bias", "coulomb_asymmetry"}
    assert found.axis_file.axis is mapped.axis


def test_a_map_that_predicts_held_out_data_worse_is_left_out(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, both = fitted
    mapped = unfitted(balance, both.axis.with_effect(SHARED), both.noise, KNOWN)
    contests = tuple(contest(balance, both, item.identity) for item in both.axis.effects)
    found = conclude(balance, AxisFile(axis()), Explanation(retuned, both, mapped, None, (), contests))
    assert found.axis_file.axis is both.axis
    assert {one.effect for one in found.effects} == {"torque_bias", "coulomb_asymmetry"}


def test_what_a_map_predicts_is_no_proof_of_an_effect(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    """A small effect beside a large torque of unknown cause, which the map takes away."""
    balance, retuned, both = fitted
    alone = unfitted(balance, both.axis.without_effect(ASYMMETRY), both.noise, KNOWN)
    small = contest(balance, alone, BIAS.identity)
    found = conclude(balance, AxisFile(axis()), Explanation(retuned, alone, both, None, (), (small,)))
    (bias,) = [one for one in found.described if one.effect == "torque_bias"]
    assert bias.agreement.explained < 0.5


def test_collisions_that_explain_little_are_described_only(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    """Whatever they gain: they scatter between the pieces, so nothing but what they leave speaks against them."""
    balance, retuned, _ = fitted
    gap = instance(effect("backlash"), {"gap": 1e-3, "inertia_ratio": 0.5})
    knocking = unfitted(balance, axis().with_effect(gap), retuned.noise, KNOWN)
    small = contest(balance, knocking, gap.identity, gain=1e4)
    found = concluded(fitted, small, improved=knocking)
    assert found.effects == ()
    (backlash,) = found_effects(balance, Explanation(retuned, knocking, knocking, None, (), (small,)), axis(), 0.3)
    assert backlash.probability < 0.5


def test_a_fit_that_was_cut_short_is_said(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    balance, retuned, improved = fitted
    done = replace(improved, outcome=Outcome.CONVERGED)
    ends = (Outcome.CONVERGED, Outcome.BUDGET_SPENT)
    notes = [concluded((balance, replace(retuned, outcome=end), done)).evidence.notes for end in ends]
    assert notes[0] == balance.data.notes
    assert notes[1] == (*notes[0], "the fit of the retuned model was still gaining when its last step was taken")


def test_a_wave_that_echoes_a_larger_one_of_its_order_is_not_named(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    """A fifth of a cogging's torque is what a wrong gain or timing of the log leaves of it."""
    balance, retuned, _ = fitted
    cogging = instance(effect("cogging"), {"order": 40.0, "amplitude": 5.0, "phase": 0.3})
    for order, amplitude, echo in ((40.0, 0.8, True), (40.0, 2.0, False), (90.0, 0.8, False)):
        second = instance(effect("cogging"), {"order": order, "amplitude": amplitude, "phase": 1.8})
        fit = unfitted(balance, axis().with_effect(cogging).with_effect(second), retuned.noise, KNOWN)
        proof = _Proof(balance, Explanation(retuned, fit, fit, None, (), ()))
        item = fit.axis.effects[-1]
        assert (proof._echo(item, proof._size(item)) is not None) == echo, (order, amplitude)


@pytest.fixture(scope="module")
def two_found(fitted: tuple[TorqueBalance, Fit, Fit]) -> tuple[Found, Found]:
    """Both effects of the fit with their proofs, the larger one first."""
    balance, retuned, both = fitted
    contests = tuple(contest(balance, both, item.identity) for item in both.axis.effects)
    large, small = found_effects(balance, Explanation(retuned, both, both, None, (), contests), axis(), 0.3)
    return large, small


def within_the_noise_beside(
    larger: Instance, small: Instance, torque: Callable[[Motion], np.ndarray]
) -> tuple[_Proof, Found, Found]:
    """Proofs of two effects that are there, and of nothing else, the larger one first."""
    balance, retuned = settled(conditioned(np.random.default_rng(3), torque, seconds=80.0))
    both = unfitted(balance, axis().with_effect(larger).with_effect(small), retuned.noise, KNOWN)
    contests = tuple(contest(balance, both, item.identity) for item in both.axis.effects)
    proof = _Proof(balance, Explanation(retuned, both, both, None, (), contests))
    return proof, proof.found(larger), proof.found(small)


CABLE = instance(effect("cable_wrap"), {"stiffness": 5.0, "neutral": -1.0})
GRAVITY = instance(effect("imbalance"), {"amplitude": 0.3, "phase": 0.4})
WARM = instance(effect("temperature_dependent_friction"), {"dry": 0.02, "viscous": 0.0, "reference_temperature": 10.0})


def of_cable(m: Motion) -> np.ndarray:
    """Torque of CABLE, N m."""
    return 5.0 * (m.q + 1.0)


def of_warmth(m: Motion) -> np.ndarray:
    """Torque of WARM, N m."""
    temperature = 15.0 + 5.0 * (1.0 - np.exp(-m.t / 100.0))
    return 60.0 * 0.02 * (temperature - 10.0) * np.sign(m.v)


@pytest.mark.parametrize(
    ("larger", "small", "torque", "outshone"),
    [
        (CABLE, GRAVITY, lambda m: of_cable(m) + 0.3 * np.sin(m.q + 0.4), True),
        (
            CABLE,
            instance(effect("cogging"), {"order": 40.0, "amplitude": 0.3, "phase": 0.0}),
            lambda m: of_cable(m) + 0.3 * np.cos(40.0 * m.q),
            False,
        ),
        (
            CABLE,
            instance(effect("load_step"), {"step": 0.3, "time": 40.0}),
            lambda m: of_cable(m) + 0.3 * (m.t > 40.0),
            False,
        ),
        (
            WARM,
            instance(effect("quadratic_drag"), {"coefficient": 30.0}),
            lambda m: of_warmth(m) + 30.0 * m.v * np.abs(m.v),
            True,
        ),
        (
            instance(effect("position_dependent_friction"), {"order": 1.0, "amplitude": 0.05, "phase": 0.0}),
            instance(effect("torque_bias"), {"bias": 0.3}),
            lambda m: 60.0 * 0.05 * np.cos(m.q) * np.sign(m.v) + 0.3,
            False,
        ),
        (
            instance(effect("cogging"), {"order": 40.0, "amplitude": 3.0, "phase": 0.0}),
            instance(effect("cogging"), {"order": 41.0, "amplitude": 0.3, "phase": 0.0}),
            lambda m: 3.0 * np.cos(40.0 * m.q) + 0.3 * np.cos(41.0 * m.q),
            True,
        ),
        (
            instance(effect("wind_torque"), {"coefficient": 1.0}, signal="wind_speed"),
            instance(effect("torque_bias"), {"bias": 0.3}),
            lambda m: np.full(len(m.t), 0.3),
            True,
        ),
    ],
    ids=[
        "position and position",
        "wave",
        "event",
        "friction and friction",
        "friction and constant",
        "wave and wave",
        "signal and constant",
    ],
)
def test_an_effect_within_the_noise_is_described_only_where_a_much_larger_one_in_another_form_does_the_same(
    larger: Instance, small: Instance, torque: Callable[[Motion], np.ndarray], outshone: bool
) -> None:
    """A spring that is not quite linear does what gravity does, but no wave and no step in time; wind acts in its mean, too."""
    proof, large, one = within_the_noise_beside(larger, small, torque)
    assert (proof.outshone(one, [large, one], 2.0 * one.torque_rms) is not None) == outshone


def test_what_is_beyond_the_noise_or_not_much_smaller_is_named_beside_a_larger_effect() -> None:
    """Wind is told worse than that: how it acts as the axis turns is in no recorded signal."""
    proof, large, small = within_the_noise_beside(CABLE, GRAVITY, lambda m: of_cable(m) + 0.3 * np.sin(m.q + 0.4))
    for size, floor, outshone in ((0.2, 0.5, True), (0.2, 0.1, False), (0.4, 0.5, False)):
        one, noise = replace(small, torque_rms=size * large.torque_rms), floor * large.torque_rms
        assert (proof.outshone(one, [large, one], noise) is not None) == outshone, (size, floor)
        assert not proof.outshone(one, [one], noise), "the other one is described only"
        assert not proof.outshone(large, [large, one], noise)
    wind = replace(large, instance=instance(effect("wind_torque"), {"coefficient": 0.03}, signal="wind_speed"))
    one = replace(small, torque_rms=0.4 * large.torque_rms)
    assert _far_larger(wind, one)
    assert not _far_larger(large, one)


def test_what_is_left_of_held_out_data_hides_small_effects_as_the_noise_does() -> None:
    """A noise floor that says too little names nothing."""
    sizes = {40.0: 3.0, 47.0: 0.3}
    waves = [instance(effect("cogging"), {"order": order, "amplitude": size, "phase": 0.0}) for order, size in sizes.items()]
    data = conditioned(np.random.default_rng(3), lambda m: 3.0 * np.cos(40.0 * m.q) + 0.3 * np.cos(47.0 * m.q), seconds=80.0)
    balance, retuned = settled(data)
    complete = axis().with_effect(waves[0]).with_effect(waves[1])
    both = unfitted(balance, complete, estimated(balance, complete, retuned.noise), KNOWN)
    contests = tuple(contest(balance, both, item.identity) for item in both.axis.effects)
    explanation = Explanation(retuned, both, both, None, (), contests)
    assert rms(balance.residual(both.axis, both.noise)[balance.held_out]) > 0.25 > 0.3 / math.sqrt(2.0)
    found = found_effects(balance, explanation, axis(), 0.01)
    assert [one.established for one in found] == [True, False]
    assert min(one.probability for one in found) > 0.9, "small as it is, it is sure beside nothing larger"


def wind_and_gravity(torque: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> tuple[_Proof, Found, Found]:
    """Proofs of wind and of gravity, fitted to a torque that position and wind speed, (n,) each, give."""
    still = conditioned(np.random.default_rng(3))
    (stretch,) = still.stretches
    blowing = stretch.signals + np.array([[0.0], [6.0]])
    pushed = replace(stretch, signals=blowing, torque=stretch.torque + torque(stretch.position, blowing[1]))
    balance, retuned = settled(replace(still, stretches=(pushed,)))
    wind = instance(effect("wind_torque"), {"coefficient": 0.05}, signal="wind_speed")
    gravity = instance(effect("imbalance"), {"amplitude": 1.0, "phase": 0.5 * math.pi})
    both = settle(balance, axis().with_effect(wind).with_effect(gravity), retuned.noise)
    contests = []
    for item in both.axis.effects:
        without = settle(balance, both.axis.without_effect(item), both.noise)
        contests.append(replace(contest(balance, both, item.identity), without=without))
    proof = _Proof(balance, Explanation(retuned, both, both, None, (), tuple(contests)))
    return proof, *map(proof.found, both.axis.effects)


def test_gravity_that_wind_of_another_form_does_is_described_only() -> None:
    """A panel that turns its face away is gravity in the mean, as large as the wind or not."""
    for panel, gravity in ((lambda q: np.cos(q) ** 2, 0.0), (np.ones_like, 1.0)):
        proof, wind, small = wind_and_gravity(lambda q, w, f=panel, g=gravity: 0.05 * f(q) * w * np.abs(w) + g * np.cos(q))
        for one in (small, replace(small, torque_rms=2.0 * wind.torque_rms)):
            assert (proof.in_the_mean_of_a_signal(one, [wind, one]) is not None) == (gravity == 0.0)
        assert not proof.in_the_mean_of_a_signal(small, [small])


def test_gravity_smaller_than_what_a_signal_does_wrongly_is_described_only() -> None:
    proof, wind, gravity = wind_and_gravity(lambda q, w: 0.05 * w * np.abs(w) + np.cos(q))
    wrong = wind.unless(Refusal(LEFT, "what is left could be it"))
    assert gravity.torque_rms < wind.torque_rms
    assert proof.in_the_mean_of_a_signal(gravity, [wrong, gravity])
    cogging = replace(gravity, instance=instance(effect("cogging"), {"order": 40.0, "amplitude": 1.0, "phase": 0.0}))
    assert not proof.in_the_mean_of_a_signal(cogging, [wrong, cogging]), "no wind has waves over the position"
    assert not proof.in_the_mean_of_a_signal(gravity, [replace(wind, refused=()), gravity])
    larger = replace(gravity, torque_rms=2.0 * wind.torque_rms)
    assert not proof.in_the_mean_of_a_signal(larger, [wrong, larger])


def test_of_effects_that_take_each_other_away_none_is_named_where_more_is_left_than_noise(
    fitted: tuple[TorqueBalance, Fit, Fit],
) -> None:
    """Of two large torques against each other only their sum is known."""
    balance, retuned, _ = fitted
    for turned, gone in ((math.pi, True), (0.0, False)):
        pair = [instance(effect("imbalance"), {"amplitude": a, "phase": p}) for a, p in ((20.0, 1.2), (15.0, 1.2 + turned))]
        fit = unfitted(balance, axis().with_effect(pair[0]).with_effect(pair[1]), retuned.noise, KNOWN)
        proof = _Proof(balance, Explanation(retuned, fit, fit, None, (), ()))
        assert [proof.cancelled(item) is not None for item in fit.axis.effects] == [gone, gone]
        contests = tuple(contest(balance, fit, item.identity) for item in fit.axis.effects)
        for floor in (0.3, 1e3):
            found = found_effects(balance, Explanation(retuned, fit, fit, None, (), contests), axis(), floor)
            if gone and floor < 1.0:
                assert not any(one.established for one in found)


def test_friction_of_the_position_that_echoes_a_larger_one_is_not_named(fitted: tuple[TorqueBalance, Fit, Fit]) -> None:
    """Friction that falls around a place in a form of its own leaves waves of friction beside the bump that is fitted to it."""
    balance, retuned, _ = fitted
    bump = instance(effect("local_friction_bump"), {"amplitude": -0.3, "centre": 0.0, "width": 0.6})
    for amplitude, echo in ((0.005, True), (0.3, False)):
        wave = instance(effect("position_dependent_friction"), {"order": 8.6, "amplitude": amplitude, "phase": 0.0})
        fit = unfitted(balance, axis().with_effect(bump).with_effect(wave), retuned.noise, KNOWN)
        proof = _Proof(balance, Explanation(retuned, fit, fit, None, (), ()))
        item = fit.axis.effects[-1]
        assert (proof._echo(item, proof._size(item)) is not None) == echo, amplitude
        first = fit.axis.effects[0]
        assert proof._echo(first, proof._size(first)) is None


@pytest.mark.parametrize(
    ("believed", "retuned", "improved", "fails"),
    [(0.64, 0.91, 1.01, True), (0.64, 0.91, 0.5, False), (0.64, 0.6, 0.7, False), (0.31, 0.36, 0.36, False)],
)
def test_a_retuning_that_predicts_worse_is_no_better_model(
    believed: float, retuned: float, improved: float, fails: bool
) -> None:
    held = {"believed": believed, "retuned": retuned, "improved": improved}
    errors = {name: Errors(1.0, value) for name, value in held.items()}
    assert conclusion._retuning_fails(errors, 0.29) == fails


@pytest.mark.parametrize(("deviation", "resolved"), [(0.5, True), (1.5, False)])
def test_the_size_of_a_named_effect_is_told_from_zero(deviation: float, resolved: bool) -> None:
    for value in (2.0, -2.0):
        assert (_not_resolved(BIAS, {"bias": {"value": value, "std": deviation}}) is None) is resolved
    lag = instance(effect("actuator_lag"), {"time_constant": 0.01})
    assert _not_resolved(lag, {"time_constant": {"value": 0.01, "std": 0.02}}) is None, "a shape has bounds of its own"
