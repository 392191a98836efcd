"""./tcs new: a first axis file from a recording alone, and what it says of every value."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tcs_friction.cli import main
from tcs_friction.commands import new
from tcs_friction.commands.new import text_of
from tcs_friction.conditioning.checks import check_units
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import load_axis, shipped
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.errors import InputError
from tcs_friction.identify import first_axis
from tcs_friction.identify.identification import identify
from tcs_friction.identify.result import Identification
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.write import write_recording

LONGEST = 1500  # samples
MOTION = {"kind": "multisine", "velocity_amplitude": 0.01, "lowest_frequency": 0.05, "frequency_step": 0.07, "components": 4}


@pytest.fixture(scope="module")
def run() -> LoopRun:
    """The shipped telescope without effects, over several speeds both ways."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    reference = reference_from_mapping({**MOTION, "duration": 30.0}, "motion")
    assert file.control is not None
    loop = replace(file.control.loop, compensation="none")
    return simulate_loop(replace(file.axis, effects=(), actuation_delay=0.0), reference, file.control.controller, loop)


@pytest.fixture
def one_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the law that the telescope has, where a test is not about the law: comparing all takes several times as long."""
    monkeypatch.setattr(first_axis, "LAWS", ("lugre",))


def bag(path: Path, run: LoopRun, joint: str = "azimuth", sign: float = 1.0) -> Path:
    place = "/mount/joint_states"
    signals = SignalMap(
        SignalSource(place, "position", joint), SignalSource(place, "effort", joint), SignalSource(place, "velocity", joint)
    )
    write_recording(path, Recording(run.t, run.position, sign * run.torque, velocity=run.velocity), signals)
    return path


def test_a_telescope_is_known_from_its_bag(
    run: LoopRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "axis.yaml"
    assert main(["new", str(bag(tmp_path / "bag", run)), "-o", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "rotary"
    file = load_axis(path)
    axis = file.axis
    assert (axis.name, axis.friction.term.id) == ("azimuth", told["law"])
    assert axis.inertia == pytest.approx(1000.0, rel=0.03)
    assert axis.friction.values["coulomb"] == pytest.approx(78.1, rel=0.05)
    assert axis.sensors.noise == pytest.approx(4.8e-8, rel=0.1)
    assert axis.sensors.resolution == pytest.approx(2.42e-8, rel=0.01)
    assert axis.drive.limit == pytest.approx(np.abs(run.torque).max(), rel=1e-4)
    assert file.signals is not None
    assert file.signals.torque == SignalSource("/mount/joint_states", "effort", "azimuth")
    assert file.control is not None
    assert file.control.controller.inertia_feedforward == axis.inertia
    assert file.control.compensator.positive.coulomb == axis.friction.values["coulomb"]
    assert file.control.controller.velocity_limit == pytest.approx(1.2 * np.abs(run.velocity).max(), rel=0.02)
    assert file.control.loop.period == 0.001
    assert axis.effects == ()
    assert axis.drive.noise == pytest.approx(0.25, rel=0.2)
    assert not told["doubts"]
    text = path.read_text()
    inertia = next(line for line in text.splitlines() if line.strip().startswith("inertia:"))
    assert "# ± " in inertia
    assert "held-out residual of each, roughly: lugre 0." in text
    assert [one["law"] for one in told["laws"]] == sorted(first_axis.LAWS, key=[one["law"] for one in told["laws"]].index)
    again = identify(read_recordings([tmp_path / "bag"], file.signals), axis, law="lugre")
    assert axis.friction.values == pytest.approx(again.friction(), rel=1e-3), "as identify finds it"


@pytest.mark.usefixtures("one_law")
def test_signals_and_the_joint_are_taken_as_named_and_said(
    run: LoopRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The torque that acted is the effort of another joint, and the axis' own is always 1."""
    place, path = "/mount/joint_states", tmp_path / "axis.yaml"
    sources = [SignalSource(place, "position", "azimuth"), SignalSource(place, "effort", "azimuth")]
    motor = [SignalSource(place, "position", "motor"), SignalSource(place, "effort", "motor")]
    signals = SignalMap(*sources, exogenous={"angle": motor[0], "torque of the motor": motor[1]})
    still = np.ones_like(run.t)
    others = {"angle": still, "torque of the motor": run.torque}
    write_recording(tmp_path / "bag", Recording(run.t, run.position, still, exogenous=others), signals)
    words = ["new", str(tmp_path / "bag"), "-o", str(path), "--force"]
    assert main([*words, "--signal", f"torque={place}:effort@motor"]) == 0
    assert "joint azimuth taken of 0 azimuth, 1 motor; --joint takes another" in capsys.readouterr().err
    assert load_axis(path).axis.inertia == pytest.approx(1000.0, rel=0.03)
    found = load_axis(path).signals
    assert found is not None
    assert found.torque == SignalSource(place, "effort", "motor")
    assert main([*words, "--joint", "1"]) == 2
    assert "the axis never moves" in capsys.readouterr().err


