"""The recorder node: everything that is published is in the bag, also when the node is killed."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from tcs_friction.nodes.bags.bag_topics import (
    installed_definition,
    message_class,
    profiles_text,
    publisher_profile,
    subscription_profile,
)
from tcs_friction.nodes.bags.recorder import RecorderNode
from tcs_friction.nodes.core.executor import make_executor
from tcs_friction.recording.bags import Bag, read_recordings
from tcs_friction.recording.signals import SignalMap, SignalSource

ROOT = Path(__file__).resolve().parents[2]
SIGNALS = SignalMap(
    SignalSource("/azimuth/joint_states", "position", "azimuth"), SignalSource("/azimuth/joint_states", "effort", "azimuth")
)


@pytest.fixture
def graph() -> Iterator[Callable[..., Any]]:
    """Starts ROS with arguments; makes nodes; gives a function that spins until a condition or a time has come."""
    made: list[Any] = []

    def start(arguments: list[str], *factories: Callable[[], Any]) -> tuple[list[Any], Callable[..., bool]]:
        rclpy.init(args=["--ros-args", *arguments])
        executor = make_executor()
        for factory in factories:
            made.append(factory())
            executor.add_node(made[-1])

        def spin(until: Callable[[], bool], limit: float = 10.0) -> bool:
            end = time.monotonic() + limit
            while not until() and time.monotonic() < end:
                executor.spin_until_future_complete(Future(), timeout_sec=0.02)
            return until()

        return made, spin

    yield start
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def talker() -> Any:
    return rclpy.create_node("talker", namespace="azimuth")


def state(stamp: int) -> JointState:
    message = JointState(name=["azimuth"], position=[stamp * 1e-3], velocity=[1.0], effort=[-stamp * 1e-3])
    message.header.stamp.sec, message.header.stamp.nanosec = 100 + stamp // 1000, stamp % 1000 * 1_000_000
    return message


def test_every_message_is_recorded_as_it_was_sent(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    arguments = ["-p", f"bag:={bag}", "-p", "topics:=[joint_states, /late, /odd/best_effort]"]
    (recorder, node), spin = graph(arguments, RecorderNode, talker)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    states = node.create_publisher(JointState, "joint_states", 100)
    early = node.create_publisher(DiagnosticArray, "/late", latched)
    best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    hasty = node.create_publisher(JointState, "/odd/best_effort", best_effort)
    unwanted = node.create_publisher(JointState, "/unwanted", 10)
    early.publish(DiagnosticArray())  # before anybody listens
    assert spin(lambda: states.get_subscription_count() > 0 and hasty.get_subscription_count() > 0)
    for stamp in range(300):
        states.publish(state(stamp))
        if stamp % 10 == 0:
            hasty.publish(state(stamp))
            spin(lambda: False, 0.001)
    unwanted.publish(state(0))
    wanted = {"/azimuth/joint_states": 300, "/late": 1, "/odd/best_effort": 30}
    assert spin(lambda: recorder.bag.counts == wanted), recorder.bag.counts
    profiles = [publisher_profile(channel.qos) for channel, _ in recorder.bag._channels if channel.topic == "/late"]
    assert recorder.condition()[0] == ""
    assert recorder.condition()[1]["/azimuth/joint_states"] == "300"
    refused = recorder.set_parameters([Parameter("topics", value=["/other"])])[0]
    assert (refused.successful, "read-only" in refused.reason) == (False, True)
    recorder.bag.close()
    recorder.bag.close = lambda: None  # the fixture closes it again

    assert profiles[0].durability == DurabilityPolicy.TRANSIENT_LOCAL
    payloads = [raw for part in Bag(bag).batches(["/azimuth/joint_states"]) for raw in part.payloads()]
    assert [deserialize_message(raw, JointState) for raw in payloads] == [state(stamp) for stamp in range(300)]
    (recording,) = read_recordings([bag], SIGNALS)
    assert np.array_equal(recording.torque, -np.arange(300) * 1e-3)
    with AnyReader([bag]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == wanted
        assert all(c.digest.startswith("RIHS01_") for c in reader.connections)
        assert sum(1 for c, _, raw in reader.messages() if reader.deserialize(raw, c.msgtype)) == 331
    with (bag / "bag_0.mcap").open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/azimuth/joint_states"])
        assert [item.decoded_message.position[0] for item in decoded] == [stamp * 1e-3 for stamp in range(300)]


def test_a_killed_recorder_leaves_all_but_the_last_second(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    (node,), _ = graph([], talker)
    states = node.create_publisher(JointState, "/killed/joint_states", 1000)
    program = "import sys; from tcs_friction.nodes.bags.recorder import main; sys.exit(main())"
    arguments = ["--ros-args", "-p", f"bag:={bag}", "-p", "topics:=[/killed/joint_states]"]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}
    with subprocess.Popen([sys.executable, "-c", program, *arguments], env=environment, stderr=subprocess.DEVNULL) as process:
        try:
            begin = time.monotonic()
            end = begin + 60.0
            sent = 0
            while time.monotonic() < end:
                if (time.monotonic() - begin) * 1000 > sent:
                    states.publish(state(sent))
                    sent += 1
                    if sent % 100 == 0 and end > begin + 50.0 and _size(bag) > 1000:
                        end = time.monotonic() + 2.0
                else:
                    time.sleep(2e-4)
        finally:
            os.kill(process.pid, signal.SIGKILL)
    topic = "/killed/joint_states"
    signals = SignalMap(SignalSource(topic, "position", "azimuth"), SignalSource(topic, "effort", "azimuth"))
    (recording,) = read_recordings([bag], signals)
    numbers = np.rint(recording.position * 1e3).astype(int)
    assert np.array_equal(numbers, np.arange(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) > 500
    assert numbers[-1] >= sent - 1000
    assert "damaged: the end of the file is missing" in " ".join(recording.notes)


def _size(bag: Path) -> int:
    return sum(path.stat().st_size for path in bag.glob("*.mcap"))


def test_a_directory_that_exists_is_refused(graph: Any, tmp_path: Path) -> None:
    from tcs_friction.errors import InputError

    with pytest.raises(InputError, match="exists already"):
        graph(["-p", f"bag:={tmp_path}"], RecorderNode)


def test_profiles_survive_the_bag() -> None:
    reliable = QoSProfile(depth=7, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    back = publisher_profile(profiles_text([reliable]))
    assert (back.reliability, back.durability, back.depth) == (reliable.reliability, reliable.durability, 7)
    assert publisher_profile(profiles_text([best_effort])).reliability == ReliabilityPolicy.BEST_EFFORT
    both = profiles_text([reliable, best_effort])
    assert publisher_profile(both).reliability == ReliabilityPolicy.RELIABLE
    assert yaml.safe_load(both)[0]["deadline"]["sec"] > 10**9
    numbers = yaml.safe_dump([{"history": 3, "depth": 50, "reliability": 2, "durability": 1}])  # metadata of version 8
    old = publisher_profile(numbers)
    assert (old.reliability, old.durability, old.depth) == (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.TRANSIENT_LOCAL, 50)
    for odd in ("", "[1, {", "- 3", "- {reliability: 99, depth: x}"):
        assert publisher_profile(odd).reliability == ReliabilityPolicy.RELIABLE


def test_a_subscription_hears_the_least_reliable_publisher() -> None:
    reliable, best_effort = QoSProfile(depth=1), QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    assert subscription_profile([reliable, best_effort]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert subscription_profile([latched, reliable]).durability == DurabilityPolicy.VOLATILE
    assert subscription_profile([latched]).durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_types_are_found_by_name() -> None:
    assert message_class("sensor_msgs/msg/JointState") is JointState
    assert message_class("no_such_msgs/msg/Thing") is None
    sys.modules.pop("this", None)
    assert message_class("this/msg/Thing") is None
    assert "this" not in sys.modules, "a bag must not have any module imported"
    assert message_class("sensor_msgs/msg/Thing") is None
    assert "string[] name" in (installed_definition("sensor_msgs/msg/JointState") or "")
    assert installed_definition("no_such_msgs/msg/Thing") is None


DISK, END_OF_FILE = 200_000, 10_000  # bytes: that a file may have, and more than its definitions and indexes take


def test_a_full_disk_ends_the_recorder_with_one_line_and_a_readable_bag(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    (node,), _ = graph([], talker)
    states = node.create_publisher(JointState, "/full/joint_states", 1000)
    with recorder_process(bag, "/full/joint_states", limit=DISK) as process:
        sent = 0
        end = time.monotonic() + 60.0
        while process.poll() is None and time.monotonic() < end:
            states.publish(state(sent))
            sent += 1
            time.sleep(1e-3)
        output = process.communicate(timeout=10)[0]
    assert process.returncode == 1
    assert "Traceback" not in output, output
    lines = [line for line in output.splitlines() if "tcs-friction" in line]
    assert lines == [f"tcs-friction: {bag}: cannot be written any more (File too large); what came before is kept"]
    topic = "/full/joint_states"
    signals = SignalMap(SignalSource(topic, "position", "azimuth"), SignalSource(topic, "effort", "azimuth"))
    (recording,) = read_recordings([bag], signals)
    assert f"recorded {topic} {len(recording)}" in output
    assert len(recording) > 100
    (file,) = bag.glob("*.mcap")
    room = DISK - file.stat().st_size  # of the chunk that did not fit: it serves for the end of the file, if that fits
    assert "damaged" not in " ".join(recording.notes) or room < END_OF_FILE


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with recorder_process(tmp_path / "file" / "bag", "/nothing") as process:
        output = process.communicate(timeout=60)[0]
    assert process.returncode == 2
    assert output.count("\n") == 1
    assert "file/bag: cannot be written (Not a directory)" in output


def recorder_process(bag: Path, topics: str, limit: int = resource.RLIM_INFINITY) -> subprocess.Popen[str]:
    """The recorder in a process that can make no file longer than `limit` bytes."""
    program = (
        f"import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n"
        "from tcs_friction import writable; writable.ROOM = 1\n"
        "from tcs_friction.nodes.bags.recorder import main; sys.exit(main())"
    )
    arguments = ["--ros-args", "-p", f"bag:={bag}", "-p", f"topics:=[{topics}]"]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
