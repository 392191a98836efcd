"""The player node: the bag's messages on their topics at their times; pause, loop, offset, clock."""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from conftest import wait_until
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from benchmarks import hostile_bags as hostile
from tcs_friction.errors import InputError
from tcs_friction.nodes.bags.bag_topics import profiles_text
from tcs_friction.nodes.bags.player import Pace, PlayerNode
from tcs_friction.nodes.core.executor import make_executor
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.encode import encoded
from tcs_friction.recording.write import EPOCH, write_bag


class Listener:
    """A node that keeps what it hears, with the wall time."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("listener")
        self.ended = threading.Event()
        self.heard: list[tuple[float, float]] = []
        self.clock: list[int] = []
        self.latched: list[float] = []
        self.node.create_subscription(Float64, "/a", lambda m: self.heard.append((time.monotonic(), m.data)), 1000)
        self.node.create_subscription(Clock, "/clock", self._on_clock, 1000)
        profile = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Float64, "/latched", lambda m: self.latched.append(m.data), profile)
        self.pause = self.node.create_client(Trigger, "/azimuth/player/pause")
        self.resume = self.node.create_client(Trigger, "/azimuth/player/resume")

    def _on_clock(self, message: Clock) -> None:
        self.clock.append(message.clock.sec * 10**9 + message.clock.nanosec)

    @property
    def numbers(self) -> list[float]:
        return [number for _, number in self.heard]


@pytest.fixture
def play(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Writes a bag of 300 numbers at 200 Hz and one latched number; plays it with the given parameters."""
    times = EPOCH + np.arange(300) * 5_000_000
    latched = profiles_text([QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)])
    topics = [
        encoded("/a", "std_msgs/msg/Float64", times, {"data": np.arange(300.0)}),
        encoded("/latched", "std_msgs/msg/Float64", times[:1], {"data": np.array([7.0])}, latched),
    ]
    write_bag(tmp_path / "bag", topics)
    nodes: list[Any] = []

    def start(*parameters: str) -> tuple[Any, Listener, Callable[..., bool]]:
        words = [word for parameter in (f"bag:={tmp_path / 'bag'}", *parameters) for word in ("-p", parameter)]
        rclpy.init(args=["--ros-args", *words])
        listener = Listener()
        nodes.append(listener.node)
        player = PlayerNode(at_end=listener.ended.set)
        nodes.append(player)
        executor = make_executor()
        for node in nodes:
            executor.add_node(node)

        def spin(until: Callable[[], bool], limit: float = 10.0) -> bool:
            end = time.monotonic() + limit
            while not until() and time.monotonic() < end:
                executor.spin_until_future_complete(Future(), timeout_sec=0.02)
            return until()

        return player, listener, spin

    yield start
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def test_everything_is_played_at_its_time_and_the_end_is_the_end(play: Any) -> None:
    player, listener, spin = play()
    assert spin(lambda: len(listener.heard) >= 300)
    assert listener.numbers == list(range(300))
    assert listener.latched == [7.0]
    wall = np.array([moment for moment, _ in listener.heard])
    late = (wall - wall[0]) - np.arange(300) * 5e-3
    assert np.median(np.abs(late - np.median(late))) < 5e-3
    assert wall[-1] - wall[0] == pytest.approx(1.495, abs=0.1)
    assert spin(listener.ended.is_set, 5.0)
    assert player.count == 301


def test_rate_and_offset(play: Any) -> None:
    _, listener, spin = play("rate:=4.0", "start_offset:=1.0")
    assert spin(lambda: len(listener.heard) >= 100)
    assert listener.numbers == list(range(200, 300))
    assert listener.heard[-1][0] - listener.heard[0][0] == pytest.approx(0.495 / 4, abs=0.05)


def test_pause_and_resume(play: Any) -> None:
    _, listener, spin = play("paused:=true")
    assert not spin(lambda: bool(listener.heard), 1.0)
    assert listener.resume.wait_for_service(5.0)
    listener.resume.call_async(Trigger.Request())
    assert spin(lambda: len(listener.heard) >= 50)
    answer = listener.pause.call_async(Trigger.Request())
    assert spin(answer.done)
    count = len(listener.heard)
    spin(lambda: False, 0.3)
    assert len(listener.heard) <= count + 1
    assert count < 250
    listener.resume.call_async(Trigger.Request())
    assert spin(lambda: len(listener.heard) >= 300)
    assert listener.numbers == list(range(300))


