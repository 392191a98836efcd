"""A MuJoCo model on the command line: moved by `simulate`, compared with a recording by `diagnose --against`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_commands_diagnose import diagnosis

from tcs_friction import cli
from tcs_friction.commands import diagnose as command
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile, load_axis, save_axis, shipped
from tcs_friction.diagnose import from_simulation
from tcs_friction.diagnose.from_model import SHORTEST_START, Way, recorded_along
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import graph_signals

pytest.importorskip("mujoco", reason="of the optional set mujoco")

RUN = "reference: {kind: sinusoid, amplitude: 0.02, period: 4.0, duration: 6.0}\n"


@pytest.fixture
def arguments(tmp_path: Path) -> list[str]:
    (tmp_path / "run.yaml").write_text(RUN)
    axis, run, bag = shipped("mount_azimuth.yaml"), tmp_path / "run.yaml", tmp_path / "bag"
    return ["simulate", str(axis), "--reference", str(run), "-o", str(bag), "--plant", "mujoco"]


def opened(bag: Path) -> Recording:
    (recording,) = read_recordings([bag], graph_signals("/azimuth", "azimuth"))
    return recording


def test_simulate_moves_the_shipped_mount(arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments) == 0
    recording = opened(tmp_path / "bag")
    assert recording.reference is not None
    assert np.abs(recording.reference - recording.position).max() < 2e-4
    sliding = np.abs(np.gradient(recording.position, recording.t)) > 0.01
    friction = (recording.torque * np.sign(np.gradient(recording.position, recording.t)))[sliding].mean()
    assert 78.1 < friction < 117.0, "Coulomb and viscous friction of the model"
    assert "azimuth_servo is a servo of joint azimuth and switched off" in capsys.readouterr().err


def test_effects_of_the_axis_file_are_said_to_be_left_out(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments[1] = str(shipped("azimuth_1p2m.yaml"))
    assert cli.main([*arguments, "--model", str(shipped("mount_two_axis.xml")), "--joint", "azimuth"]) == 0
    assert "azimuth_1p2m.yaml: its effects are not simulated, the model is" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--model", "nowhere.xml"], "nowhere.xml: no such file, expected a model of MuJoCo"),
        (["--joint", "azimut"], "no joint azimut, expected azimuth"),
        (["--joint", "altitude"], "joint altitude would be published as azimuth"),
        (["--plant", "simulated", "--joint", "azimuth"], "--joint: given without MuJoCo"),
        (["--plant", "simulated", "--model", "my.xml"], "--model: given without MuJoCo"),
    ],
)
def test_what_cannot_be_simulated_is_one_line(
    arguments: list[str], tmp_path: Path, more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*arguments, *more]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "bag").exists()


def test_graph_takes_one_plant_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["graph", "--plant", "mujoco", "--no-plant"]) == 2
    assert "--plant mujoco: --no-plant as well" in capsys.readouterr().err


def heavier(folder: Path) -> Path:
    """The shipped mount with another 200 kg m^2 on the fork."""
    path = folder / "heavier.xml"
    text = shipped("mount_two_axis.xml").read_text()
    assert 'diaginertia="600 600 750"' in text
    path.write_text(text.replace('diaginertia="600 600 750"', 'diaginertia="600 600 950"'))
    return path


def test_a_model_is_moved_as_the_recording_went(arguments: list[str], tmp_path: Path) -> None:
    """Along its own recording it takes the torque recorded, and a heavier one takes more by the inertia that it has more."""
    assert cli.main(arguments) == 0
    real, file = opened(tmp_path / "bag"), load_axis(shipped("mount_azimuth.yaml"))
    (same,) = recorded_along(shipped("mount_two_axis.xml"), "", file, [real])
    (more,) = recorded_along(heavier(tmp_path), "azimuth", file, [real])
    (stretch,) = prepare([real], held_out=False).stretches
    at = stretch.t[0] + same.t

    def slow(values: np.ndarray) -> np.ndarray:
        """Means over 0.1 s, without both ends, where the filters of the recording have not settled."""
        return np.convolve(values, np.full(100, 0.01), "same")[500:-500]

    torque, position = slow(np.interp(at, real.t, real.torque)), slow(np.interp(at, real.t, real.position))
    assert np.abs(slow(same.position) - position).max() < 2e-4
    acceleration, speed = (slow(np.interp(at, stretch.t, x)) for x in (stretch.acceleration, stretch.velocity))
    sliding = np.abs(speed) > 0.01
    assert np.median(np.abs(slow(same.torque) - torque)[sliding]) < 0.01 * np.std(torque)
    assert np.polyfit(acceleration, slow(more.torque) - slow(same.torque), 1)[0] == pytest.approx(200.0, rel=0.05)


def test_the_way_to_a_recording_s_first_speed_has_no_step() -> None:
    t = 2e-3 * np.arange(5000)
    moving = Recording(t, 0.3 + 0.02 * t + 0.01 * np.sin(t), np.sign(np.sin(7.0 * t)), source="moving")
    (stretch,) = prepare([moving], held_out=False).stretches
    way = Way(stretch)
    assert way.start >= SHORTEST_START
    times = np.arange(0.0, way.duration, 1e-3)
    position, speed, acceleration = way.over(times).T
    assert (speed[0], np.abs(np.diff(speed)).max()) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert np.abs(np.gradient(position, times) - speed)[5:-5].max() < 1e-5
    assert np.abs(acceleration).max() < 0.05
    wanted = np.array([stretch.position, stretch.velocity, stretch.acceleration]).T
    assert way.over(way.start + stretch.t) == pytest.approx(wanted, abs=1e-9)


def test_diagnose_believes_what_the_model_does(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which recordings the model is learnt from, and what is then believed; finding it is tested elsewhere."""
    assert cli.main(arguments) == 0
    learnt: list[Any] = []

    def learn(where: str, recordings: Any, start: Any, *_: Any) -> Any:
        learnt.append((where, recordings, start))
        return replace(start, inertia=1234.0), "it behaves like this"

    def diagnose(_: Any, file: AxisFile, *__: Any) -> Any:
        learnt.append(file)
        return diagnosis(file)

    monkeypatch.setattr(from_simulation, "believed_from_recordings", learn)
    monkeypatch.setattr(command, "diagnose", diagnose)
    file = load_axis(shipped("azimuth_1p2m.yaml"))  # whose effects are not the model's
    save_axis(tmp_path / "axis.yaml", file)
    words = ["diagnose", str(tmp_path / "bag"), "--axis", str(tmp_path / "axis.yaml"), "-o", str(tmp_path / "out")]
    assert cli.main([*words, "--against", str(shipped("mount_two_axis.xml")), "--joint", "azimuth"]) == 0
    (where, recordings, start), believed = learnt
    assert where.endswith("mount_two_axis.xml")
    assert np.ptp(recordings[0].position) == pytest.approx(0.04, rel=0.05)
    assert start.effects == ()
    assert (believed.axis.inertia, believed.control) == (1234.0, file.control)
    assert "Believed: it behaves like this." in (tmp_path / "out/report.html").read_text()
    assert "it behaves like this" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--against", "my.xml"], "my.xml and no axis file, expected --axis AXIS.yaml"),
        (["--axis", "AXIS", "--against", "bag", "--joint", "azimuth"], "--joint: given with the bag bag"),
        (["--axis", "AXIS", "--against", "my.xml"], "my.xml: no such file"),
    ],
)
def test_what_cannot_be_diagnosed_against_is_one_line(
    arguments: list[str], tmp_path: Path, more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 0
    capsys.readouterr()
    axis = str(shipped("mount_azimuth.yaml"))
    given = [axis if word == "AXIS" else word for word in more]
    assert cli.main(["diagnose", str(tmp_path / "bag"), *given, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
