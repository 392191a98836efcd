"""The friction law as a question of its own: what a believed law lacks of the one that the axis has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple, cast

import numpy as np
import pytest
from closed_loop_cases import telescope_file
from concealed_torque_cases import conditioned, settled
from open_loop_cases import LUGRE, axis

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Multisine, Reference
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, settle, under
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.outcome.result import Verdict
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.search import laws
from tcs_friction.diagnose.search.laws import (
    LawCandidate,
    _implausible,
    completing,
    lacks,
    missing_features,
    other_laws,
    starting_axes,
)
from tcs_friction.diagnose.search.projection import survey
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Feature, Survey, Term, instance
from tcs_friction.recording.recording import Recording

SURVEY = Survey((-0.5, 0.5), 1e-5, 5e-3, 0.0, 80.0, 20.0, 5e-8, 1000.0, 60.0, 0.0)
VALUES = LUGRE | {"exponent": 2.0, "shape_1": 0.9, "shape_2": 1.1, "shape_3": 0.85}
VALUES |= {"transient": 25.0, "presliding_distance": 6e-4, "ratio": 0.4}


class FakeSquares(float):
    """Squares of a fit whose dispersion is one."""

    dispersion = 1.0


class FakeFit(NamedTuple):
    """What of a fit decides between laws."""

    axis: Axis
    squares: FakeSquares
    free: tuple[int, ...]
    noise: None = None


def with_law(name: str, factor: float = 1.0) -> Axis:
    """The axis of the open-loop cases with another law, its values off by a factor."""
    values = {p.name: factor * VALUES[p.name] for p in law(name).parameters if p.name in VALUES}
    return replace(axis(), friction=instance(law(name), values))


@cache
def tracked(name: str) -> Recording:
    """That axis in the telescope's controller, slow enough for what friction does at low speed."""
    control = telescope_file().control
    assert control is not None
    sensors, drive = Sensors(noise=5e-8), Drive(noise=0.2, noise_bandwidth=60.0)
    true = replace(with_law(name), sensors=sensors, drive=drive)
    sines = Multisine(2e-3, lowest_frequency=0.02, frequency_step=0.031, components=4, duration=80.0)
    run = simulate_loop(true, Reference(sines), control.controller, control.loop, control.observer, control.compensator, 3)
    return Recording(run.t, run.position, run.torque, source="simulated")


@pytest.mark.parametrize(
    ("true", "believed", "names"),
    [
        ("lugre", "dahl_viscous", {"stribeck"}),  # no effect adds the bristles' damping to a Dahl law
        ("lugre", "coulomb_viscous", {"stribeck", "presliding"}),
        ("dahl_viscous", "lugre", set()),  # a law that has all and more
        ("coulomb_viscous", "coulomb_viscous", set()),  # at rest it only bounds the torque
        ("coulomb_viscous", "dahl_viscous", set()),  # whose memory says what nothing remembers
        ("stribeck_static", "dahl_viscous", {"stribeck"}),
        ("bliman_sorine", "stribeck_static", {"presliding"}),  # of which the drop is no part
        ("reset_integrator", "dahl_viscous", {"stribeck"}),  # whose torque jumps where the bond breaks
    ],
)
def test_a_law_that_is_believed_is_told_what_it_lacks(true: str, believed: str, names: set[str]) -> None:
    found = diagnose([tracked(true)], AxisFile(with_law(believed, 1.1)))
    assert {one.effect for one in found.effects} == names
    assert found.improved.held_out < 1.2 * found.noise_floor
    expected = (Verdict.MISSING_PHYSICS,) if names else (Verdict.PARAMETERS, Verdict.MATCH)
    assert found.verdict in expected
    if names:
        assert found.free_run["improved"] < found.free_run["retuned"]


def test_bristles_that_went_astray_do_not_keep_a_law_from_being_found() -> None:
    """A retuned law that is wrong may bend as far as the axis moves; the believed one says better how far bristles bend."""
    believed = with_law("bliman_sorine", 1.1)
    balance = TorqueBalance(prepare([tracked("lugre")]))
    fit = settle(balance, believed, white_noise(balance.samples))
    wide = {"presliding_distance": 300.0 * believed.friction.values["presliding_distance"], "ratio": 0.013}
    astray = under(balance, replace(fit, axis=fit.axis.with_friction(dict(fit.axis.friction.values) | wide)), fit.noise)
    (found,) = laws.law_candidates(balance, astray, [law("lugre")], believed)
    assert found.plausible
    assert found.gain > 0.0
    assert found.fit.axis.friction.values["stiffness"] == pytest.approx(LUGRE["stiffness"], rel=0.1)


