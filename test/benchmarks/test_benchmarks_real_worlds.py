"""Real machines: what is injected is in the torque alone, what can be true of each is in the vocabulary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import real_worlds
from benchmarks.concealed_score import Expected
from benchmarks.real_worlds import INJECTED, MACHINES, SIZE, WITH, names, world
from tcs_friction.errors import InputError


def test_what_can_be_true_of_each_machine_is_in_the_vocabulary() -> None:
    for machine in MACHINES.values():
        Expected(machine.known, 0.0, tolerated=machine.tolerated)
    assert len(set(names())) == len(names()) == len(MACHINES) + len(INJECTED)


@pytest.mark.parametrize("name", ["odrive_slow", "pendulum_shoulder_11"])
def test_an_injected_effect_is_in_the_torque_alone(name: str, shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TCS_FRICTION_DATA", str(shared_data))
    effect, _ = INJECTED[name]
    plain, injected = world(name), world(f"{name}{WITH}{effect}")
    added = injected.recording.torque - plain.recording.torque
    assert np.std(added) == pytest.approx(SIZE * np.sqrt(np.mean(plain.recording.torque**2)))
    assert (injected.recording.position == plain.recording.position).all()
    assert (effect,) in injected.expected.effects
    assert injected.expected.tolerated == plain.expected.tolerated


def test_a_joint_of_a_table_has_the_motion_of_the_other_beside_it(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TCS_FRICTION_DATA", str(shared_data))
    shoulder, elbow = (world(f"pendulum_{joint}_11") for joint in ("shoulder", "elbow"))
    assert (shoulder.recording.exogenous["elbow_position"] == elbow.recording.position).all()
    assert elbow.recording.velocity is not None
    assert (shoulder.recording.exogenous["elbow_velocity"] == elbow.recording.velocity).all()
    assert shoulder.believed.axis.inertia > elbow.believed.axis.inertia > 0.0


def test_a_machine_that_is_not_there_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TCS_FRICTION_DATA", str(tmp_path))
    with pytest.raises(InputError, match="no recording"):
        real_worlds.folder_of("emps")
