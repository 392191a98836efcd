"""The diagnose command: its files appear whole or not at all, and what it says; the diagnosis itself is stood in for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcs_friction import cli
from tcs_friction.commands import diagnose as command
from tcs_friction.config import AxisFile, load_axis, save_axis
from tcs_friction.control.reference import load_reference
from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.plot_data import Evidence
from tcs_friction.diagnose.outcome.result import Diagnosis, Errors, Found, Seen, Told, Unexplained
from tcs_friction.diagnose.outcome.visible import Visible
from tcs_friction.diagnose.rules import TOO_SMALL, Refusal, Refused
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.write import write_recording
from tcs_friction.report import diagnosis_files
from tcs_friction.report.diagnosis_files import write_diagnosis
from tcs_friction.writable import staged

SIGNALS = SignalMap.from_mapping(
    {
        "position": {"topic": "/joint_states", "field": "position", "joint": "test"},
        "torque": {"topic": "/joint_states", "field": "effort", "joint": "test"},
    },
    "test",
)
AXIS = Axis("test", 2.0, instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.5}))
BIAS = instance(effect("torque_bias"), {"bias": 0.4})
DRAG = instance(effect("quadratic_drag"), {"coefficient": 3.0})
EXPERIMENT = {
    "reference": {"kind": "sinusoid", "amplitude": 0.1, "period": 10.0},
    "separates": ["torque_bias", "imbalance"],
    "why": "slow sinusoid: they differ",
    "difference": 0.2,
}


def diagnosis(file: AxisFile, experiment: dict[str, Any] | None = EXPERIMENT) -> Diagnosis:
    t = np.linspace(0.0, 10.0, 200)
    noise = 0.1 * np.sin(7.0 * t)
    found = Found(
        BIAS,
        (Kind("imbalance"),),
        0.5,
        {"bias": {"value": 0.4, "std": 0.01, "unit": "N m"}},
        {"coordinate": "torque", "range": None, "period": None, "frequency": None},
        0.4,
        0.4,
        0.1,
        -50.0,
        Agreement(1.0, 0.01, 12, 1.0, 0.1),
    )
    return Diagnosis(
        "missing_physics",
        "The model lacks torque_bias.",
        "It lacks torque_bias, 0.4 N m.",
        (found,),
        (),
        Unexplained(),
        0.1,
        Errors(0.5, 0.6),
        Errors(0.4, 0.4),
        Errors(0.1, 0.1),
        1.0,
        {"believed": 3e-3, "retuned": 2e-3, "improved": 1e-3},
        {"believed": 3e-6, "retuned": 2e-6, "improved": 1.25e-6},
        (),
        experiment,
        (),
        (),
        (Refused("backlash", Refusal(TOO_SMALL, "it would gain 50", {"gain": 50.0})),),
        file.with_axis(file.axis.with_effect(BIAS)),
        file.with_axis(file.axis.with_effect(BIAS).with_effect(DRAG)),
        Errors(0.1, 0.1),
        Seen((-1.0, 1.0), 1.0, 2.0, None, ("rad", "rad/s", "N m")),
        Visible(12.0, 0.9, {"cogging": 0.05, "warmup_drift": 0.4}, 0.01),
        (Told("inertia", "kg m^2", 1.0, (1.1, 0.01), None),),
        Evidence(t, noise + 0.5, noise + 0.4, noise, t > 8.0),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_axis(tmp_path / "axis.yaml", AxisFile(AXIS, SIGNALS))
    t = 0.01 * np.arange(1000)
    write_recording(tmp_path / "bag", Recording(t=t, position=np.sin(t), torque=np.cos(t)), SIGNALS)
    return tmp_path


@pytest.fixture
def stood_in(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    calls: list[Any] = []

    def diagnose(recordings: Any, file: AxisFile, progress: Any = None, tolerance: float = 0.0) -> Diagnosis:
        calls.append((recordings, file, tolerance))
        progress(0.5, "half way")
        return diagnosis(file)

    monkeypatch.setattr(command, "diagnose", diagnose)
    return calls


def arguments(folder: Path, *more: str) -> list[str]:
    return ["diagnose", str(folder / "bag"), "--axis", str(folder / "axis.yaml"), "-o", str(folder / "out"), *more]


def test_writes_everything_and_says_what_was_found(
    folder: Path, stood_in: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments(folder, "--seed", "3")) == 0
    assert len(stood_in) == 1
    out = folder / "out"
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["schema"] == "tcs_friction/diagnosis/1"
    assert load_axis(out / "axis.yaml").axis.effects[0].values["bias"] == 0.4
    assert load_axis(out / "axis.yaml").signals == SIGNALS
    assert load_reference(out / "next_experiment.yaml").duration == 60.0
    assert "torque_bias" in (out / "report.html").read_text()
    assert not list(out.glob(".*"))
    printed = capsys.readouterr()
    assert "missing_physics: The model lacks torque_bias." in printed.out
    assert "bias 0.4 N m" in printed.out
    assert "rad rms   closed loop" in printed.out
    assert any(line.startswith("improved") and line.endswith("1.25e-06") for line in printed.out.splitlines())
    assert printed.out.rstrip().endswith("report.html")
    assert {line.split(": ")[2] for line in printed.err.splitlines()} == {"time base"}, printed.err


def test_json_prints_the_result_alone(folder: Path, stood_in: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments(folder, "--json")) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "out" / "diagnosis.json").read_text())
    assert len(stood_in) == 1


def test_an_experiment_of_an_earlier_run_goes(folder: Path) -> None:
    out = folder / "out"
    write_diagnosis(out, diagnosis(AxisFile(AXIS)))
    write_diagnosis(out, diagnosis(AxisFile(AXIS), None))
    assert not (out / "next_experiment.yaml").exists()


def test_a_failing_report_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise RuntimeError("no ink")

    monkeypatch.setattr(diagnosis_files, "write_report", fail)
    with pytest.raises(RuntimeError, match="no ink"):
        write_diagnosis(folder / "out", diagnosis(AxisFile(AXIS)))
    assert list((folder / "out").iterdir()) == []


def test_a_file_in_the_way_is_named(folder: Path) -> None:
    (folder / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), staged(folder / "file" / "out"):
        pass


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["-o", "x"], "neither an axis file nor a simulation"),
        (["--axis", "no.yaml", "-o", "x"], "no such file"),
        (["--axis", "AXIS", "-o", "x", "--seed", "-1"], "--seed"),
    ],
)
def test_wrong_usage_is_one_line(
    folder: Path, more: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(folder / "axis.yaml") if word == "AXIS" else word for word in more]
    assert cli.main(["diagnose", str(folder / "bag"), *words]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_an_axis_file_without_signals_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_axis(folder / "axis.yaml", replace(AxisFile(AXIS), signals=None))
    assert cli.main(arguments(folder)) == 2
    assert "no signals block" in capsys.readouterr().err


@pytest.mark.parametrize("asked", [False, True])
def test_the_axis_file_holds_what_is_described_only_if_asked_for(folder: Path, stood_in: list[Any], asked: bool) -> None:
    assert cli.main(arguments(folder, *(["--with-described"] if asked else []))) == 0
    assert stood_in
    written = folder / "out" / "axis.yaml"
    effects = [item.term.id for item in load_axis(written).axis.effects]
    assert effects == ["torque_bias", *(["quadratic_drag"] if asked else [])]
    assert "# Told from position -1 to 1 rad, speed up to 1 rad/s, torque up to 2 N m" in written.read_text()


def test_what_was_asked_is_said(folder: Path, stood_in: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments(folder, "--tolerance", "1%")) == 0
    assert stood_in
    printed = capsys.readouterr().out
    seen = "seen would be cogging from about 0.05 N m rms on, warmup_drift from 0.4."
    assert f"Asked were 90 % of the data, up to 12 Hz; {seen}" in printed
    asked = json.loads((folder / "out" / "diagnosis.json").read_text())["asked"]
    assert asked == {"band": 12.0, "share": 0.9, "sizes": {"cogging": 0.05, "warmup_drift": 0.4}, "tolerance": 0.01}


@pytest.mark.parametrize("word", ["-1%", "100%", "1.5", "much"])
def test_a_tolerance_is_a_share(folder: Path, word: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments(folder, f"--tolerance={word}"))
    assert "is no share from 0 to 1, such as 1% or 0.01" in capsys.readouterr().err
