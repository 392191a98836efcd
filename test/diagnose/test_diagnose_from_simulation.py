"""Two bags and no axis file: the simulation's bag says what it believes."""

from __future__ import annotations

from pathlib import Path

import pytest
from open_loop_cases import LUGRE, axis, recorded

from tcs_friction.diagnose.from_simulation import believed_from_simulation, signals_of
from tcs_friction.errors import InputError
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.write import write_recording

JOINT = {"topic": "/states", "joint": "test"}
SIGNALS = {"position": {**JOINT, "field": "position"}, "torque": {**JOINT, "field": "effort"}}


def test_a_simulation_gives_its_physics_back(tmp_path: Path) -> None:
    bag = tmp_path / "simulation"
    write_recording(bag, recorded(axis()), SignalMap.from_mapping(SIGNALS, "test"))
    file, line = believed_from_simulation(bag, [bag])
    assert file.axis.inertia == pytest.approx(1000.0, rel=0.02)
    assert file.axis.friction.values["coulomb"] == pytest.approx(LUGRE["coulomb"], rel=0.1)
    assert file.axis.effects == ()
    assert "behaves like lugre" in line
    assert file.signals is not None
    assert file.signals.torque.field == "effort"


def test_a_bag_without_torque_is_named(tmp_path: Path) -> None:
    bag = tmp_path / "real"
    lone = {"position": {"topic": "/angle", "field": "data"}, "torque": {"topic": "/noise", "field": "data"}}
    write_recording(bag, recorded(axis(), duration=3.0), SignalMap.from_mapping(lone, "test"))
    with pytest.raises(InputError, match="no topic looks like"):
        signals_of(bag)
