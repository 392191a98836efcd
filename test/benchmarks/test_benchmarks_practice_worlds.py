"""Practice recordings as worlds: what is right is what their truth says, and what is not there is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.concealed_kinds import DRAWN, KINDS
from benchmarks.practice_worlds import MISSING, OUTSIDE, names, world
from tcs_friction.errors import InputError


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
    with pytest.raises(InputError, match=r"practice/law: no recording, expected axis\.yaml, recording and truth\.json"):
        world("law")


def test_recordings_are_not_among_the_worlds_that_are_drawn() -> None:
    assert "practice" in KINDS
    assert "practice" not in DRAWN
