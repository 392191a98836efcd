"""The page of a diagnosis: every verdict gives a page, and the page says what the result says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcs_friction.diagnose.outcome.plot_data import CoordinateCurve, Evidence, Isolated, Map, RunnerUp
from tcs_friction.numerics.by_speed import speed_bins, torque_by_speed
from tcs_friction.report import diagnosis_plots
from tcs_friction.report.diagnosis import write_report
from tcs_friction.report.diagnosis_plots import draw_message, draw_series
from tcs_friction.report.numbers import unbroken

RANDOM = np.random.default_rng(0)
T = np.linspace(0.0, 60.0, 3000)
POSITION = 0.3 * np.sin(T / 5.0)
COGGING = 1.7 * np.cos(72.0 * POSITION)
NOISE = 0.3 * RANDOM.standard_normal(len(T))


def curve(coordinate: str, x: np.ndarray, share: float, p_value: float) -> CoordinateCurve:
    return CoordinateCurve(coordinate, "rad", x, np.cos(x), np.full(len(x), 0.1), share, p_value)


@pytest.fixture
def evidence() -> Evidence:
    bins = np.linspace(-0.3, 0.3, 40)
    return Evidence(
        t=T,
        believed=COGGING + NOISE + 0.4,
        retuned=COGGING + NOISE,
        improved=NOISE,
        held_out=(T > 20.0) & (T < 30.0),
        atlas=(
            curve("position", bins, 0.92, 1e-4),
            curve("exogenous:wind_speed", bins, 0.01, 0.4),
            curve("direction", np.array([-1.0, 1.0]), 0.01, 0.5),
        ),
        isolated=(Isolated("cogging", "cogging, order 64 1/turn", "position", "rad", POSITION, COGGING + NOISE, COGGING),),
        runners_up=(RunnerUp("torque_ripple", 0.11, "needs a torque that <changes>"),),
        notes=("a gap of 3 s",),
    )


@pytest.fixture
def diagnosis() -> dict[str, Any]:
    return {
        "verdict": "missing_physics",
        "headline": "The model lacks cogging.",
        "statement": "The motor cogs 72 times a turn.",
        "effects": [
            {
                "effect": "cogging",
                "equivalent": ["torque_ripple"],
                "probability": 0.99,
                "parameters": {
                    "order": {"value": 72.0013, "std": 0.012, "unit": "1/turn"},
                    "phase": {"value": 0.3, "std": None, "unit": None},
                },
                "subsystem": "actuator",
                "torque_rms": 1.2,
            }
        ],
        "described": [],
        "refused": [{"effect": "backlash", "rule": "too_small", "question": "Is it large enough?", "words": "it would gain 50"}],
        "parameters": [
            {
                "name": "inertia",
                "unit": "kg m^2",
                "believed": 1000.0,
                "retuned": {"value": 996.21, "std": 0.012},
                "improved": None,
            }
        ],
        "fit": {
            "noise_floor": 0.3,
            "believed": {"train": 1.4, "held_out": 1.42, "untouched": 1.43, "fit_percent": 90.4},
            "retuned": {"train": 1.2, "held_out": 1.23, "untouched": 1.24, "fit_percent": 91.0},
            "improved": {"train": 0.3, "held_out": 0.33, "untouched": 0.31, "fit_percent": None},
        },
        "free_run": {"horizon": 1.0, "position_rms": {"believed": 1e-4, "retuned": 8e-5, "improved": 1e-6}},
        "atlas": [
            {
                "coordinate": "velocity",
                "unit": "rad/s",
                "statistic": 9.0,
                "p_value": 1e-4,
                "range": [1e-17, 0.3],
                "period": None,
                "share": 0.02,
            },
            {
                "coordinate": "frequency",
                "unit": "Hz",
                "statistic": 9.0,
                "p_value": 1e-4,
                "range": [7.1, 7.2],
                "period": 1.0 / 7.15,
                "share": 0.96,
            },
            {
                "coordinate": "position",
                "unit": "rad",
                "statistic": 9.0,
                "p_value": 1e-4,
                "range": None,
                "period": 0.0873,
                "share": 0.92,
            },
            {
                "coordinate": "time_since_reversal",
                "unit": "s",
                "statistic": 1.0,
                "p_value": 0.4,
                "range": None,
                "period": None,
                "share": 0.01,
            },
        ],
    }


def test_page_says_what_was_found(diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path) -> None:
    document = write_report(tmp_path, diagnosis, evidence, "azimuth", "Record q.yaml.").read_text(
        encoding="utf-8"
    )
    for words in (
        "The motor cogs 72 times a turn.",
        "The model lacks cogging.",
        "it would gain 50",
        unbroken("996.210 ± 0.012"),
        "91.0 %",
        "physics is missing",
        unbroken("order 72.001 ± 0.012 1/turn"),
        "torque_ripple",
        "needs a torque that &lt;changes&gt;",
        "0.000 to 0.300 rad/s",
        "every 0.0873 rad",
        "7.15 Hz",
        "1.03 times the noise floor",
        "Record q.yaml.",
        "a gap of 3 s",
    ):
        assert words in document
    assert document.index("every 0.0873 rad") < document.index("7.15 Hz")  # more telling, with a smaller share
    assert {entry.stem for entry in tmp_path.glob("*.png")} == {"message", "where", "before_after", "effect_1_cogging"}


def test_the_first_picture_shows_what_is_named(
    diagnosis: dict[str, Any], evidence: Evidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither what was believed all along nor what is described, however large."""
    drawn: list[str] = []
    monkeypatch.setattr(diagnosis_plots, "_draw_effect", lambda _axes, item, _unit: drawn.append(item.title))
    (cogging,) = evidence.isolated
    cable = replace(cogging, title="cable, believed all along", fitted=9.0 * cogging.fitted, named=False)
    draw_message(diagnosis, replace(evidence, isolated=(cable, cogging)))
    assert drawn == ["cogging, order 64 1/turn"]
    draw_message(diagnosis, replace(evidence, isolated=(cable,)))
    assert len(drawn) == 1