@pytest.mark.parametrize("known", [False, True])
def test_a_law_takes_over_the_parts_that_effects_have_of_it(known: bool) -> None:
    """A drop that was added to a law without one, and a law with a drop, are one drop; a believed effect stays."""
    drop = instance(effect("stribeck"), {"drop": 30.0, "stribeck_velocity": 1e-3})
    gravity = instance(effect("imbalance"), {"amplitude": 1.0, "phase": 0.0})
    plain = with_law("coulomb_viscous", 1.1)
    balance = TorqueBalance(prepare([tracked("stribeck_static")], at_rest=False))
    fit = settle(balance, plain.with_effect(drop).with_effect(gravity), white_noise(balance.samples), rounds=1)
    believed = plain.with_effect(drop) if known else plain
    (found,) = laws.law_candidates(balance, fit, [law("stribeck_static")], believed)
    assert [item.term.id for item in found.fit.axis.effects] == (["stribeck", "imbalance"] if known else ["imbalance"])


def test_a_better_law_that_an_effect_comes_before_is_taken_beside_it() -> None:
    """The bias does more than the free curve: the curve's turn comes once the bias is in."""
    recording = tracked("free_curve")
    found = diagnose([replace(recording, torque=recording.torque + 2.0)], AxisFile(with_law("lugre", 1.1)))
    assert [one.effect for one in found.effects] == ["torque_bias"]
    assert found.axis_file.axis.friction.term.id == "free_curve"
    assert found.improved.held_out < 1.2 * found.noise_floor


def test_the_improved_axis_has_the_better_law() -> None:
    found = diagnose([tracked("lugre")], AxisFile(with_law("dahl_viscous")))
    friction = found.axis_file.axis.friction
    assert friction.term.id == "lugre"
    assert friction.values["static"] == pytest.approx(90.0, rel=0.02)
    drop = found.effects[0].parameters["drop"]
    assert drop["value"] == pytest.approx(30.0, abs=5.0 * drop["std"] + 0.1)
    assert 0.0 < drop["std"] < 3.0
    assert drop["unit"] == "N m"


def test_what_grows_with_the_load_takes_no_other_law() -> None:
    own = with_law("dahl_viscous")
    others = other_laws(own)
    assert own.friction.term not in others
    assert all(term.features >= own.friction.term.features and "torque" not in term.reads for term in others)


def test_a_law_with_a_drop_may_give_way_to_one_without() -> None:
    assert {term.id for term in other_laws(with_law("stribeck_static"))} >= {"bliman_sorine", "dahl_viscous", "lugre"}
    others = {term.id for term in other_laws(with_law("lugre"))}
    assert "bliman_sorine" in others
    assert not others & {"dahl_viscous", "coulomb_viscous"}, "LuGre's law without a drop, and less"


def test_a_law_with_what_the_data_cannot_carry_takes_no_place() -> None:
    own = with_law("coulomb_viscous")
    assert {term.id for term in other_laws(own, frozenset({"presliding"}))} == {"stribeck_static"}
    assert other_laws(own, frozenset({"presliding", "stribeck"})) == []


def test_at_one_speed_no_other_form_of_the_curve_takes_its_place() -> None:
    every, at_one_speed = other_laws(with_law("lugre")), other_laws(with_law("lugre"), frozenset({"stribeck"}))
    assert {term.id for term in every} - {term.id for term in at_one_speed} == {"free_curve"}


@pytest.mark.parametrize(
    ("turns", "changed", "worth"),
    [
        (8, {}, True),
        (1, {}, False),  # bristles that are bent one way only
        (8, {"static": 6000.0}, False),  # a hundred times the Coulomb friction
        (8, {"stiffness": 60.0 / 0.2}, False),  # a bristle over a fifth of the travel
    ],
)
def test_a_law_is_like_friction_and_shown_by_the_motion(turns: int, changed: dict[str, float], worth: bool) -> None:
    view = replace(SURVEY, turns=lambda bristle: [(0.0, 1.0)] * turns if bristle < 0.01 else [])
    rich = with_law("lugre").friction
    assert _implausible(with_law("coulomb_viscous").friction, rich.replace(**changed), view) is not worth


def test_of_a_law_that_rises_with_the_speed_no_drop_is_lacking(monkeypatch: pytest.MonkeyPatch) -> None:
    """A free curve may rise; it is taken, and it is told from laws whose friction is the same at all speeds."""
    rising = with_law("free_curve").friction.replace(static=50.0)
    view = replace(SURVEY, turns=lambda _: [(0.0, 1.0)] * 8)
    assert not _implausible(with_law("dahl_viscous").friction, rising, view)
    fit = cast(Fit, FakeFit(replace(axis(), friction=rising), FakeSquares(100.0), free=(0, 1, 2)))

    worse = cast(Fit, FakeFit(with_law("dahl_viscous"), FakeSquares(900.0), free=(0, 1)))
    monkeypatch.setattr(laws, "law_candidates", lambda *_: [LawCandidate(worse, 0.0, 10.0, plausible=True)])
    monkeypatch.setattr(laws, "threshold", lambda *_: 10.0)
    monkeypatch.setattr(laws, "_with_effects_alike", lambda *_: [])
    assert lacks(cast(TorqueBalance, None), fit, with_law("dahl_viscous")) == (fit, ())


