"""Intervals only at a minimum of the cost, searches beside each other, and what is said in words."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identify_cases import LUGRE, SPEED, axis_of, recording, series

from tcs_friction.conditioning.motion import prepare
from tcs_friction.config import AxisFile, load_axis, save_axis
from tcs_friction.identify import identification, pso_ga, searches
from tcs_friction.identify.conclusions import refit
from tcs_friction.identify.cost import ShapeCost
from tcs_friction.identify.identification import QUICK, IdentifyOptions, identified_axis, identify
from tcs_friction.identify.minimum import NO_MINIMUM, standard_errors_away
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.problem import pose
from tcs_friction.identify.refine import Refined
from tcs_friction.identify.result import RISING, Estimate
from tcs_friction.identify.searches import compare_searches, residual_rms
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.identify.words import rising
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

SHORT = SwarmOptions(population=20, generations=2, swarm_generations=8, genetic_generations=4)


@pytest.mark.parametrize("away", [0.3, 1.0, 4.0])
def test_the_distance_from_a_minimum_is_in_standard_errors(away: float) -> None:
    """A line through white noise: its slope and its level are moved together by so many standard errors."""
    random = np.random.default_rng(2)
    design = np.column_stack([np.ones(5000), np.linspace(-1.0, 1.0, 5000)])
    least = random.standard_normal(5000) * 0.3
    least -= design @ np.linalg.lstsq(design, least, rcond=None)[0]
    step = away * 0.3 * np.array([0.6, 0.8]) / np.linalg.norm(design, axis=0)  # the columns are orthogonal
    assert standard_errors_away(least + design @ step, least, np.ones(5000)) == pytest.approx(away, rel=0.05)


def test_correlated_residuals_are_worth_fewer_samples() -> None:
    """Each sample told ten times says as much as told once."""
    least = np.random.default_rng(0).standard_normal(2000)
    once = standard_errors_away(least + 0.05, least, np.ones(2000))
    many = standard_errors_away(np.repeat(least, 10) + 0.05, np.repeat(least, 10), np.ones(20000))
    assert many == pytest.approx(once, rel=0.3)


def test_ends_that_need_no_comparison() -> None:
    ones = np.ones(100)
    assert standard_errors_away(ones, 2.0 * ones, ones) == 0.0, "nothing is lower"
    assert standard_errors_away(ones, 0.0 * ones, ones) == math.inf, "without noise every other place is far"
    assert standard_errors_away(0.0 * ones, 0.0 * ones, ones) == 0.0


def test_a_search_that_ends_elsewhere_has_no_interval() -> None:
    found = identify([series(axis_of(), seconds=12.0)], axis_of(), method="pso-ga", options=IdentifyOptions(swarm=SHORT))
    assert (found.outcome, found.minimum) == (Outcome.BUDGET_SPENT, False)
    (words,) = [line for line in found.notes if line.startswith(NO_MINIMUM)]
    assert "its evaluations were spent" in words
    assert "--refine" in words
    everything = [*found.every.values(), *(item for way in found.directions.values() for item in way.values())]
    assert len(found.directions) == 2
    assert all(math.isnan(item.std) for item in everything)
    assert found.parameters["coulomb"].determined
    assert not found.bound
    assert not found.correlation[0]
    assert found.by_speed is not None
    assert found.by_speed.models["identified"].std is None
    content = json.loads(json.dumps(found.to_mapping(), allow_nan=False))
    assert content["minimum"] is False
    assert content["parameters"]["coulomb"]["value"] > 0.0
    assert content["parameters"]["coulomb"]["std"] is None
    assert content["correlation"] == {"names": [], "matrix": []}


def test_a_search_that_ends_at_a_minimum_has_the_interval_of_the_refined_one() -> None:
    """Within a standard error of it, which the interval includes."""
    data = [series(axis_of(), seconds=12.0)]
    found = identify(data, axis_of(), method="pso-ga", seed=1)
    best = identify(data, axis_of(), method="pso-ga", seed=1, options=IdentifyOptions(refine=True))
    assert (found.outcome, found.minimum) == (Outcome.CONVERGED, True)
    assert not [line for line in found.notes if line.startswith(NO_MINIMUM)]
    for name, item in best.parameters.items():
        mine = found.parameters[name]
        assert abs(mine.value - item.value) < item.std, name
        assert item.std * 0.99 <= mine.std <= 1.5 * item.std, name
        assert mine.std >= abs(mine.value - item.value), name


def test_a_switch_finishes_a_search_as_the_default_method_does() -> None:
    data = [recording(axis_of(), seconds=24.0)]
    options = IdentifyOptions(swarm=replace(SHORT, generations=8), refine=True)
    found, default = identify(data, axis_of(), method="pso", options=options), identify(data, axis_of())
    assert (found.method, found.outcome, found.minimum) == ("pso", Outcome.CONVERGED, True)
    for name, item in default.every.items():
        assert found.every[name].value == pytest.approx(item.value, abs=0.1 * item.std), name
        assert found.every[name].std == pytest.approx(item.std, rel=0.1), name


def test_a_search_that_was_cancelled_has_no_interval() -> None:
    for method in ("pso-ga", "default"):
        found = identify([series(axis_of(), seconds=12.0)], axis_of(), method=method, cancel=lambda: True)
        assert (found.outcome, found.minimum) == (Outcome.CANCELLED, False)
        assert f"{NO_MINIMUM} of the cost, since it was cancelled: no value has an interval" in found.notes


def test_effects_that_a_search_leaves_out_are_named() -> None:
    uneven = replace(axis_of(), effects=(instance(effect("coulomb_asymmetry"), {"asymmetry": 0.02}),))
    data, options = [recording(uneven, seconds=12.0)], IdentifyOptions(swarm=SHORT)
    words = "the search itself knows nothing of coulomb_asymmetry; --refine does"
    assert words in identify(data, uneven, method="ga", options=options).notes
    assert words not in identify(data, uneven, method="ga", options=replace(options, refine=True)).notes
    assert words not in identify(data, axis_of(), method="ga", options=options).notes


def test_pso_has_as_many_evaluations_as_pso_ga_and_the_same_beginning() -> None:
    data = [series(axis_of(), seconds=12.0)]
    options = IdentifyOptions(swarm=replace(SHORT, stagnation=4), refine=True)
    found = compare_searches(data, axis_of(), seed=3, options=options).found
    hybrid, swarm = found["pso-ga"], found["pso"]
    alone = identify(data, axis_of(), "pso-ga", seed=3, options=replace(options, refine=False))
    assert hybrid.parameters == alone.parameters or not alone.minimum
    assert [item.value for item in hybrid.every.values()] == [item.value for item in alone.every.values()]
    assert hybrid.evaluated[0] == swarm.evaluated[0]
    assert 0 <= hybrid.evaluated[-1] - swarm.evaluated[-1] < SHORT.population
    assert len(hybrid.history) == len(hybrid.evaluated)
    assert (np.diff(swarm.evaluated) == SHORT.population).all()
    rows = searches.Searches(found).to_mapping()
    assert [row["method"] for row in rows] == ["pso-ga", "pso"]
    for row, item in zip(rows, found.values(), strict=True):
        assert row["history"]["cost"][-1] == row["cost"] == item.history[-1]
        assert row["history"]["evaluations"][-1] == row["evaluations"]
        assert row["residual"] == residual_rms(item)
    json.dumps(rows, allow_nan=False)


def test_pso_may_stagnate_until_its_evaluations_are_spent() -> None:
    """PSO-GA is allowed to stagnate for so long that it does not; PSO gets no end of that kind."""
    options = IdentifyOptions(swarm=replace(SHORT, generations=8, stagnation=1000, stagnation_gain=0.5))
    found = compare_searches([series(axis_of(), seconds=12.0)], axis_of(), options=options).found
    assert found["pso"].evaluated[-1] > 0.9 * found["pso-ga"].evaluated[-1]


def test_the_papers_settings_are_compared_when_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searches, "PAPER", SHORT)
    monkeypatch.setattr("tcs_friction.identify.operators.PAPER", SHORT)
    found = compare_searches([series(axis_of(), seconds=12.0)], axis_of(), method="paper").found
    assert [item.method for item in found.values()] == ["paper", "pso"]
    assert found["pso"].evaluated[0] == 2 * SHORT.population


def test_friction_that_rises_with_speed_is_said_in_words(tmp_path: Path) -> None:
    """And the axis file with it is one that can be read."""
    values = {"coulomb": 78.0, "static": 50.0, "stribeck_velocity": 8e-4, "viscous": 3000.0, "exponent": 2.0}
    truth = axis_of(values, "stribeck_static")
    found = identify([recording(truth, seconds=13.0, rate=250.0)], truth)
    assert found.parameters["static"].value == pytest.approx(50.0, rel=0.05)
    (words,) = [line for line in found.notes if line.startswith(RISING)]
    assert "N m is below coulomb 7" in words
    save_axis(tmp_path / "axis.yaml", AxisFile(identified_axis(truth, found)))
    assert load_axis(tmp_path / "axis.yaml").axis.friction.values["static"] == found.parameters["static"].value


@pytest.mark.parametrize(
    ("law", "static", "determined"), [("lugre", 90.0, True), ("lugre", 78.0, True), ("lugre", 50.0, False), ("bam", 50.0, True)]
)
def test_other_laws_are_not_said_to_rise(law: str, static: float, determined: bool) -> None:
    """With stiction, without a determined one, and where the load decides as well."""
    values = LUGRE if law == "lugre" else {
        "coulomb": 78.0, "static": 50.0, "stribeck_velocity": 1e-3, "viscous": 1.0, "exponent": 2.0, "load": 0.1,
        "load_stribeck": 0.5,
    }  # fmt: skip
    parameters = {"coulomb": Estimate(78.0, 1.0, "N m"), "static": Estimate(static, 1.0, "N m", determined)}
    assert rising(axis_of(values, law), parameters) == ()
    assert rising(axis_of(), {"coulomb": parameters["coulomb"]}) == ()


def test_a_drop_at_another_speed_is_found_where_a_search_missed_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that ended on a broad drop, as one of a coarse encoder did: Coulomb 7.7 for 6.3 N m, static 6.5 for 8.4."""
    problem = pose(axis_of(), prepare([recording(axis_of())]))
    cost, space = ShapeCost(problem, True, True, believed_start(problem)), space_of(problem, True, True, False)
    found = pso_ga.search(cost, 3, 1, QUICK)
    broad = replace(found, position=cost.box.position(np.array([4e-4, 1.5, SPEED])))
    missed = cost.unknowns(broad.position)
    assert (identification._other_drop(cost, found, problem, space, "squares")[1] == cost.unknowns(found.position)).all()

    def stays(*given: Any) -> Refined:
        """A fit that does not leave its valley, and the truth is where friction drops at 6e-4 rad/s."""
        apart = abs(math.log(given[1][2] / LUGRE["stribeck_velocity"]))
        return replace(refit(*given[:4], 0), unknowns=given[1], cost=1.0 + apart)

    monkeypatch.setattr(identification, "refit", stays)
    search, again = identification._other_drop(cost, broad, problem, space, "squares")
    assert abs(math.log(again[2] / LUGRE["stribeck_velocity"])) < 0.5 * abs(math.log(missed[2] / LUGRE["stribeck_velocity"]))
    assert again[1] > again[0]
    assert search.evaluations > found.evaluations