def test_nothing_is_played_before_everybody_listens(play: Any, capfd: pytest.CaptureFixture[str]) -> None:
    player, listener, spin = play("delay:=0.0", "subscribers:=2", "topics:=[/a]")
    assert not spin(lambda: bool(listener.heard), 0.7)
    assert player.condition()[0] == "waiting for subscribers of /a"
    assert "waiting for 2 subscribers of /a; `topics` names what to play" in capfd.readouterr().err
    heard: list[float] = []
    listener.node.create_subscription(Float64, "/a", lambda m: heard.append(m.data), 1000)
    assert spin(lambda: len(heard) >= 300)
    assert heard == listener.numbers == list(range(300))
    assert player.condition()[0] == ""


def test_loop(play: Any) -> None:
    _, listener, spin = play("loop:=true", "rate:=20.0", "topics:=[/a]")
    assert spin(lambda: len(listener.heard) >= 700)
    assert listener.numbers[:700] == [*range(300), *range(300), *range(100)]


def test_clock(play: Any) -> None:
    _, listener, spin = play("clock_rate:=100.0", "rate:=2.0")
    assert spin(lambda: len(listener.heard) >= 300)
    steps = np.diff(listener.clock)
    assert set(steps.tolist()) == {20_000_000}
    assert listener.clock[0] == EPOCH
    assert len(listener.clock) == pytest.approx(75, abs=2)


def test_without_a_clock_it_plays_and_ends(play: Any) -> None:
    """`use_sim_time` is set for all nodes, and nobody publishes /clock: ROS time stands still."""
    _, listener, spin = play("use_sim_time:=true", "rate:=20.0", "delay:=0.5")
    assert spin(lambda: len(listener.heard) >= 300)
    assert spin(listener.ended.is_set, 5.0)


def test_what_cannot_be_played_is_one_line(play: Any) -> None:
    with pytest.raises(InputError, match="no message on /b, expected /a"):
        play("topics:=[/b]")


def test_no_bag_is_one_line() -> None:
    rclpy.init(args=[])
    try:
        with pytest.raises(InputError, match="parameter bag: is empty"):
            PlayerNode()
    finally:
        rclpy.try_shutdown()


def test_a_pace_stands_still_while_paused_and_stops_at_once() -> None:
    pace = Pace(10.0)
    pace.start(1000)
    assert pace.wait(1000)
    pace.pause()
    stood = pace.bag_time()
    time.sleep(0.05)
    assert pace.bag_time() == stood
    pace.resume()
    assert stood <= pace.bag_time() < stood + 2 * 10**8
    threading.Timer(0.1, pace.stop).start()
    begin = time.monotonic()
    assert not pace.wait(10**12)
    assert time.monotonic() - begin < 2.0


def test_a_bag_of_odd_names_and_times_is_played_as_far_as_it_goes(processes: Any, tmp_path: Path) -> None:
    """A name that no topic can have, and a message 200 years on: the node goes on waiting, and obeys SIGINT."""
    names = [hostile.topic(0, "/a b", "std_msgs/msg/Float64"), hostile.topic(1, "/a", "std_msgs/msg/Float64")]
    number = b"\0\1\0\0" + bytes(8)
    far = struct.pack("<HIQQ", 1, 0, 2**63 - 1, 2**63 - 1) + number
    records = [hostile.message(0, 0, number), hostile.message(1, 1, number), hostile.record(5, far)]
    bag = hostile.mcap(tmp_path / "odd", *names, *records)
    processes.start("player", "-p", f"bag:={bag}", "-p", "delay:=0.0", "-p", "rate:=0.001", "-p", "clock_rate:=1.0")
    assert wait_until(lambda: "/a b is not played" in processes.log("player"), 90.0)
    time.sleep(0.5)  # into the wait for the last message
    assert processes.interrupt("player") == 0, processes.log("player")
    assert "Traceback" not in processes.log("player")


def test_a_node_in_the_middle_of_its_making_obeys_sigint(tmp_path: Path) -> None:
    """A factory that reads for a long time, as one does that is given a large bag."""
    begun = tmp_path / "begun"
    code = (
        "import pathlib, time\n"
        "from tcs_friction.nodes.core.executor import run\n"
        f"raise SystemExit(run(lambda: (pathlib.Path({str(begun)!r}).touch(), time.sleep(60))))\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert wait_until(begun.exists)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=30)
    assert (child.returncode, said) == (0, "")


def test_a_reading_in_another_thread_can_be_abandoned(tmp_path: Path) -> None:
    bag = Bag(hostile.broken_runs(tmp_path / "bag", 50))
    batches = bag.batches()
    next(batches)
    bag.abandon()
    assert list(batches) == []