def test_a_curve_that_no_other_law_has_is_found_and_its_drop_named() -> None:
    found = diagnose([tracked("free_curve")], AxisFile(with_law("dahl_viscous", 1.1)))
    assert [one.effect for one in found.effects] == ["stribeck"]
    assert found.axis_file.axis.friction.term.id == "free_curve"
    assert found.improved.held_out < 1.2 * found.noise_floor
    drop = found.effects[0].parameters["drop"]
    assert drop["value"] == pytest.approx(30.0, abs=3.0 * drop["std"])
    assert drop["value"] > 3.0 * drop["std"]


def test_two_laws_that_do_as_well_as_each_other_are_not_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each lacks what the other has, and both beat the believed one: neither part is established."""
    squares = {"stribeck_static": 100.0, "dahl_viscous": 100.5, "coulomb_viscous": 900.0}

    def fit_of(name: str) -> Fit:
        return cast(Fit, FakeFit(with_law(name), FakeSquares(squares[name]), free=(0, 1, 2)))

    def candidates(_: object, __: object, terms: Sequence[Term], ___: object) -> list[LawCandidate]:
        return [LawCandidate(fit_of(term.id), 0.0, 10.0, plausible=True) for term in terms if term.id in squares]

    monkeypatch.setattr(laws, "law_candidates", candidates)
    monkeypatch.setattr(laws, "threshold", lambda *_: 10.0)
    monkeypatch.setattr(laws, "_with_effects_alike", lambda *_: [])
    fit, found = lacks(cast(TorqueBalance, None), fit_of("stribeck_static"), with_law("coulomb_viscous"))
    assert fit.axis.friction.term.id == "stribeck_static"
    ((drop, without, gain),) = [(lack.effect, lack.without, lack.gain) for lack in found]
    assert (drop.term.id, without.axis.friction.term.id, gain) == ("stribeck", "dahl_viscous", 0.5)


def test_a_drag_is_no_drop_over_all_speeds() -> None:
    """A wide drop bends as a drag does; the law without it does as well beside a drag, which has fewer numbers."""
    drag = 40.0
    balance, retuned = settled(conditioned(np.random.default_rng(4), lambda m: drag * m.v * np.abs(m.v), seconds=160.0))
    values = {"coulomb": 57.0, "static": 60.0, "stribeck_velocity": 0.1, "viscous": 500.0, "exponent": 1.0}
    wide = replace(retuned.axis, friction=instance(law("stribeck_static"), values))
    fit, found = lacks(balance, settle(balance, wide, retuned.noise), retuned.axis)
    assert found == ()
    assert fit.axis.friction.term.id == "coulomb_viscous"
    (item,) = fit.axis.effects
    assert item.term.id == "quadratic_drag"
    assert item.values["coefficient"] == pytest.approx(drag, rel=0.1)


def test_laws_start_from_what_they_share() -> None:
    recording = tracked("dahl_viscous")
    view = survey(TorqueBalance(prepare([recording])), with_law("dahl_viscous"))
    for term in other_laws(with_law("dahl_viscous")):
        starts = starting_axes(with_law("dahl_viscous"), term, view)
        assert starts
        for start in starts:
            assert start.friction.values["coulomb"] == 60.0
            assert start.friction.values.get("stiffness", 3e5) == 3e5


def test_an_effect_stands_for_what_is_missing() -> None:
    missing = missing_features(law("lugre"), law("dahl_viscous"))
    assert missing == {effect("stribeck"): frozenset({Feature.STRIBECK})}
    drop = completing(effect("stribeck"), with_law("lugre").friction)
    assert drop.values == {"drop": 30.0, "stribeck_velocity": 6e-4}
    bristle = completing(effect("presliding"), with_law("lugre").friction)
    assert bristle.values == {"stiffness": 3e5, "damping": 2e4}


def test_a_law_without_memory_is_compared_in_motion_only() -> None:
    recording = tracked("coulomb_viscous")
    moving = TorqueBalance(prepare([recording], at_rest=False))
    fit = settle(moving, with_law("coulomb_viscous"), white_noise(moving.samples))
    everything = TorqueBalance(prepare([recording]))
    left = [np.std(b.residual(fit.axis, fit.noise)[b.train]) for b in (moving, everything)]
    assert left[0] < 0.1 * left[1]


@pytest.mark.parametrize(("bristle", "share", "taken"), [(1e-7, 0.018, True), (1e-7, 0.1, False), (1e-4, 0.018, False)])
def test_bristles_that_the_recording_cannot_show_do_not_speak_for_a_memory(
    bristle: float, share: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They gain what steps of time make of a reversal, a small share of the noise; more than that is another curve."""
    moving = TorqueBalance(prepare([tracked("stribeck_static")], at_rest=False))
    gain = share * moving.samples.effective_count
    narrow = with_law("free_curve")
    narrow = replace(narrow, friction=narrow.friction.replace(stiffness=narrow.friction.values["coulomb"] / bristle))
    simpler = cast(Fit, FakeFit(with_law("stribeck_static"), FakeSquares(1e4 + gain), (1, 2)))
    monkeypatch.setattr(laws, "law_candidates", lambda *_: [LawCandidate(simpler, -gain, 14.0, True)])
    fit = cast(Fit, FakeFit(narrow, FakeSquares(1e4), (1, 2, 3)))
    assert (laws.law_without_memory(moving, fit, narrow) is simpler) is taken
