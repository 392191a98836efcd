"""./tcs compensate: what cancelling is worth, each effect by itself, with the uncertainty of the diagnosis."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tcs_friction.cli import main
from tcs_friction.config import AxisFile, load_axis, save_axis, shipped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.tables import export_table
from tcs_friction.report.diagnosis_files import told_by

COGGING = {"order": 200.0, "amplitude": 20.0, "phase": 0.3}
ASYMMETRY = {"asymmetry": 0.2}


def item(name: str, values: Mapping[str, float]) -> Instance:
    return instance(effect(name), values)


@pytest.fixture
def reference(tmp_path: Path) -> Path:
    """One reversal of the telescope."""
    block = {"kind": "sinusoid", "amplitude": 1e-3, "period": 6.0, "duration": 5.0}
    (tmp_path / "reference.yaml").write_text(yaml.safe_dump({"reference": block}))
    return tmp_path / "reference.yaml"


def axis(path: Path, *effects: Instance, kind: str = "rotary") -> Path:
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    save_axis(path, AxisFile(replace(file.axis, effects=effects, kind=kind), None, file.control))
    return path


def diagnosis(
    path: Path, named: Mapping[str, Mapping[str, float]], described: Mapping[str, Mapping[str, float]], unsure: float = 0.5
) -> Path:
    def entries(effects: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
        return [
            {"effect": name, "parameters": {key: {"value": value, "std": unsure * abs(value)} for key, value in values.items()}}
            for name, values in effects.items()
        ]

    content = {"schema": "tcs_friction/diagnosis/1", "effects": entries(named), "described": entries(described)}
    path.write_text(json.dumps(content))
    return path


def predicted(words: list[str], out: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["compensate", *words, "-o", str(out)]) == 0, capsys.readouterr().err
    assert (out / "report.html").is_file()
    content = json.loads((out / "compensation.json").read_text())
    content["rms"] = {stage["name"]: stage["rms"] for stage in content["stages"]}
    return dict(content)


def test_each_effect_is_worth_something_and_all_are_worth_all(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    backlash = item("backlash", {"gap": 1e-6, "inertia_ratio": 0.01})
    path = axis(tmp_path / "axis.yaml", item("cogging", COGGING), item("coulomb_asymmetry", ASYMMETRY), backlash)
    found = predicted([str(path), "--reference", str(reference)], tmp_path / "out", capsys)
    rms = found["rms"]
    assert list(rms) == ["nothing", "friction law", "cogging", "coulomb_asymmetry", "everything"]
    assert rms["nothing"] > 3.0 * rms["friction law"]
    assert rms["friction law"] > max(rms["cogging"], rms["coulomb_asymmetry"])
    assert min(rms["cogging"], rms["coulomb_asymmetry"]) > 1.03 * rms["everything"]
    assert found["unit"] == "arcsec"
    assert list(found["not_cancelled"]) == ["backlash"]
    assert all(stage["rms_between"][0] < stage["rms_between"][1] for stage in found["stages"]), "the drive has noise"
    shown = capsys.readouterr()
    assert "the intervals are those of noise alone" in shown.err
    first, second = shown.out.splitlines()[:2]
    assert first.startswith("Compensating the friction law cuts the tracking error from")
    assert len(first.split()) <= 20
    assert second.startswith("With effects cancelled too")
    assert "law and coulomb asymmetry" in shown.out
    ratio, between = found["beyond_law"]["ratio"], found["beyond_law"]["between"]
    assert between[0] <= ratio <= between[1] < 1.0


def test_a_diagnosis_says_what_is_cancelled_and_how_sure_it_is(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = (item("cogging", COGGING), item("coulomb_asymmetry", ASYMMETRY), item("imbalance", {"amplitude": 5.0}))
    path = axis(tmp_path / "axis.yaml", *effects)
    known = diagnosis(tmp_path / "diagnosis.json", {"coulomb_asymmetry": ASYMMETRY}, {"cogging": COGGING})
    words = [str(path), "--reference", str(reference), "--diagnosis", str(known)]
    found = predicted(words, tmp_path / "out", capsys)
    assert found["not_cancelled"] == {
        "cogging": "the diagnosis describes it only",
        "imbalance": "the diagnosis does not know it",
    }
    again = predicted(words, tmp_path / "again", capsys)
    assert again == found, "draws have a seed"
    stages = {stage["name"]: stage for stage in found["stages"]}
    assert set(stages) == {"nothing", "friction law", "everything"}, "one effect is everything"
    diagnosis(known, {"coulomb_asymmetry": ASYMMETRY}, {"cogging": COGGING}, 1e-6)
    noise = predicted(words, tmp_path / "noise", capsys)["stages"][-1]["rms_between"]
    assert np.diff(stages["everything"]["rms_between"]) > 1.5 * np.diff(noise), "what the diagnosis is not sure of widens it"


def test_an_effect_is_known_by_the_values_that_the_diagnosis_wrote(tmp_path: Path) -> None:
    """Named effects are fitted anew without those that are only described: the axis file has other values than the proof."""
    path = axis(tmp_path / "axis.yaml", item("coulomb_asymmetry", ASYMMETRY))
    other = {name: 1.01 * value for name, value in ASYMMETRY.items()}
    known = diagnosis(tmp_path / "diagnosis.json", {"coulomb_asymmetry": other}, {})
    believed = load_axis(path).axis
    assert told_by(known, believed)[0] == {"coulomb_asymmetry": "the diagnosis does not know it"}
    content = json.loads(known.read_text())
    content["effects"][0]["written"] = ASYMMETRY
    known.write_text(json.dumps(content))
    left_out, deviations = told_by(known, believed)
    assert not left_out
    assert set(deviations) == {"coulomb_asymmetry"}


MODE = {"frequency": 9.0, "damping": 0.01, "inertia_ratio": 0.3}


def test_a_shaped_reference_is_advised_where_a_flexible_mode_is_excited(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = axis(tmp_path / "axis.yaml", item("flexible_mode", MODE))
    step = tmp_path / "step.yaml"
    step.write_text("reference: {kind: steps, height: 1.0e-4, dwell: 1.0, duration: 3.0}\n")
    words = [str(path), "--settle", "1.5", "--reference"]
    (told,) = predicted([*words, str(step)], tmp_path / "out", capsys)["shaping"]
    assert told["shaper"]["frequency"] == pytest.approx(9.0 * 0.7**0.5)
    assert told["shaper"]["damping"] == pytest.approx(0.01 * 0.7**0.5)
    assert told["delay"] == pytest.approx(0.5 / told["shaper"]["frequency"], rel=0.02)
    assert told["swing_shaped"]["rms"] < 0.5 * told["swing"]["rms"], "the step itself takes place within what counts"
    line = capsys.readouterr().out
    assert "with `shaper: {kind: zvd, frequency: 7.53, damping: 0.00837}` in the reference file" in line
    step.write_text(step.read_text() + "shaper: {kind: zvd, frequency: 7.53, damping: 0.00837}\n")
    assert predicted([*words, str(step)], tmp_path / "shaped", capsys)["shaping"] == []
    reference.write_text("reference: {kind: sinusoid, amplitude: 2.0e-3, period: 12.0, duration: 9.0}\n")
    (told,) = predicted([*words, str(reference)], tmp_path / "smooth", capsys)["shaping"]
    assert told["swing_shaped"]["peak"] > 0.9 * told["swing"]["peak"]
    assert "a shaped reference would hardly change that" in capsys.readouterr().out


def test_a_linear_axis_is_told_in_micrometres(tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = axis(tmp_path / "axis.yaml", item("cogging", COGGING), kind="linear")
    found = predicted([str(path), "--reference", str(reference), "--json"], tmp_path / "out", capsys)
    assert found["unit"] == "um"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--draws", "18"], "--draws: 18, expected a whole number from 19"),
        (["--seed", "-1"], "--seed: -1, expected a whole number from 0"),
        (["--settle", "20"], "settle: 20 s, expected less than the run's 5 s"),
        (["--diagnosis", "nowhere.json"], "nowhere.json: no such file"),
        (["--diagnosis", "/dev/zero"], "/dev/zero: is no regular file"),
        (["--diagnosis", "broken.json"], "broken.json: is no JSON"),
        (["--diagnosis", "other.json"], "other.json: has no schema, expected the diagnosis.json of ./tcs diagnose"),
        (["--diagnosis", "nothing.json"], "nothing.json: names no effect of azimuth"),
        (["--diagnosis", "noparam.json"], "noparam.json: effects[0]: parameters is missing"),
        (["--diagnosis", "str.json"], "amplitude: std: 'x', expected a number above 0"),
        (["--diagnosis", "negative.json"], "negative.json: effects[0]: parameters: amplitude: std: -1.0"),
        (["--diagnosis", "zero.json"], "amplitude: std: 0.0, expected a number above 0"),
        (["--diagnosis", "infinite.json"], "infinite.json: is no JSON (Infinity is no number of JSON)"),
        (["--diagnosis", "nan.json"], "nan.json: is no JSON (NaN is no number of JSON)"),
        (["--diagnosis", "huge.json"], "amplitude: std: inf, expected a number above 0"),
        (["--diagnosis", "true.json"], "amplitude: std: True, expected a number above 0"),
        (["--identification", "nothing.json"], "nothing.json: has the schema 'tcs_friction/diagnosis/1', expected"),
        (["--recorded-with", "law"], "--recorded-with: given without a recording, expected --recording BAG beside it"),
        (["--recording", "nowhere"], "axis.yaml: no signals block"),
        (["--recording", "nowhere.csv"], "nowhere.csv: no such file"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str],
    expected: str,
    tmp_path: Path,
    reference: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.json").write_text("{")
    Path("other.json").write_text("[1]")
    entry: dict[str, Any] = {"effect": "cogging"}
    damaged = {"noparam": entry}
    stds = {"str": "x", "negative": -1.0, "zero": 0.0, "infinite": math.inf, "nan": math.nan, "huge": "1e999", "true": True}
    for name, std in stds.items():
        damaged[name] = {**entry, "parameters": {"amplitude": {"value": 20.0, "std": std}}}
    for name, effect_entry in damaged.items():
        content = {"schema": "tcs_friction/diagnosis/1", "effects": [effect_entry], "described": []}
        Path(f"{name}.json").write_text(json.dumps(content).replace('"1e999"', "1e999"))
    diagnosis(Path("nothing.json"), {}, {"cogging": COGGING})
    path = axis(tmp_path / "axis.yaml", item("cogging", COGGING))
    assert main(["compensate", str(path), "--reference", str(reference), "-o", str(tmp_path / "out"), *words]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out" / "compensation.json").exists()


def test_a_controller_that_cannot_follow_is_refused(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = axis(tmp_path / "axis.yaml", item("transport_delay", {"delay": 0.05}))
    assert main(["compensate", str(path), "--reference", str(reference), "-o", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert "misses the reference" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out" / "compensation.json").exists()


def identification(path: Path, **stds: float) -> Path:
    """What `identify` would have written of the telescope."""
    law = load_axis(shipped("azimuth_1p2m.yaml")).axis
    values = {**law.friction.values, "inertia": law.inertia, "offset": 0.0}
    entries = {
        name: {"value": value, "std": stds.get(name, 0.0), "unit": "", "determined": True, "reason": None}
        for name, value in values.items()
    }
    rest = {name: entries.pop(name) for name in ("inertia", "offset")}
    matrix = {"names": list(stds), "matrix": np.eye(len(stds)).tolist()}
    content = {"schema": "tcs_friction/identification/1", "law": "lugre", "parameters": entries, **rest, "correlation": matrix}
    path.write_text(json.dumps(content))
    return path


def test_the_friction_law_alone_is_worth_something_as_sure_as_it_was_identified(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = axis(tmp_path / "axis.yaml")
    words = [str(path), "--reference", str(reference)]
    before = predicted(words, tmp_path / "noise", capsys)
    assert list(before["rms"]) == ["nothing", "friction law"]
    assert "Beside it no effect of the axis file can be cancelled." in capsys.readouterr().out
    identification(tmp_path / "identification.json", coulomb=3.0, static=3.0)
    unsure = predicted(words, tmp_path / "out", capsys)
    assert "identification.json lies beside the axis file and says how sure its numbers are" in capsys.readouterr().err
    assert unsure["rms"]["friction law"] > 1.1 * before["rms"]["friction law"]
    gains = [one["stages"][1]["gain_between"] for one in (before, unsure)]
    assert np.diff(gains[1]) > 2.0 * np.diff(gains[0])
    other = identification(tmp_path / "other.json", coulomb=3.0, static=3.0)
    (tmp_path / "identification.json").unlink()
    assert predicted([*words, "--identification", str(other)], tmp_path / "named", capsys)["rms"] == unsure["rms"]


def test_an_axis_without_noise_has_no_interval_and_says_so(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = load_axis(axis(tmp_path / "axis.yaml"))
    bare = replace(file.axis, drive=replace(file.axis.drive, noise=0.0), sensors=replace(file.axis.sensors, noise=0.0))
    save_axis(tmp_path / "axis.yaml", file.with_axis(bare))
    found = predicted([str(tmp_path / "axis.yaml"), "--reference", str(reference)], tmp_path / "out", capsys)
    assert all(stage["rms_between"] is None for stage in found["stages"])
    assert found["draws"] == 0
    assert "the prediction is the best case, and has no interval" in capsys.readouterr().err


@pytest.fixture
def recorded(tmp_path: Path, reference: Path) -> Path:
    """The telescope recorded on that run."""
    words = [str(telescope(tmp_path / "recorder.yaml")), "--reference", str(reference), "-o", str(tmp_path / "bag")]
    assert main(["simulate", *words]) == 0
    return tmp_path / "bag"


def telescope(path: Path, **controller: float) -> Path:
    """The telescope without effects, with other gains."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    assert file.control is not None
    file = file.with_axis(replace(file.axis, effects=()))
    control = replace(file.control, controller=replace(file.control.controller, **controller))
    save_axis(path, replace(file, control=control))
    return path