@pytest.mark.usefixtures("one_law")
def test_a_torque_of_the_other_sign_is_turned_over(run: LoopRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "axis.yaml"
    assert main(["new", str(bag(tmp_path / "bag", run, sign=-1.0)), "-o", str(path)]) == 0
    assert "doubtful: the recorded torque was turned over: it does -" in capsys.readouterr().out
    file = load_axis(path)
    assert file.axis.inertia == pytest.approx(1000.0, rel=0.03)
    assert file.signals is not None
    assert file.signals.torque.scale == -1.0
    assert "# Doubtful: the recorded torque was turned over" in path.read_text()


@pytest.mark.usefixtures("one_law")
def test_a_table_says_by_its_units_that_an_axis_is_linear(run: LoopRun, tmp_path: Path) -> None:
    table, path = tmp_path / "slide.csv", tmp_path / "slide.yaml"
    with table.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "Position [mm]", "Motor force [N]"])
        rows.writerows(zip(run.t[::2], 1e3 * run.position[::2], run.torque[::2], strict=True))
    assert main(["new", str(table), "-o", str(path), "--name", "slide", "--joint", "carriage"]) == 0
    axis = load_axis(path).axis
    assert (axis.name, axis.kind) == ("slide", "linear")
    assert axis.inertia == pytest.approx(1000.0, rel=0.03)
    assert "# by the units" in path.read_text()


@pytest.mark.parametrize(
    ("column", "factor", "inertia", "unit"),
    [("q-axis current [mA]", 10.0, 10.0, "A"), ("torque [kNm]", 1e-3, 1000.0, ""), ("actualTorque [%]", 0.5, 500.0, "%")],
)
def test_a_drives_current_is_taken_for_the_torque(
    run: LoopRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], column: str, factor: float,
    inertia: float, unit: str,
) -> None:  # fmt: skip
    """Everything with torque in it is then in A, in the file and wherever it is told, and in what is made with the file."""
    monkeypatch.setattr(first_axis, "LAWS", first_axis.LAWS[:1])
    table, path = tmp_path / "run.csv", tmp_path / "axis.yaml"
    with table.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "Position [deg]", column])
        rows.writerows(zip(run.t[::10], np.degrees(run.position[::10]), factor * run.torque[::10], strict=True))
    assert main(["new", str(table), "-o", str(path)]) == 0
    told = capsys.readouterr().out
    axis = load_axis(path).axis
    assert axis.inertia == pytest.approx(inertia, rel=0.2), "by the simplest law"
    assert axis.torque_unit == unit
    for text in (told, path.read_text()):
        assert (f"{unit} s^2/rad" in text) == bool(unit)
        assert ("kg m^2" in text) == (not unit)
        assert not unit or "N m" not in text
    assert main(["identify", str(table), "--axis", str(path), "-o", str(tmp_path / "out"), "--method", "pso"]) == 0
    found = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert found["inertia"]["unit"] == (f"{unit} s^2/rad" if unit else "kg m^2")
    assert found["offset"]["unit"] == (unit or "N m")
    assert load_axis(tmp_path / "out" / "axis.yaml").axis.torque_unit == unit
    report = (tmp_path / "out" / "report.html").read_text()
    assert ("N m" in report.replace("\u00a0", " ")) == (not unit)


