"""What `bag info` says of the signals before anything is identified, and where it looks for them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import ROS2, START
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from tcs_friction.cli import main
from tcs_friction.recording.health import health
from tcs_friction.recording.info import bag_info

TYPES = ROS2.types
T = np.arange(2000) * 0.004
MOTION = 0.4 * np.sin(T)
SPEED = 0.4 * np.cos(T)
TORQUE = 6.0 * np.sign(SPEED) - 1.7 * MOTION + 0.1 * np.random.default_rng(0).standard_normal(len(T))
Make = Callable[[int, Any], Any]


def header(k: int) -> Any:
    stamp = START + round(T[k] * 1e9)
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9), "")


def joint_state(names: list[str], position: np.ndarray, velocity: np.ndarray, effort: np.ndarray | None) -> Any:
    """A message a sample: the first joint as given, the others the other way round."""

    def make(k: int) -> Any:
        count = max(1, len(names))
        columns = [
            np.array([column[k], *[-column[k]] * (count - 1)]) if column is not None else np.zeros(0)
            for column in (position, velocity, effort)
        ]
        return TYPES["sensor_msgs/msg/JointState"](header(k), names, *columns)

    return "sensor_msgs/msg/JointState", make


def wrench(torque: np.ndarray, noise: float = 0.01) -> Any:
    """The torque is said as a force along z."""
    random = noise * np.random.default_rng(1).standard_normal((len(T), 5))

    def make(k: int) -> Any:
        vector = TYPES["geometry_msgs/msg/Vector3"]
        force = vector(random[k, 0], random[k, 1], torque[k])
        return TYPES["geometry_msgs/msg/WrenchStamped"](
            header(k), TYPES["geometry_msgs/msg/Wrench"](force, vector(*random[k, 2:]))
        )

    return "geometry_msgs/msg/WrenchStamped", make


def trajectory() -> Any:
    def make(k: int) -> Any:
        goal = np.array([1.0 + k])
        point = TYPES["trajectory_msgs/msg/JointTrajectoryPoint"](
            goal, goal, goal, goal, TYPES["builtin_interfaces/msg/Duration"](1, 0)
        )
        return TYPES["trajectory_msgs/msg/JointTrajectory"](header(k), ["axle"], [point])

    return "trajectory_msgs/msg/JointTrajectory", make


def bag(path: Path, **topics: Any) -> Path:
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            name: (writer.add_connection(f"/{name}", kind, typestore=ROS2), kind, make) for name, (kind, make) in topics.items()
        }
        for k in range(len(T)):
            for connection, kind, make in connections.values():
                writer.write(connection, START + round(T[k] * 1e9) + 200_000, ROS2.serialize_cdr(make(k), kind))
    return path


def said(path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["bag", "info", str(path), *words]) == 0
    return capsys.readouterr().out


def test_a_good_bag_is_called_good_in_ten_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = said(bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, TORQUE)), capsys)
    looked_at = text[text.index("# signals of the axis") : text.index("# proposal")].strip().splitlines()
    assert len(looked_at) == 5
    assert looked_at[1] == "  position  250 Hz; -0.4 to 0.4 rad or m, as ROS has it (REP 103)"
    assert looked_at[3].endswith("the derivative of the position (1.000 times)")
    assert looked_at[4] == "  read as a recording: 2000 samples, 7.996 s"


def test_what_is_odd_is_said_and_is_in_the_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that is held, a position that wraps, a velocity in degrees, a torque that is frozen."""
    torque = TORQUE[np.arange(len(T)) // 5 * 5]
    torque[1000:1200] = torque[1000]
    wrapping = np.mod(10.0 * MOTION, 2.0 * np.pi)
    path = bag(tmp_path / "bag", states=joint_state(["axle", "cover"], wrapping, np.degrees(10.0 * SPEED), torque))
    text = said(path, capsys)
    assert "a new value at 50 Hz only, held between (every 5 messages); the same for 0.79" in text
    assert "position: wraps at 6.2832 rad, unwrapped at " in text
    assert "57.3 times the derivative of the position: is it in deg?" in text
    found = json.loads(said(path, capsys, "--json"))
    assert found["joints"] == ["axle", "cover"]
    assert found["health"]["signals"]["torque"]["fresh"] == pytest.approx(50.0, rel=0.02)
    assert found["health"]["signals"]["torque"]["rate"] == pytest.approx(250.0)
    assert found["health"]["refused"] is None
    other = json.loads(said(path, capsys, "--json", "--joint", "1"))
    assert other["signals"]["position"]["joint"] == "cover"
    assert other["health"]["signals"]["position"]["high"] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("factor", "expected"),
    [(1.0, "1.000 times"), (30.0 / np.pi, "is it in revolutions a minute?"), (3.3, "has it a scale?"), (0.0, "REP 103")],
)
def test_a_velocity_in_another_unit_is_noticed(
    factor: float, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, factor * SPEED, TORQUE))
    line = next(line for line in said(path, capsys).splitlines() if line.strip().startswith("velocity "))
    assert line.endswith(expected) or f"({expected})" in line
    random = np.random.default_rng(2).standard_normal(len(T))
    path = bag(tmp_path / "other", states=joint_state(["axle"], MOTION, random, TORQUE))
    assert "it is not the derivative of the position" in said(path, capsys)


