"""./tcs simulate: the bag opens with the axis file's own signals, and holds what the simulation did."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from tcs_friction.cli import main
from tcs_friction.commands.simulate import default_signals
from tcs_friction.config import load_axis
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording

AXIS = {
    "name": "test",
    "inertia": 2.0,
    "friction": {"law": "coulomb_viscous", "coulomb": 1.5, "viscous": 0.8},
}
SIGNALS = {
    "position": {"topic": "/joints", "field": "position", "joint": "one"},
    "torque": {"topic": "/joints", "field": "effort", "joint": "one", "scale": 0.5},
    "reference": {"topic": "/reference", "field": "position"},
    "temperature": {"topic": "/temperature", "field": "temperature"},
    "exogenous": {"wind": {"topic": "/wind", "field": "vector.x"}},
}


def files(
    folder: Path, axis: dict[str, object] | None = None, signals: dict[str, object] | None = None
) -> list[str]:
    """Arguments of a short sinusoid run."""
    content: dict[str, object] = {"axis": axis or AXIS}
    if signals:
        content["signals"] = signals
    (folder / "axis.yaml").write_text(yaml.safe_dump(content))
    reference = {"kind": "sinusoid", "amplitude": 0.2, "period": 2.0, "duration": 3.0}
    (folder / "reference.yaml").write_text(yaml.safe_dump({"reference": reference}))
    return [
        "simulate",
        str(folder / "axis.yaml"),
        "--reference",
        str(folder / "reference.yaml"),
        "-o",
        str(folder / "bag"),
    ]


def opened(folder: Path) -> Recording:
    signals = load_axis(folder / "axis.yaml").signals or default_signals("test")
    (recording,) = read_recordings([folder / "bag"], signals)
    return recording


def test_bag_opens_with_the_axis_file_s_signals(tmp_path: Path) -> None:
    assert main(files(tmp_path, signals=SIGNALS)) == 0
    recording = opened(tmp_path)
    assert len(recording) == 3001
    assert recording.reference is not None
    assert np.max(np.abs(recording.reference - recording.position)) < 0.01
    assert recording.temperature is not None
    assert np.all(recording.temperature == 20.0)
    assert np.all(recording.exogenous["wind"] == 0.0)


def test_recorded_torque_moves_the_inertia_against_the_friction(tmp_path: Path) -> None:
    assert main(files(tmp_path)) == 0
    recording = opened(tmp_path)
    t = recording.t
    velocity = np.gradient(recording.position, t)
    acceleration = np.gradient(velocity, t)
    balance = 2.0 * acceleration + 1.5 * np.sign(velocity) + 0.8 * velocity
    sliding = (np.abs(velocity) > 0.1) & (t > 0.2)
    assert np.max(np.abs(balance - recording.torque)[sliding]) < 0.1


def test_same_seed_gives_the_same_bag(tmp_path: Path) -> None:
    noisy = {**AXIS, "drive": {"noise": 0.2}, "sensors": {"noise": 1e-5}}
    positions = []
    for seed in (0, 0, 1):
        folder = tmp_path / str(len(positions))
        folder.mkdir()
        assert main([*files(folder, noisy), "--seed", str(seed)]) == 0
        positions.append(opened(folder).position)
    assert np.array_equal(positions[0], positions[1])
    assert not np.array_equal(positions[0], positions[2])


def test_exogenous_signal_is_taken_from_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    windy = {
        **AXIS,
        "effects": [{"effect": "wind_torque", "signal": "wind", "parameters": {"coefficient": 1.0}}],
    }
    arguments = files(tmp_path, windy, SIGNALS)
    assert main(arguments) == 0
    assert "wind is taken as 0" in capsys.readouterr().err
    calm = opened(tmp_path)
    # the same run again, in a wind that the first one's bag is made to hold
    from tcs_friction.recording.write import write_recording

    signals = load_axis(tmp_path / "axis.yaml").signals
    assert signals is not None
    gale = Recording(calm.t, calm.position, calm.torque, exogenous={"wind": np.full(len(calm), 3.0)},
                     temperature=np.full(len(calm), 30.0), reference=calm.reference)  # fmt: skip
    write_recording(tmp_path / "gale", gale, signals)
    arguments[-1] = str(tmp_path / "blown")
    assert main([*arguments, "--surroundings", str(tmp_path / "gale"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["notes"] == []
    (blown,) = read_recordings([tmp_path / "blown"], signals)
    late = calm.t > 1.0
    assert np.mean((blown.torque - calm.torque)[late]) == pytest.approx(9.0, rel=0.05)
    assert blown.temperature is not None
    assert np.allclose(blown.temperature, 30.0)


def test_learned_map_over_an_exogenous_signal_finds_it(tmp_path: Path) -> None:
    table = {"coordinates": ["exogenous:wind"], "lower": [0.0], "upper": [1.0], "values": [0.0, 1.0]}
    mapped = {**AXIS, "effects": [{"effect": "learned_map", "table": table}]}
    assert main(files(tmp_path, mapped, SIGNALS)) == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["--seed", "-1"], "--seed"),
        (["--surroundings", "nowhere"], "no signals block"),
    ],
)
def test_bad_arguments_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: list[str], words: str
) -> None:
    assert main([*files(tmp_path), *change]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_existing_bag_is_not_touched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = files(tmp_path)
    (tmp_path / "bag").mkdir()
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err
    assert list((tmp_path / "bag").iterdir()) == []


def test_place_that_cannot_be_written_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = files(tmp_path)
    arguments[-1] = str(tmp_path / "axis.yaml" / "bag")
    assert main(arguments) == 2
    assert "cannot be written" in capsys.readouterr().err
