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
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import joints_in, read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.health import health
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.signals import SignalMap, SignalSource

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
    assert len(looked_at) == 6
    assert looked_at[1] == "  position  250 Hz; -0.4 to 0.4 rad or m, as ROS has it (REP 103)"
    assert looked_at[3].endswith("the derivative of the position (1.000 times)")
    assert looked_at[5] == "  read as a recording: 2000 samples, 7.996 s"


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


def number(kind: str, field: str, values: np.ndarray) -> Any:
    def make(k: int) -> Any:
        return TYPES[kind](**{field: values[k]})

    return kind, make


def test_units_in_names_of_topics_are_believed_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bare numbers, whose topics say what they are: degrees and amperes."""
    plain = "std_msgs/msg/Float64"
    angle, current = number(plain, "data", np.degrees(MOTION)), number(plain, "data", 0.5 * TORQUE)
    path = bag(tmp_path / "bag", az_act_deg=angle, motor_current_mA=current)
    found = bag_info(path)
    assert found.signals["position"] == {"topic": "/az_act_deg", "field": "data", "unit": "deg"}
    assert found.signals["torque"] == {"topic": "/motor_current_mA", "field": "data", "unit": "mA"}
    text = said(path, capsys)
    assert f"{MOTION.min():.4g} to {MOTION.max():.4g} rad or m, recorded in deg, as its name says" in text
    assert " A, recorded in mA, as its name says" in text
    (one,) = read_recordings([path], SignalMap.from_mapping(found.signals, "bag"))
    assert one.torque_unit == "A"
    assert np.allclose(one.torque[:500], 0.5e-3 * TORQUE[:500])


@pytest.mark.parametrize("late", [0.0, 0.024, -0.016])
def test_an_offset_between_torque_and_motion_is_told(late: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An axis with an inertia and friction; the torque is logged on a topic of its own that is early or late.

    A momentary torque is one that is held from half a sample before its stamp on.
    """
    waves = [(0.5 + 1.3 * k + 0.1 * k * k, 0.7 * k * k) for k in range(8)]  # as many as tell a lag from a change of friction
    motion = sum(np.sin(rate * T + phase) / rate for rate, phase in waves)
    speed = sum(np.cos(rate * T + phase) for rate, phase in waves)
    acting = 20.0 * speed - 60.0 * sum(rate * np.sin(rate * T + phase) for rate, phase in waves) + 6.0 * np.sign(speed)
    noise = 0.5 * np.random.default_rng(4).standard_normal(len(T))
    logged = np.interp(T - late, T, acting) + noise  # says at t what acted `late` before
    path = bag(tmp_path / "bag", states=joint_state(["axle"], motion, speed, None), drive=wrench(logged))
    found = json.loads(said(path, capsys, "--json", "--signal", "torque=/drive:wrench.force.z"))["health"]
    assert found["acts"] == pytest.approx(-late - 0.002, abs=0.0041)
    line = next(line for line in said(path, capsys).splitlines() if "torque and motion" in line)
    assert ("clocks, filters or a delay" in line) == (late != 0.0)


def test_a_motion_that_does_not_tell_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(3).standard_normal(len(T))
    path = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, random))
    assert "the motion does not tell when the torque acts" in said(path, capsys)
    assert json.loads(said(path, capsys, "--json"))["health"]["acts"] is None


def test_elements_of_arrays_without_names_are_joints_by_number(tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", states=joint_state(["a", "b", "c"], MOTION, SPEED, TORQUE))
    unnamed = SignalMap(SignalSource("/states", "position[0]"), SignalSource("/states", "effort[0]"))
    named = SignalMap(SignalSource("/states", "position", "a"), SignalSource("/states", "effort", "a"))
    assert joints_in(path, unnamed) == ("0", "1", "2")
    assert joints_in(path, named) == ("a", "b", "c")
    for signals in (unnamed, named):
        (one,) = read_recordings([path], signals, Choice(joint="2"))
        assert np.array_equal(one.position, -MOTION)
        assert np.array_equal(one.torque, -TORQUE)
        with pytest.raises(InputError, match="--joint: no joint '3', expected 0 to 2"):
            read_recordings([path], signals, Choice(joint="3"))
    with pytest.raises(InputError, match="--joint: no joint 'b', expected one of 0, 1, 2"):
        read_recordings([path], unnamed, Choice(joint="b"))
    alone = SignalMap(SignalSource("/states", "header.stamp.sec"), unnamed.torque)
    with pytest.raises(InputError, match="names no joints"):
        joints_in(path, alone)


def test_strict_refuses_messages_that_are_lost_and_samples_that_are_cut(tmp_path: Path) -> None:
    signals = SignalMap(SignalSource("/states", "position", "axle"), SignalSource("/states", "effort", "axle"))
    holed = TORQUE.copy()
    holed[500:510] = np.nan
    good = bag(tmp_path / "good", states=joint_state(["axle"], MOTION, SPEED, TORQUE))
    cut = bag(tmp_path / "cut", states=joint_state(["axle"], MOTION, SPEED, holed))
    read_recordings([good], signals, Choice(strict=True))
    with pytest.raises(InputError, match="torque: 10 of 2000 samples missing or not finite, cut as gaps, expected"):
        read_recordings([cut], signals, Choice(strict=True))
    file = good / "good.mcap"
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    (one,) = read_recordings([good], signals)
    assert any(note.startswith("damaged: ") for note in one.notes)
    with pytest.raises(InputError, match=r"damaged: .*expected nothing to mend \(--strict\)"):
        read_recordings([good], signals, Choice(strict=True))


def test_a_table_is_looked_at_as_a_bag_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    held = TORQUE[np.arange(len(T)) // 5 * 5]
    rows = zip(T.tolist(), np.degrees(MOTION).tolist(), SPEED.tolist(), held.tolist(), strict=True)
    path = tmp_path / "a.csv"
    path.write_text("time [s],angle [deg],velocity,drive current [A]\n" + "".join(f"{a},{b},{c},{d}\n" for a, b, c, d in rows))
    text = said(path, capsys)
    assert text.startswith(f"{path}: 2000 rows, 7.996 s\n")
    assert "position  250 Hz; -0.4 to 0.4 rad, recorded in deg in column 'angle [deg]'" in text
    assert "a new value at 50 Hz only, held between (every 5 messages)" in text
    assert "the derivative of the position (1.000 times)" in text
    assert " A, recorded in A in column 'drive current [A]'" in text
    assert " rad/s, column 'velocity' says no unit, taken as SI" in text
    assert "torque and motion: " in text
    found = json.loads(said(path, capsys, "--json"))["health"]
    assert found["signals"]["torque"]["fresh"] == pytest.approx(50.0, rel=0.03)
    assert (found["samples"], found["refused"]) == (2000, None)
    for words in (["--signal", "torque=/a:b"], ["--column", "torque=nothing"]):
        assert main(["bag", "info", str(path), *words]) == 2
    other = bag(tmp_path / "bag", states=joint_state(["axle"], MOTION, SPEED, TORQUE))
    assert main(["bag", "info", str(other), "--column", "time=1"]) == 2