def test_a_recording_is_the_run_and_agrees_with_the_axis_that_made_it(
    tmp_path: Path, recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    found = predicted([str(path), "--recording", str(recorded)], tmp_path / "out", capsys)
    shown = found["recording"]
    assert shown["stage"] == "nothing"
    assert shown["agrees"]
    assert shown["simulated_rms"] == pytest.approx(shown["rms"], rel=0.02)
    assert found["controller"]["from"] == "axis file"
    out = capsys.readouterr().out
    assert "The recording agrees" in out
    assert "Controller: the axis file's, which explains over 99.999 % of the recorded torque" in out


def test_the_controller_is_the_one_that_the_recording_shows(
    tmp_path: Path, recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml", velocity_proportional=4e5, velocity_integral=1.2e7)
    found = predicted([str(path), "--recording", str(recorded)], tmp_path / "out", capsys)
    right = predicted([str(telescope(path)), "--recording", str(recorded)], tmp_path / "right", capsys)
    assert found["controller"]["from"] == "recording"
    assert found["controller"]["gains"]["proportional"]["value"] == pytest.approx(1.47e5 * 32.7 + 3.6e6, rel=1e-3)
    assert found["recording"]["agrees"]
    assert found["rms"]["friction law"] == pytest.approx(right["rms"]["friction law"], rel=0.05)


def test_a_model_that_is_not_the_recorded_one_is_told(
    tmp_path: Path, recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    file = load_axis(path)
    save_axis(path, file.with_axis(file.axis.with_friction({"coulomb": 50.0})))
    found = predicted([str(path), "--recording", str(recorded)], tmp_path / "out", capsys)
    assert not found["recording"]["agrees"]
    told = "the axis file's controller or model is not the one that recorded it."
    assert told in capsys.readouterr().out
    assert told in found["statement"]
    assert "is not the one that recorded it" in (tmp_path / "out" / "report.html").read_text()


def test_a_run_that_was_compensated_is_compared_with_that_stage(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    file = load_axis(path)
    assert file.control is not None
    loop = replace(file.control.loop, compensation="model")
    save_axis(tmp_path / "recorder.yaml", replace(file, control=replace(file.control, loop=loop)))
    words = [str(tmp_path / "recorder.yaml"), "--reference", str(reference), "-o", str(tmp_path / "bag")]
    assert main(["simulate", *words]) == 0
    words = [str(path), "--recording", str(tmp_path / "bag")]
    assert not predicted(words, tmp_path / "wrong", capsys)["recording"]["agrees"]
    words += ["--recorded-with", "everything"]
    found = predicted(words, tmp_path / "out", capsys)
    assert found["recording"]["agrees"]
    assert found["controller"]["from"] == "axis file"
    longer = tmp_path / "longer.yaml"
    longer.write_text("reference: {kind: sinusoid, amplitude: 1.0e-3, period: 8.0, duration: 4.0}\n")
    other = predicted([*words, "--reference", str(longer)], tmp_path / "other", capsys)
    assert other["recording"]["agrees"], "compared on the recording's own run"
    assert other["recording"]["rms"] == found["recording"]["rms"]
    assert other["rms"] != found["rms"], "predicted on the other one"


def test_a_recorded_reference_may_be_a_bag_or_a_table(
    tmp_path: Path, recorded: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    words = [str(path), "--reference"]
    exact = predicted([*words, str(reference)], tmp_path / "exact", capsys)["rms"]
    bag = predicted([*words, str(recorded)], tmp_path / "bagged", capsys)["rms"]
    assert bag["friction law"] == pytest.approx(exact["friction law"], rel=0.02)
    (source,) = read_recordings([recorded], load_axis(path).mapped(path))
    export_table(source, tmp_path / "run.csv")
    bare = axis(tmp_path / "bare.yaml", *load_axis(path).axis.effects)
    table = predicted([str(bare), "--reference", str(tmp_path / "run.csv")], tmp_path / "table", capsys)["rms"]
    assert table["friction law"] == pytest.approx(exact["friction law"], rel=0.02), "a table needs no signals block"


def test_a_run_whose_torque_is_a_current_shows_no_controller_in_newton_metres(
    tmp_path: Path, recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    (source,) = read_recordings([recorded], load_axis(path).mapped(path))
    export_table(replace(source, torque_unit="A"), tmp_path / "run.csv")
    words = ["compensate", str(path), "-o", str(tmp_path / "out")]
    assert main([*words, "--recording", str(tmp_path / "run.csv")]) == 2
    assert "run.csv: holds the torque in A, expected N m, as the axis file" in capsys.readouterr().err
    assert main([*words, "--reference", str(tmp_path / "run.csv")]) == 0, "a reference has no torque"


def test_a_recording_without_reference_says_what_is_missing(
    tmp_path: Path, recorded: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = telescope(tmp_path / "axis.yaml")
    file = load_axis(path)
    (source,) = read_recordings([recorded], file.mapped(path))
    export_table(replace(source, reference=None), tmp_path / "run.csv")
    assert file.signals is not None
    save_axis(path, replace(file, signals=replace(file.signals, reference=None)))
    for given, expected in (
        (["--recording", str(recorded)], "axis.yaml: signals: no reference, expected where"),
        (["--reference", str(tmp_path / "run.csv")], "run.csv: no reference, expected a column of that name"),
        ([], "compensate: no run to be compensated, expected --reference REF.yaml or --recording BAG"),
    ):
        assert main(["compensate", str(path), *given, "-o", str(tmp_path / "out")]) == 2
        assert expected in capsys.readouterr().err
    words = [str(path), "--recording", str(recorded), "--reference", str(reference)]
    assert predicted(words, tmp_path / "out", capsys)["recording"] is None
    assert "no reference, so that its controller and tracking error are not known" in capsys.readouterr().err


def test_results_replace_no_input(tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = axis(tmp_path / "compensation.json", item("cogging", COGGING))
    assert main(["compensate", str(path), "--reference", str(reference), "-o", str(tmp_path)]) == 2
    assert "would be written over the input" in capsys.readouterr().err
    axis(path, item("cogging", COGGING))
    assert load_axis(path).axis.effects