@pytest.mark.usefixtures("one_law")
def test_a_joints_name_says_that_an_axis_is_linear_and_another_joint_can_be_asked_for(run: LoopRun, tmp_path: Path) -> None:
    recorded = bag(tmp_path / "bag", run, joint="focus_stage")
    assert main(["new", str(recorded), "-o", str(tmp_path / "axis.yaml")]) == 0
    assert load_axis(tmp_path / "axis.yaml").axis.kind == "linear"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["BAG", "--joint", "altitude"], "--joint: no joint 'altitude', expected one of azimuth"),
        (["BAG.csv", "--signal", "torque=/a:b"], "--signal: given for a table, expected a bag, or --column for a table"),
        (["BAG", "--signal", "torque=/drive:data"], "no topic /drive, expected one of /mount/joint_states"),
        (["BAG", "--column", "torque=u"], "--column: given for a bag, expected a table"),
        (["BAG", "BAG.csv"], "recordings: bags and tables together, expected bags, or tables"),
        (["missing"], "missing: does not exist"),
    ],
)
def test_bad_input_is_one_line(
    run: LoopRun, tmp_path: Path, words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    short = bag(tmp_path / "bag", run)
    given = [word.replace("BAG", str(short)) for word in words]
    assert main(["new", *given, "-o", str(tmp_path / "axis.yaml")]) == 2
    said = capsys.readouterr().err
    assert expected in said
    assert said.count("\n") == 1
    assert not (tmp_path / "axis.yaml").exists()


def test_an_axis_that_rests_or_is_not_driven_is_refused(
    run: LoopRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = "/joint_states"
    signals = SignalMap(SignalSource(place, "position", "a"), SignalSource(place, "effort", "a"))
    for name, position, torque, expected in (
        ("rest", np.zeros_like(run.t), run.torque, "the axis never moves"),
        ("coast", run.position, np.zeros_like(run.t), "no torque is ever applied"),
    ):
        write_recording(tmp_path / name, Recording(run.t, position, torque), signals)
        assert main(["new", str(tmp_path / name), "-o", str(tmp_path / "axis.yaml")]) == 2
        assert expected in capsys.readouterr().err


def test_a_file_that_is_there_is_not_replaced_unless_it_is_asked_for(
    run: LoopRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "axis.yaml").write_text("mine")
    assert main(["new", str(bag(tmp_path / "bag", run)), "-o", str(tmp_path / "axis.yaml")]) == 2
    assert "exists already, expected a new file, or --force" in capsys.readouterr().err
    assert (tmp_path / "axis.yaml").read_text() == "mine"


def test_what_tracks_slowly_one_way_gives_a_file_that_says_what_it_cannot_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """So few samples are left behind the low pass that none is held out; a law that cannot be fitted is left out."""

    def refusing(*given: object, **named: object) -> Identification:
        if given[3] == "coulomb_viscous":
            raise InputError("identification", "no candidate can be compared", "a longer run")
        return identify(*given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(first_axis, "LAWS", ("coulomb_viscous", "stribeck_static"))
    monkeypatch.setattr(first_axis, "identify", refusing)
    random, path = np.random.default_rng(0), tmp_path / "axis.yaml"
    t = np.arange(2000) / 100.0
    position = 7.3e-5 * t + 5e-8 * random.standard_normal(len(t))
    source = SignalSource("/joint_states", "position", "a")
    recording = Recording(t, position, 118.0 + 0.3 * random.standard_normal(len(t)))
    write_recording(tmp_path / "bag", recording, SignalMap(source, replace(source, field="effort")))
    assert main(["new", str(tmp_path / "bag"), "-o", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["laws"][0]["rmse"]["held_out"] is None
    assert told["law"] == "stribeck_static"
    assert any(line.startswith("not determined by this motion: ") for line in told["doubts"])
    assert any(line.startswith("the sign of the torque is not told: ") for line in told["doubts"])
    assert any(line.startswith("the axis goes one way only") for line in told["doubts"])
    assert "coulomb_viscous not fitted" in path.read_text()


def test_comments_stand_behind_the_values_that_they_are_about() -> None:
    content = {"a": {"x": 1.23456789, "b": {"x": 2.0}}, "x": 3.0}
    text = text_of(content, {("a", "x"): "one", ("a", "b", "x"): "two", ("x",): "three"}, ["Head."])
    found = {line.partition("#")[2].strip(): line.partition("#")[0].strip() for line in text.splitlines() if "#" in line}
    assert found == {"Head.": "", "one": "x: 1.23457", "two": "x: 2.0", "three": "x: 3.0"}
    assert yaml.safe_load(text) == {"a": {"x": 1.23457, "b": {"x": 2.0}}, "x": 3.0}


def test_irregular_stamps_leave_the_sensors_noise_as_it_is(shared_data: Path, tmp_path: Path) -> None:
    """A log with 20 % jitter and gaps, of which the encoder's noise is 1e-7 rad and the controller's period 4 ms."""
    path, recorded = tmp_path / "axis.yaml", shared_data / "inputs" / "timing" / "w11_irregular_missing_1" / "bag"
    assert main(["new", str(recorded), "-o", str(path)]) == 0
    file = load_axis(path)
    assert file.axis.sensors.noise == pytest.approx(1e-7, rel=0.1)
    assert file.axis.drive.noise_bandwidth > 1.0
    assert file.control is not None
    assert file.control.loop.period == 0.004


def test_a_passive_damper_keeps_its_sign_and_has_its_friction(shared_data: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    assert main(["new", str(shared_data / "inputs" / "intake" / "friction_damper.csv"), "-o", str(path)]) == 0
    file = load_axis(path)
    assert file.signals is not None
    assert file.signals.torque.scale == 1.0
    assert 14e3 < file.axis.friction.values["coulomb"] < 18e3


DIAGNOSED = "bam_sin_sin_kp800"
"""Wholly, in a test of its own."""
RECORDINGS = (
    "bam_lift_and_drop_kp200",
    "bam_lift_and_drop_kp800",
    "bam_sin_sin_kp200",
    "bam_sin_sin_kp800",
    "emps",
    "laas_speed",
    "odrive_slow",
)


def test_a_real_recording_gives_a_file_that_a_diagnosis_accepts(shared_data: Path, tmp_path: Path) -> None:
    path, recorded = tmp_path / "axis.yaml", shared_data / "data" / DIAGNOSED / "recording"
    assert main(["new", str(recorded), "-o", str(path)]) == 0
    assert main(["diagnose", str(recorded), "--axis", str(path), "-o", str(tmp_path / "found")]) == 0
    assert (tmp_path / "found/report.html").is_file()


@pytest.mark.parametrize("name", sorted({*RECORDINGS} - {DIAGNOSED}))
def test_every_real_recording_gives_a_file_that_a_diagnosis_can_begin_with(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Fitted to the first LONGEST samples, with two laws, for the sake of time; a diagnosis begins with the whole recording."""
    path, recorded = tmp_path / "axis.yaml", shared_data / "data" / name / "recording"
    monkeypatch.setattr(first_axis, "LAWS", first_axis.LAWS[:2])
    monkeypatch.setattr(new, "read_recordings", lambda *given: [one.part(slice(LONGEST)) for one in read_recordings(*given)])
    assert main(["new", str(recorded), "-o", str(path)]) == 0
    file = load_axis(path)
    data = prepare(read_recordings([recorded], file.mapped(path)), memory=10.0 * file.axis.bristle)
    check_units(data, file.axis)
    assert np.isfinite(TorqueBalance(data, file.axis.actuation_delay).torque_residual(file.axis)).all()


def test_no_real_recording_is_forgotten(shared_data: Path) -> None:
    assert sorted(path.name for path in (shared_data / "data").iterdir() if path.is_dir()) == sorted(RECORDINGS)
