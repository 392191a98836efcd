"""The concealed benchmark: its counting, and that the diagnosis never opens the folder with the truth."""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.concealed import TOOL, Outcome, add_arguments, parameter_errors, rows, run
from benchmarks.concealed_cases import draw_cases
from benchmarks.concealed_score import Expected, Judged
from benchmarks.worlds import draw_world, write_world
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings

ROOT = Path(__file__).resolve().parents[2]

# Diagnoses a bag and prints every path that was opened or listed on the way, then the result
WATCHED = """
import json, sys
from pathlib import Path
opened = []
def watch(event, arguments):
    if event in ("open", "os.listdir", "os.scandir", "shutil.copyfile") and arguments:
        opened.append(str(arguments[0]))
sys.addaudithook(watch)
from tcs_friction.config import load_axis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.recording.bags import read_recordings
folder = Path(sys.argv[1])
file = load_axis(folder / "axis.yaml")
found = diagnose(read_recordings([folder / "recording"], file.signals), file)
print(json.dumps({"opened": opened, "found": found.to_mapping()}))
"""


def entry(effect: str, *equivalent: str, **parameters: float) -> dict[str, Any]:
    return {
        "effect": effect,
        "equivalent": list(equivalent),
        "parameters": {name: {"value": value} for name, value in parameters.items()},
    }


def test_parameter_errors_are_relative_and_phases_in_turns() -> None:
    world = draw_world(np.random.default_rng(0), ["cogging"], 4.0, 0.1)
    truth = world.truth.parameters["cogging"]
    found = entry(
        "cogging",
        order=truth["order"],
        amplitude=1.1 * truth["amplitude"],
        phase=truth["phase"] - 0.98 * 2.0 * math.pi,
    )
    errors = parameter_errors(world, [found, entry("imbalance", amplitude=1.0)])
    assert errors["cogging.order"] == 0.0
    assert errors["cogging.amplitude"] == pytest.approx(0.1)
    assert errors["cogging.phase"] == pytest.approx(0.02)
    assert len(errors) == 3


def outcome(kind: str, right: bool, other: bool) -> Outcome:
    named = {TOOL: ("cogging",), "stepwise regression": ()}
    both = {TOOL: right, "stepwise regression": other}
    expected = Expected((("imbalance",),), 0.3)
    judged = Judged("one-1", "own", expected, "missing_physics", (), (), False, right, 1.05, None, 2.0)
    return Outcome(kind, ("imbalance",), named, both, "missing_physics", 2.0, 1.05, judged, {"a.b": 0.01})


def test_rows_count_shares_and_name_confusions() -> None:
    outcomes = [outcome("one", True, False)] * 3 + [outcome("one", False, True), outcome("none", True, False)]
    found = {row["name"]: row["value"] for row in rows(outcomes)}
    assert found["one effect, right and alone"] == 75.0
    assert found["one effect, right and alone: stepwise regression"] == 25.0
    assert found["nothing concealed, false alarm"] == 0.0
    assert found["nothing concealed, false alarm: stepwise regression"] == 100.0
    assert found["held-out residual over noise floor, median"] == 1.05
    assert found["imbalance named cogging"] == 1.0
    assert "two effects, exact set" not in found


def test_cases_are_seeded_and_cover_everything() -> None:
    cases = draw_cases(3, 1, 1.0)
    assert cases == draw_cases(3, 1, 1.0)
    assert len({case.seed for case in cases}) == len(cases)
    assert {case.kind for case in cases} == {"none", "one", "two", "three", "outside"}
    assert all(case.kind == "two" for case in draw_cases(3, 1, 1.0, "two"))
    assert [case.name for case in draw_cases(3, 1, 1.0, "two-41")] == ["two-41"]


def diagnosed(folder: Path) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, str(folder)], capture_output=True, text=True, check=True, cwd=ROOT
    )
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def test_the_diagnosis_never_opens_the_truth(tmp_path: Path) -> None:
    """Nothing in the sealed folder is opened or listed, and without it the result is the same to the last digit."""
    world = draw_world(np.random.default_rng(2), ["imbalance"], 8.0, 0.04)
    sealed = tmp_path / "world" / "sealed"  # beside the bag, where a search upwards or around would find it
    write_world(world, tmp_path / "world" / "open", sealed)
    first = diagnosed(tmp_path / "world" / "open")
    assert any("recording" in path for path in first["opened"])
    assert not [path for path in first["opened"] if "sealed" in path or "truth" in path]
    shutil.rmtree(sealed)
    assert diagnosed(tmp_path / "world" / "open")["found"] == first["found"]


def test_the_product_knows_nothing_of_the_generator() -> None:
    for path in (ROOT / "tcs_friction").rglob("*.py"):
        if path.name != "bench.py":
            text = path.read_text()
            assert "benchmarks" not in text, path
            assert "truth.json" not in text, path


def test_options_are_those_that_a_run_reads() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = parser.parse_args([])
    assert options.count is None
    assert options.limits is None
    assert parser.parse_args(["--limits"]).limits == []
    assert parser.parse_args(["--count", "3", "--only", "two"]).count == 3
    assert parser.parse_args([]).worlds == "own"
    for name in ("two-41", "telescope-spring", "dahl_viscous-for-lugre", "lost-samples-1"):
        assert parser.parse_args(["--only", name]).only == name


def test_a_world_that_is_of_another_kind_is_named() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    with pytest.raises(InputError, match="telescope-spring"):
        run(parser.parse_args(["--worlds", "laws", "--only", "telescope-spring"]))


def test_a_saved_world_can_be_diagnosed_and_its_truth_is_beside_it(tmp_path: Path) -> None:
    """One own world and one law world as a user has them written, read back by the product's own readers."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = ["--only", "one-0", "--stretch", "0.05", "--jobs", "1", "--save", str(tmp_path)]
    (written,) = run(parser.parse_args(words))
    assert written["value"] == 1.0
    folder = tmp_path / "own" / "one-0"
    file = load_axis(folder / "axis.yaml")
    (read,) = read_recordings([folder / "recording"], file.signals)
    truth = json.loads((folder / "truth.json").read_text())
    assert len(read) > 1000
    assert truth["effects"] == ["stribeck"]
    assert truth["accepted"] == [["stribeck"]]
