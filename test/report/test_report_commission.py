"""The page of the main job: its numbers are those of the runs, and its table is the paper's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.control.compensator import LugreParameters
from tcs_friction.control.guard import Gain
from tcs_friction.control.tracking import ARCSEC, Improvement
from tcs_friction.report import published
from tcs_friction.report.commission import CommissionResult, Judged, console_table, cut, table_3, write_report
from tcs_friction.report.runs import FrictionRun, TrackingRun, simulated_friction, spectrum

NAMES = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous")
T = np.arange(0.0, 60.0, 0.01)
SPEED = 1e-3 * np.cos(2.0 * np.pi * (T - 2.0) / 20.0)


def tracking(peak: float, floor: float) -> TrackingRun:
    """Errors (arcsec) of `floor` with a bump of `peak` at each reversal, signed like the new direction."""
    error = np.full(len(T), floor)
    crossings = np.flatnonzero(np.sign(SPEED[1:]) != np.sign(SPEED[:-1]))
    for k in crossings:
        error += np.sign(SPEED[k + 1]) * peak * np.exp(-(((T - T[k]) / 0.2) ** 2))
    return TrackingRun(T, SPEED, SPEED, error * ARCSEC)


@pytest.fixture
def result() -> CommissionResult:
    truth = 80.0 * np.sign(SPEED)
    return CommissionResult(
        axis="azimuth",
        before=tracking(0.9, 0.0),
        after=tracking(0.09, 0.0),
        measurement=FrictionRun(T, SPEED, 1.02 * truth, truth),
        identified={"coulomb": 78.0, "static": 117.0},
        costs=np.geomspace(1e5, 1.0, 30),
        friction_off=tracking(0.05, 0.0),
        true={"coulomb": 78.1, "static": 117.2},
        seconds=60.0,
        notes=("one <note>",),
    )


def test_mapping_has_the_contract_s_keys_and_the_runs_numbers(result: CommissionResult) -> None:
    content = json.loads(json.dumps(result.to_mapping()))
    known = {"before", "after", "friction_off", "dob_relative_error", "identified", "true"}
    assert set(content) == known | {"found", "ideal", "effects", "statements"}
    assert content["before"]["peak_positive"] == pytest.approx(0.9, rel=1e-3)
    assert content["after"]["peak_negative"] == pytest.approx(-0.09, rel=1e-3)
    assert content["dob_relative_error"] == pytest.approx(0.02)


def test_a_run_without_reversals_one_way_has_no_peaks_there(result: CommissionResult) -> None:
    run = result.after
    reversal = int(np.flatnonzero((SPEED[1:] > 0.0) & (SPEED[:-1] <= 0.0))[0])
    short = TrackingRun(*(x[: reversal - 100] for x in (run.t, run.reference_velocity, run.velocity, run.error)))
    content = json.loads(json.dumps(replace(result, after=short).to_mapping(), allow_nan=False))
    assert content["after"]["peak_positive"] is None
    assert content["after"]["peak_negative"] == pytest.approx(-0.09, rel=1e-2)


def test_real_axis_has_no_truth(result: CommissionResult, tmp_path: Path) -> None:
    measurement = FrictionRun(T, SPEED, SPEED)
    real = replace(result, friction_off=None, true=None, measurement=measurement)
    content = real.to_mapping()
    assert (content["friction_off"], content["true"], content["dob_relative_error"]) == (None, None, None)
    assert write_report(tmp_path, real).is_file()


def test_table_3_is_the_paper_s_beside_ours(result: CommissionResult) -> None:
    rows = table_3(published.BEFORE, published.AFTER)
    assert [row[3] for row in rows] == ["74.8 %", "55.1 %", "36.2 %"]
    assert [row[1:4] for row in rows] == [row[4:7] for row in rows]
    ours = table_3(result.before.errors(5.0), result.after.errors(5.0))
    assert ours[0][3] == "90.0 %"


def test_console_table_is_aligned(result: CommissionResult) -> None:
    lines = console_table(result).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines}) == 1


def diagnosed(result: CommissionResult) -> CommissionResult:
    """The same with one effect cancelled, one put back and one that was not tried."""
    gain = Gain(0.1 * ARCSEC, 0.04 * ARCSEC, Improvement(0.4, 0.35, 0.45))
    none = Gain(0.04 * ARCSEC, 0.041 * ARCSEC, Improvement(1.02, 0.98, 1.06))
    judged = (
        Judged("cogging", "cogging of order 72", True, "", gain),
        Judged("torque_ripple", "torque ripple of order 6", False, "tracking is not measurably better with it", none),
        Judged("backlash", "backlash", False, "no torque <moves> it", None),
    )
    return replace(result, found=tracking(0.03, 0.0), ideal=tracking(0.02, 0.0), judged=judged, statements=("The model lacks.",))


def test_what_was_found_and_what_it_is_worth_is_told_everywhere(result: CommissionResult, tmp_path: Path) -> None:
    found = diagnosed(result)
    content = json.loads(json.dumps(found.to_mapping(), allow_nan=False))
    assert content["found"]["peak_positive"] == pytest.approx(0.03, rel=1e-3)
    first, second, third = content["effects"]
    assert first["gain"].pop("between") == [0.35, 0.45]
    assert (first["gain"].pop("of"), first["gain"].pop("unit")) == ("tracking", "arcsec")
    assert first["gain"] == pytest.approx({"rms_without": 0.1, "rms_with": 0.04, "ratio": 0.4})
    assert (second["cancelled"], second["why_not"]) == (False, "tracking is not measurably better with it")
    assert third["gain"] is None
    said = console_table(found)
    assert "with what was found" in said
    assert "cogging of order 72       0.1000″ to 0.0400″ rms (times 0.350 to 0.450), cancelled" in said
    document = write_report(tmp_path, found).read_text(encoding="utf-8")
    assert "With cogging of order 72 cancelled, too, it tracks to" in document
    assert "no torque &lt;moves&gt; it" in document
    assert (tmp_path / "effects.png").is_file()
    assert found.stages[0].name == "not compensated"


def test_cut_ignores_the_sign() -> None:
    assert cut(-0.8, 0.2) == pytest.approx(0.75)


def test_report_says_the_message_and_keeps_the_pictures(result: CommissionResult, tmp_path: Path) -> None:
    path = write_report(tmp_path, result)
    document = path.read_text(encoding="utf-8")
    assert "crosses zero speed within 0.090″ instead of 0.90″" in document
    assert "one &lt;note&gt;" in document
    names = {entry.stem for entry in tmp_path.glob("*.png")}
    assert names == {"speed", "tracking_error", "tracking_spectrum", "friction", "cost"}


def test_spectrum_of_a_tone_holds_its_power() -> None:
    t = np.arange(0.0, 160.0, 0.01)
    tone = TrackingRun(t, t, t, 0.3 * ARCSEC * np.sin(2.0 * np.pi * 5.0 * t))
    frequency, density = spectrum(tone)
    assert frequency[np.argmax(density)] == pytest.approx(5.0, abs=0.1)
    power = np.sum(density**2) * (frequency[1] - frequency[0])
    assert power == pytest.approx(0.3**2 / 2.0, rel=0.02)


def test_run_s_arrays_are_its_own() -> None:
    t = T.copy()
    run = TrackingRun(t, t, t, t)
    t[0] = 99.0
    assert run.t[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        run.error[0] = 1.0


def test_simulated_friction_is_the_law_s_own_at_steady_speed() -> None:
    t = np.arange(0.0, 5.0, 1e-3)
    law = LugreParameters()
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
    friction = simulated_friction(t, 1e-2 + noise, law)
    assert friction[-1] == pytest.approx(law.coulomb + law.viscous * 1e-2, rel=0.01)


def test_complete_law_is_drawn_beside_the_measurement(result: CommissionResult, tmp_path: Path) -> None:
    without = write_report(tmp_path / "a", result).with_name("friction.png").read_bytes()
    complete = replace(result, identified=dict(zip(NAMES, LugreParameters().packed(), strict=True)))
    assert write_report(tmp_path / "b", complete).with_name("friction.png").read_bytes() != without