def test_a_wheel_that_is_too_quick_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wheel = np.mod(400.0 * MOTION, 2.0 * np.pi)
    path = bag(tmp_path / "bag", states=joint_state(["axle"], wheel, np.full(len(T), np.nan), TORQUE))
    assert "  refused: the position wraps at 6.2832 rad and moves by " not in said(path, capsys), "0.64 rad a sample can be told"
    wheel = np.mod(1900.0 * MOTION, 2.0 * np.pi)
    path = bag(tmp_path / "quicker", states=joint_state(["axle"], wheel, np.full(len(T), np.nan), TORQUE))
    text = said(path, capsys)
    assert "  refused: the position wraps at 6.2832 rad and moves by " in text
    assert "velocity" in text
    assert main(["new", str(path), "-o", str(tmp_path / "axis.yaml")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("effort", [None, np.zeros(len(T)), np.full(len(T), np.nan)], ids=["none", "zeros", "nan"])
def test_a_torque_in_a_wrench_is_proposed_where_the_joints_have_none(effort: np.ndarray | None, tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, effort), sensor=wrench(TORQUE))
    assert bag_info(path).signals["torque"] == {"topic": "/sensor", "field": "wrench.force.z"}
    full = bag(tmp_path / "full", states=joint_state(["axle"], MOTION, SPEED, TORQUE), sensor=wrench(TORQUE))
    assert bag_info(full).signals["torque"]["topic"] == "/states"


def test_a_wrench_that_never_changes_is_no_torque(tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, None), sensor=wrench(np.zeros(len(T)), 0.0))
    assert "torque" not in bag_info(path).signals
    assert health(path, bag_info(path).signals) is None


def test_a_trajectory_is_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its topic comes first in the alphabet, and it has joints and positions."""
    path = bag(tmp_path / "bag", a_plan=trajectory(), states=joint_state(["axle"], MOTION, SPEED, TORQUE))
    assert bag_info(path).signals["position"]["topic"] == "/states"
    alone = bag(tmp_path / "alone", a_plan=trajectory())
    assert bag_info(alone).signals == {}
    assert "nothing here looks like position and torque" in said(alone, capsys)


def test_joints_without_names_are_numbered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bag(tmp_path / "bag", states=joint_state([], MOTION, SPEED, TORQUE))
    assert bag_info(path).signals["torque"] == {"topic": "/states", "field": "effort[0]"}
    assert "read as a recording: 2000 samples" in said(path, capsys, "--joint", "0")
    assert main(["bag", "info", str(path), "--joint", "axle"]) == 2
    assert "--joint: no joint 'axle', expected a number from 0 on" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--signal", "torque=/sensor:wrench.force.z"], ""),
        (["--signal", "position=/states:position@cover"], ""),
        (["--signal", "load=/sensor:wrench.force.x"], ""),
        (["--signal", "torque"], "--signal: 'torque', expected SIGNAL=/TOPIC:FIELD or SIGNAL=/TOPIC:FIELD@JOINT"),
        (["--signal", "torque=sensor:x"], "--signal: 'torque=sensor:x'"),
        (["--signal", "torque=/sensor:x@"], "--signal: 'torque=/sensor:x@'"),
        (["--signal", "torque=/a:b", "--signal", "torque=/a:c"], "--signal: torque named twice, expected each signal once"),
        (["--joint", "2"], "--joint: no joint '2', expected 0 to 1 or a name"),
        (["--joint", "axl"], "--joint: no joint 'axl', expected axle"),
    ],
)
def test_signals_and_joints_are_named_on_the_command_line(
    words: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["axle", "cover"], MOTION, SPEED, TORQUE), sensor=wrench(2.0 * TORQUE))
    status = main(["bag", "info", str(path), *words, "--json"])
    output = capsys.readouterr()
    if expected:
        assert status == 2
        assert expected in output.err
        assert output.err.count("\n") == 1
        return
    signals = json.loads(output.out)["signals"]
    if "load" in words[1]:
        assert signals["exogenous"]["load"] == {"topic": "/sensor", "field": "wrench.force.x"}
    elif "cover" in words[1]:
        assert signals["position"] == {"topic": "/states", "field": "position", "joint": "cover"}
        assert "velocity" not in signals, "it was that of another joint"
    else:
        assert signals["torque"] == {"topic": "/sensor", "field": "wrench.force.z"}


@pytest.mark.parametrize("words", [["bag", "info", "BAG"], ["new", "BAG", "-o", "OUT"], ["bag", "import", "BAG", "-o", "OUT"]])
def test_a_joint_that_is_no_text_is_refused(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = [word.replace("BAG", str(tmp_path)).replace("OUT", str(tmp_path / "out")) for word in words]
    with pytest.raises(SystemExit, match="2"):
        main([*given, "--joint", "a\udcff"])
    said = capsys.readouterr().err
    assert "argument --joint: 'a\\udcff' is no text" in said
    assert said.count("\n") == 1


def test_a_signal_that_is_not_there_is_refused_in_the_health(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, TORQUE))
    assert "no topic /drive, expected one of /states" in said(path, capsys, "--signal", "torque=/drive:data")
