"""Practice recordings as worlds: what is right is what their truth says, and what is not there is refused in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.concealed_kinds import DRAWN, KINDS, tasks_of
from benchmarks.practice_worlds import MISSING, OUTSIDE, names, world
from tcs_friction.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def test_what_is_right_is_what_the_truth_says(shared_data: Path) -> None:
    assert {path.name for path in (shared_data / "practice").iterdir()} == set(names())
    for name in names():
        truth = json.loads((shared_data / "practice" / name / "truth.json").read_text())
        for effect in truth.get("effects", ()):
            assert effect.startswith("unknown:") == (name in OUTSIDE)
            assert effect in MISSING[name] or name in OUTSIDE
        assert len(truth.get("effects", MISSING[name])) == len(MISSING[name]) + (name == "unknown")


def test_a_recording_is_a_world(shared_data: Path) -> None:
    trial = world("mujoco_spring")
    assert trial.recording.source == str(shared_data / "practice" / "mujoco_spring" / "recording")
    assert trial.expected.effects == (("cable_wrap",),)
    assert trial.expected.noise_floor == pytest.approx(0.297, abs=0.001)
    assert "spring" in trial.note


def test_a_recording_that_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TCS_FRICTION_DATA", str(tmp_path))
    for asked in (world, lambda name: tasks_of("practice", 0, name)):  # the second before any process is started
        with pytest.raises(InputError, match=r"practice/law: no recording, expected axis\.yaml, recording and truth\.json"):
            asked("law")


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (None, r"truth\.json: no such file, expected the truth of a practice recording"),
        ("{bad", r"truth\.json: line 2: is not YAML"),
        ('{"torque_noise": "much"}', r"truth\.json: torque_noise: 'much', expected a number, N m rms"),
    ],
)
def test_a_truth_that_cannot_be_read_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, truth: str | None, said: str
) -> None:
    folder = tmp_path / "practice" / "match"
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "config" / "azimuth_1p2m.yaml", folder / "axis.yaml")
    if truth is not None:
        (folder / "truth.json").write_text(truth)
    monkeypatch.setenv("TCS_FRICTION_DATA", str(tmp_path))
    with pytest.raises(InputError, match=said) as caught:
        world("match")
    assert "\n" not in str(caught.value)


def test_recordings_are_not_among_the_worlds_that_are_drawn() -> None:
    assert "practice" in KINDS
    assert "practice" not in DRAWN
