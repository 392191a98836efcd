"""The paper's experiments: each measures what it says, and the report holds every table and figure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.cli import main
from tcs_friction.config import load_axis, shipped
from tcs_friction.control.reference import ConstantSpeed, Reference, load_reference
from tcs_friction.errors import InputError
from tcs_friction.report import published
from tcs_friction.report.paper import identification, measurement, observers, plant, tasks, tracking
from tcs_friction.report.paper.stand import Observed, Stand
from tcs_friction.report.runs import DEGREE


@pytest.fixture(scope="module")
def stand() -> Stand:
    return Stand(load_axis(shipped("azimuth_1p2m.yaml")), load_reference(shipped("azimuth_1p2m_run.yaml")))


def test_shipped_file_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match=r"nothing\.yaml"):
        shipped("nothing.yaml")


def test_multisine_has_unit_rms_and_only_its_lines() -> None:
    period = 1e-3
    one = plant.multisine(period)[: round(plant.PERIOD / period)]
    assert np.sqrt(np.mean(one**2)) == pytest.approx(1.0)
    power = np.abs(np.fft.rfft(one))
    power[plant.LINES] = 0.0
    assert power.max() < 1e-8 * len(one)


def test_fit_recovers_the_form_from_its_own_curve() -> None:
    frequency = np.geomspace(0.1, 100.0, 50)
    response = plant.form(np.array(published.PLANT), frequency)
    found = plant.fit(frequency, response, 0.01 * np.abs(response))
    assert found == pytest.approx(published.PLANT, rel=1e-9)


def test_plant_response_finds_eq_10_and_the_axis_inertia(stand: Stand) -> None:
    result = plant.measure(stand)
    assert result.paper.coefficients == pytest.approx(published.PLANT, rel=0.005)
    assert result.axis.coefficients[1] == pytest.approx(stand.axis.inertia, rel=0.02)
    found = result.models[1].parameters
    assert {name: found[name] for name in plant.MODE} == pytest.approx(plant.MODE, rel=0.02)
    assert result.models[0].misfit > 5.0 * result.models[1].misfit, "eq. 10's form has no resonance"
    assert result.axis.coefficients[2] == pytest.approx(stand.axis.friction.values["viscous"], rel=0.1)


def test_calibration_corrects_inertia_and_scale_and_meets_the_bars(stand: Stand) -> None:
    result = measurement.calibrate(stand)
    assert result.accuracy_before < 0.975
    assert result.accuracy > 0.98
    assert result.accuracy_uniform > 0.995
    assert result.observer.plant.first == pytest.approx(stand.axis.inertia, rel=0.05)
    assert result.observer.torque_scale == pytest.approx(1.0 / measurement.TORQUE_SCALE, rel=0.002)


def test_observed_friction_has_its_filter_s_delay_taken_out(stand: Stand) -> None:
    run = stand.run(stand.tracking)
    delay = stand.control.observer.filter_delay
    assert Observed.of(run, delay).relative_error() < 0.01
    assert Observed.of(run, 0.0).relative_error() > 0.015


def test_observers_err_by_what_a_wrong_plant_makes_of_the_motion(stand: Stand) -> None:
    """For any linear observer: error of the inertia times acceleration, error of the constant times torque."""
    short = Reference(replace(stand.tracking.config, duration=18.0))
    result = observers.measure(replace(stand, tracking=short))
    for observer in observers.NAMES:
        for parameter in observers.PARAMETERS:
            trials = result.at(observer, parameter)
            assert [item.error for item in trials] == [0.0, 0.05, 0.10, 0.20]
            assert all(item.brisk == pytest.approx(item.expected, rel=0.06) for item in trials)
            assert trials[0].brisk < 0.006
            assert trials[3].brisk > 3.0 * trials[1].brisk
            assert all(item.tracking < 0.25 * result.without for item in trials)
        assert result.at(observer, observers.INERTIA)[3].slow < 0.005, "slow crossings hardly accelerate"
        assert result.at(observer, observers.TORQUE)[3].slow == pytest.approx(0.20, rel=0.02)


def test_observers_are_compared_at_the_same_delay(stand: Stand) -> None:
    ours = stand.control.observer
    other = observers.of_equal_delay(ours)
    assert other.estimator == "kalman"
    assert other.filter_delay == pytest.approx(ours.filter_delay, rel=1e-6)
    axis = stand.axis.inertia
    assert other.plant.first == axis
    assert other.bandwidth == pytest.approx(ours.bandwidth / np.sqrt(2.0), rel=1e-3), "second order against third"


def test_table_2_in_si_is_the_axis(stand: Stand) -> None:
    for name in ("stiffness", "viscous", "stribeck_velocity", "coulomb", "static"):
        ours = identification.in_paper_units(name, stand.axis.friction.values[name])
        assert ours == pytest.approx(published.TABLE_2[name][0], rel=0.005)


def test_search_box_holds_the_true_axis(stand: Stand) -> None:
    box = identification.paper_box()
    true = np.array([stand.axis.friction.values[name] for name in box.names])
    assert ((box.lower <= true) & (true <= box.upper)).all()


def test_compensation_meets_the_bars_and_comes_near_the_ideal(stand: Stand) -> None:
    result = tracking.measure(stand, stand.control.compensator)
    assert result.peak_cut(tracking.BOTH) >= tracking.PEAK_BAR
    assert result.rms_cut(tracking.BOTH) >= tracking.RMS_BAR
    assert result.peak_cut(tracking.OFF) >= tracking.PEAK_BAR_OFF
    assert result.rms_cut(tracking.OFF) >= tracking.RMS_BAR_OFF
    assert result.errors[tracking.BOTH].rms < 1.5 * result.errors[tracking.IDEAL].rms
    assert result.errors[tracking.OBSERVER].rms > result.errors[tracking.BOTH].rms


def test_parameters_that_are_off_are_off_by_five_percent(stand: Stand) -> None:
    true = np.array(stand.control.compensator.positive.packed())
    off = np.array(tracking._worst(stand, stand.control.compensator).positive.packed())
    assert np.abs(off / true - 1.0) == pytest.approx(np.full(6, 0.05))


def test_friction_hurts_in_all_four_tasks_and_compensation_helps(stand: Stand) -> None:
    found = tasks.measure(stand, stand.control.compensator)
    assert [task.influence for task in found] == [
        "steady-state error",
        "tracking discontinuity",
        "creeping",
        "tracking error",
    ]
    for task in found:
        assert task.number_before > 3.0 * task.number_ideal
        assert task.number_after < 0.2 * task.number_before


def test_creeping_is_measured_as_ripple(stand: Stand) -> None:
    run = stand.run(Reference(ConstantSpeed(1.0 * DEGREE, duration=20.0)))
    assert tasks.speed_ripple(run) < 1.0
    steps = replace(run, true_position=np.round(run.true_position / 1e-2) * 1e-2)
    assert tasks.speed_ripple(steps) > 100.0


def test_command_writes_every_table_and_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(published, "SPEEDS", (1.0,) * 10)
    monkeypatch.setattr(identification, "SEEDS", 1)
    monkeypatch.setattr(observers, "ERRORS", (0.0,))
    assert main(["paper", "-o", str(tmp_path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "paper.json").read_text(encoding="utf-8"))
    by_name = {row["name"]: row for row in printed["comparisons"]}
    assert by_name["tracking RMS cut by"]["value"] > by_name["tracking RMS cut by"]["paper"]
    document = (tmp_path / "report.html").read_text(encoding="utf-8")
    for number in (9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21):
        assert f"Fig. {number}." in document
        assert (tmp_path / f"figure_{number:02}.png").is_file()
    for number in (1, 2, 3):
        assert f"Table {number}" in document


def test_bad_seed_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "--seed", "-1"]) == 2
    assert "--seed" in capsys.readouterr().err


def test_directory_that_cannot_be_made_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["paper", "-o", str(tmp_path / "file" / "out")]) == 2
    assert "cannot be written" in capsys.readouterr().err