@pytest.mark.parametrize(("times", "same"), [(1.0, True), (20.0, False)])
def test_a_belief_far_off_does_not_hide_the_others(
    times: float, same: bool, diagnosis: dict[str, Any], evidence: Evidence
) -> None:
    plot = draw_series(replace(evidence, believed=times * evidence.believed), diagnosis["fit"]).plot
    assert plot is not None
    first, second, third = (panel.y.limits for panel in plot.panels)
    assert second == third
    assert (first == second) is same
    assert ("at a scale of its own" in plot.panels[0].title) is not same


@pytest.mark.parametrize("axes", [1, 2])
def test_what_remains_is_drawn(
    axes: int, diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path
) -> None:
    values = np.outer(np.sin(np.arange(9.0)), [1.0, -1.0]) if axes == 2 else np.sin(np.arange(9.0))
    names, units = ("position", "exogenous:oil_pressure")[:axes], ("rad", "")[:axes]
    learned = Map(names, units, (0.0, -1.0)[:axes], (2.0, 1.0)[:axes], values, np.arange(8**axes).reshape([8] * axes) % 8 > 1)
    document = write_report(tmp_path, diagnosis, replace(evidence, learned=learned)).read_text(encoding="utf-8")
    assert "What nothing in the vocabulary explains" in document
    assert (tmp_path / "learned_map.png").stat().st_size > 1000


def test_the_closed_loop_is_in_the_table_where_there_is_one(
    diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path
) -> None:
    without = write_report(tmp_path / "a", diagnosis, evidence).read_text(encoding="utf-8")
    diagnosis["closed_loop"] = {"position_rms": {"believed": 4.321e-7, "retuned": 3e-7, "improved": 2.5e-8}}
    document = write_report(tmp_path / "b", diagnosis, evidence).read_text(encoding="utf-8")
    assert "closed-loop error, rms over 1 s" in document
    assert "4.321e-07" in document
    assert "closed-loop" not in without


@pytest.mark.parametrize("verdict", ["match", "parameters", "unexplained"])
def test_every_verdict_gives_a_page(
    verdict: str, diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path
) -> None:
    bare = replace(
        evidence, atlas=(), isolated=(), runners_up=(), notes=(), held_out=np.zeros(len(T), dtype=bool)
    )
    nothing = {**diagnosis, "verdict": verdict, "effects": [], "atlas": [], "free_run": {}}
    document = write_report(tmp_path, nothing, bare).read_text(encoding="utf-8")
    assert "What was left out" not in document
    assert "What else was considered" not in document


def test_a_residual_well_above_the_noise_is_not_called_good(
    diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path
) -> None:
    good = write_report(tmp_path / "a", diagnosis, evidence).read_text(encoding="utf-8")
    diagnosis["fit"]["improved"]["untouched"] = 0.6
    bad = write_report(tmp_path / "b", diagnosis, evidence).read_text(encoding="utf-8")
    assert 'class="number good"' in good
    assert 'class="number good"' not in bad


def test_friction_against_speed_is_drawn_where_there_is_motion(
    diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path
) -> None:
    velocity = 0.06 * np.cos(T / 5.0)
    friction = 60.0 * np.sign(velocity) + 500.0 * velocity
    models = {"believed": 0.9 * friction, "retuned": friction, "improved": friction}
    found = torque_by_speed(speed_bins(velocity, 1e-5), velocity, friction + NOISE, models, {}, "improved")
    document = write_report(tmp_path, diagnosis, replace(evidence, friction=found)).read_text(encoding="utf-8")
    assert "Friction against speed" in document
    assert "believed, slowing down" in document
    assert (tmp_path / "friction_speed.png").stat().st_size > 1000


def test_a_page_with_many_effects_stays_small(diagnosis: dict[str, Any], evidence: Evidence, tmp_path: Path) -> None:
    t = np.linspace(0.0, 300.0, 9000)
    noise = np.random.default_rng(1).standard_normal(len(t))
    item = Isolated("cogging", "cogging", "position", "rad", np.sin(t / 5.0), np.cos(t) + noise, np.cos(t))
    curves = tuple(curve(f"coordinate_{k}", np.linspace(0.0, 300.0, 60), 0.5, 1e-4) for k in range(9))
    series = replace(evidence, t=t, believed=noise, retuned=noise[::-1], improved=-noise, held_out=t > 250.0)
    many = replace(series, isolated=(item,) * 6, atlas=curves)
    assert write_report(tmp_path, diagnosis, many).stat().st_size < 2_000_000
