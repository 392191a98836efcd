"""The page of an identification: numbers, reasons and the comparison of laws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.identify.comparison import Comparison, Row
from tcs_friction.identify.conclusions import IDENTIFIED
from tcs_friction.identify.refine import Outcome
from tcs_friction.identify.result import RISING, Errors, Estimate, Fit, Identification
from tcs_friction.identify.searches import Searches
from tcs_friction.numerics.by_speed import speed_bins, torque_by_speed
from tcs_friction.report.identification import parameter_table, sentence, write_report
from tcs_friction.report.plot import Spacing
from tcs_friction.report.searches import draw_searches

T = np.linspace(0.0, 20.0, 2000)
VELOCITY = 0.1 * np.sin(T)
FRICTION = 20.0 * np.tanh(VELOCITY / 1e-3) + 200.0 * VELOCITY


@pytest.fixture
def found() -> Identification:
    noise = np.random.default_rng(0).standard_normal(len(T))
    fit = Fit(T, VELOCITY, FRICTION + noise, FRICTION, FRICTION + noise, FRICTION, np.array([0, 1000, 2000]))
    coulomb, viscous = Estimate(20.39, 0.45, "N"), Estimate(203.5, 6.5, "N s/m")
    lost = Estimate(0.0, float("nan"), "N/m", False, "the recording never reverses")
    return Identification(
        law="dahl_viscous",
        method="default",
        parameters={"coulomb": coulomb, "viscous": viscous, "stiffness": lost},
        inertia=Estimate(95.1, 0.23, "kg"),
        offset=Estimate(-3.17, 0.21, "N"),
        directions={
            "positive": {"coulomb": Estimate(21.0, 0.1, "N"), "stiffness": lost},
            "negative": {"coulomb": Estimate(19.0, 0.1, "N"), "stiffness": lost},
        },
        rmse=Errors(1.0, 1.1),
        noise_floor=0.9,
        cost=1000.0,
        evaluations=666,
        seconds=1.5,
        outcome=Outcome.CONVERGED,
        history=np.geomspace(1e5, 1e3, 20),
        fit=fit,
        correlation=(("coulomb", "viscous"), np.array([[1.0, -0.9], [-0.9, 1.0]])),
        bound={"coulomb": 0.4},
        notes=("a note",),
        by_speed=torque_by_speed(
            speed_bins(VELOCITY, 1e-5), VELOCITY, FRICTION + noise, {IDENTIFIED: FRICTION}, {}, IDENTIFIED
        ),
    )


def test_sentence_names_what_is_known_and_what_is_not(found: Identification) -> None:
    words = sentence(found)
    assert "coulomb 20.39 N" in words
    assert "inertia 95.1 kg" in words
    assert words.endswith("The recording cannot determine stiffness.")


def test_sentence_when_nothing_is_determined(found: Identification) -> None:
    lost = Estimate(0.0, float("nan"), "N", False, "no motion")
    nothing = replace(found, parameters={"coulomb": lost}, inertia=lost, offset=lost)
    assert "determines none of its parameters" in sentence(nothing)


def test_page_gives_errors_reasons_and_directions(found: Identification, tmp_path: Path) -> None:
    document = write_report(tmp_path, found).read_text(encoding="utf-8")
    for words in (
        "20.39 ± 0.45",
        "the recording never reverses",
        "21.00 ± 0.10",
        "a note",
        "666 evaluations",
    ):
        assert words in document
    assert "Friction laws compared" not in document
    assert {entry.stem for entry in tmp_path.glob("*.png")} == {"torque", "friction_speed", "cost", "correlation"}


def test_laws_are_compared_best_first(found: Identification, tmp_path: Path) -> None:
    rows = (Row("dahl_viscous", 1.1, 1.0, 3, 10.0, 1.5), Row("coulomb_viscous", 1.9, 1.8, 2, 90.0, 0.5))
    comparison = Comparison(rows, {"dahl_viscous": found, "coulomb_viscous": found})
    document = write_report(tmp_path, found, (), comparison).read_text(encoding="utf-8")
    assert document.index(">dahl_viscous<") < document.index(">coulomb_viscous<")
    assert (tmp_path / "laws.png").is_file()


def test_friction_against_speed_comes_first_in_the_units_of_the_axis(found: Identification, tmp_path: Path) -> None:
    document = write_report(tmp_path / "a", found).read_text(encoding="utf-8")
    assert document.index("Friction against speed") < document.index("held out")
    assert '"label":"speed (m/s)"' in document
    rotary = replace(found, inertia=replace(found.inertia, unit="kg m^2"))
    assert '"label":"speed (deg/s)"' in write_report(tmp_path / "b", rotary).read_text(encoding="utf-8")


def test_without_motion_there_is_no_friction_against_speed(found: Identification, tmp_path: Path) -> None:
    document = write_report(tmp_path, replace(found, by_speed=None)).read_text(encoding="utf-8")
    assert "Friction against speed" not in document


def test_searches_are_drawn_over_their_evaluations(found: Identification, tmp_path: Path) -> None:
    evaluated = 60 * np.arange(1, 21)
    hybrid = replace(found, method="pso-ga", evaluated=evaluated)
    swarm = replace(found, method="pso", evaluated=evaluated, history=2.0 * found.history)
    searches = Searches({"pso-ga": hybrid, "pso": swarm})
    plot = draw_searches(searches).plot
    assert plot is not None
    (panel,) = plot.panels
    assert (panel.x.label, panel.y.label, panel.y.spacing) == ("evaluations of the cost", "best cost ((N)²)", Spacing.LOG)
    names = {curve.name.partition(":")[0]: curve for curve in panel.curves}
    assert names["PSO-GA"].x.tolist() == evaluated.tolist()
    assert names["PSO"].y.tolist() == (2.0 * found.history).tolist()
    assert all(curve.name.endswith("N rms") for curve in panel.curves)
    document = write_report(tmp_path, found, (), None, searches).read_text(encoding="utf-8")
    assert "PSO-GA beside PSO" in document
    assert ">1,200<" in document
    assert (tmp_path / "searches.png").is_file()


def test_a_page_says_that_there_is_no_interval_and_no_stiction(found: Identification) -> None:
    lost = {name: replace(item, std=float("nan")) for name, item in found.parameters.items()}
    shown = replace(found, parameters=lost, minimum=False, notes=(f"{RISING}: static 3 N is below coulomb 17 N",))
    words = sentence(shown)
    assert "Friction rises with speed; no stiction." in words
    assert words.endswith("No value has an interval: the search did not end at a minimum.")
    assert ">20.39<" in parameter_table(shown)
    assert "nan" not in parameter_table(shown)
    assert "Friction rises" not in sentence(found)
    assert "interval" not in sentence(found)
