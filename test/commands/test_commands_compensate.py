"""./tcs compensate: what cancelling is worth, each effect by itself, with the uncertainty of the diagnosis."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from tcs_friction.cli import main
from tcs_friction.config import AxisFile, load_axis, save_axis, shipped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance

COGGING = {"order": 200.0, "amplitude": 20.0, "phase": 0.3}
ASYMMETRY = {"asymmetry": 0.2}


def item(name: str, values: Mapping[str, float]) -> Instance:
    return instance(effect(name), values)


@pytest.fixture
def reference(tmp_path: Path) -> Path:
    """One reversal of the telescope."""
    block = {"kind": "sinusoid", "amplitude": 2e-3, "period": 12.0, "duration": 9.0}
    (tmp_path / "reference.yaml").write_text(yaml.safe_dump({"reference": block}))
    return tmp_path / "reference.yaml"


def axis(path: Path, *effects: Instance, kind: str = "rotary") -> Path:
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    save_axis(path, AxisFile(replace(file.axis, effects=effects, kind=kind), None, file.control))
    return path


def diagnosis(path: Path, named: Mapping[str, Mapping[str, float]], described: Mapping[str, Mapping[str, float]]) -> Path:
    def entries(effects: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
        return [
            {"effect": name, "parameters": {key: {"value": value, "std": 0.1 * abs(value)} for key, value in values.items()}}
            for name, values in effects.items()
        ]

    path.write_text(json.dumps({"effects": entries(named), "described": entries(described)}))
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
    assert list(rms) == ["nothing", "friction law", "cogging", "coulomb_asymmetry", "everything", "ideal"]
    assert rms["everything"] == pytest.approx(rms["ideal"], rel=0.1)
    assert rms["nothing"] > 3.0 * rms["friction law"]
    assert rms["friction law"] > max(rms["cogging"], rms["coulomb_asymmetry"])
    assert min(rms["cogging"], rms["coulomb_asymmetry"]) > 1.03 * rms["everything"]
    assert found["unit"] == "arcsec"
    assert list(found["not_cancelled"]) == ["backlash"]
    assert all(stage["rms_between"] is None for stage in found["stages"])
    shown = capsys.readouterr()
    assert "how sure the parameters are is not known" in shown.err
    assert "Cancelling what is known takes the tracking error from" in shown.out
    assert "law and coulomb asymmetry" in shown.out


def test_a_diagnosis_says_what_is_cancelled_and_how_sure_it_is(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = (item("cogging", COGGING), item("coulomb_asymmetry", ASYMMETRY), item("imbalance", {"amplitude": 5.0}))
    path = axis(tmp_path / "axis.yaml", *effects)
    known = diagnosis(tmp_path / "diagnosis.json", {"cogging": {"amplitude": 20.0}}, {"coulomb_asymmetry": ASYMMETRY})
    words = [str(path), "--reference", str(reference), "--diagnosis", str(known), "--draws", "6"]
    found = predicted(words, tmp_path / "out", capsys)
    assert found["not_cancelled"] == {
        "coulomb_asymmetry": "the diagnosis describes it only",
        "imbalance": "the diagnosis does not know it",
    }
    stages = {stage["name"]: stage for stage in found["stages"]}
    assert set(stages) == {"nothing", "friction law", "everything", "ideal"}, "one effect is everything"
    low, high = stages["everything"]["rms_between"]
    assert low < high
    again = predicted(words, tmp_path / "again", capsys)
    assert again == found, "draws have a seed"


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
        (["--draws", "0"], "--draws: 0, expected a whole number from 1"),
        (["--seed", "-1"], "--seed: -1, expected a whole number from 0"),
        (["--settle", "20"], "settle: 20 s, expected less than the run's 9 s"),
        (["--diagnosis", "nowhere.json"], "nowhere.json: cannot be read"),
        (["--diagnosis", "broken.json"], "broken.json: cannot be read"),
        (["--diagnosis", "other.json"], "other.json: no diagnosis"),
        (["--diagnosis", "nothing.json"], "nothing.json: names no effect of azimuth"),
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


def test_without_effects_there_is_nothing_to_predict(tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = axis(tmp_path / "axis.yaml")
    assert main(["compensate", str(path), "--reference", str(reference), "-o", str(tmp_path / "out")]) == 2
    assert "no effects, expected an axis file with effects" in capsys.readouterr().err


def test_results_replace_no_input(tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = axis(tmp_path / "compensation.json", item("cogging", COGGING))
    assert main(["compensate", str(path), "--reference", str(reference), "-o", str(tmp_path)]) == 2
    assert "would be written over the input" in capsys.readouterr().err
    axis(path, item("cogging", COGGING))
    assert load_axis(path).axis.effects
