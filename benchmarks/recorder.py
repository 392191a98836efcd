"""The recorder node at 1 kHz times five topics: messages dropped, share of a core.

Another process publishes joint states of two joints at the given pace; the recorder runs in a process of its own. Counted are
the messages in the bag between its first and last number, and processor time from the first to the last message.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.signals import SignalMap, SignalSource

RECORDER = "import sys; from tcs_friction.nodes.bags.recorder import main; sys.exit(main())"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--topics", type=positive, default=5)
    parser.add_argument("--rate", type=float, default=1000.0, help="messages per second and topic")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: messages dropped, share of a core, seconds of processor time per million messages."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    names = [f"/bench/topic_{number}" for number in range(arguments.topics)]
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        words = ["--ros-args", "-p", f"bag:={bag}", "-p", f"topics:=[{', '.join(names)}]"]
        recorder = subprocess.Popen([sys.executable, "-c", RECORDER, *words], stderr=subprocess.DEVNULL)
        receive, send = multiprocessing.Pipe(duplex=False)
        publisher = multiprocessing.get_context("spawn").Process(
            target=_publish, args=(names, arguments.seconds, arguments.rate, send), daemon=True
        )
        publisher.start()
        try:
            limit = arguments.seconds + 120.0
            marks = [_processor_time(recorder.pid) for _ in range(2) if receive.poll(limit) and receive.recv()]
            publisher.join(30.0)
        finally:
            recorder.send_signal(signal.SIGINT)
            status = recorder.wait(60.0)
        if status or len(marks) < 2:
            raise JobError("bench recorder", f"the recorder ended with status {status}", "ROS and an idle domain")
        found = [_numbers(bag, name) for name in names]
    dropped = sum(int(numbers[-1] - numbers[0]) + 1 - len(numbers) for numbers in found)
    spent, messages = marks[1] - marks[0], sum(len(numbers) for numbers in found)
    return [
        {"name": f"messages dropped of {messages}", "value": dropped, "unit": "1", "beside": 0},
        {"name": "share of a core (bar: 0.333)", "value": spent / arguments.seconds, "unit": "1"},
        {"name": "processor time a message", "value": 1e6 * spent / messages, "unit": "us"},
    ]


def _numbers(bag: Path, topic: str) -> np.ndarray:
    """The numbers that the messages of a topic carry, in order."""
    position, effort = SignalSource(topic, "position", "azimuth"), SignalSource(topic, "effort", "azimuth")
    (recording,) = read_recordings([bag], SignalMap(position, effort))
    return np.rint(recording.position).astype(int)


def _processor_time(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _publish(names: list[str], seconds: float, rate: float, send: Any) -> None:
    """In a process of its own: wait for the recorder, publish numbered messages, say when it begins and ends."""
    import rclpy
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import JointState

    rclpy.init(args=[])
    node = rclpy.create_node("bench_publisher")
    publishers = [node.create_publisher(JointState, name, QoSProfile(depth=1000)) for name in names]
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.05)
    time.sleep(1.0)
    message = JointState(name=["azimuth", "elevation"], position=[0.0] * 2, velocity=[0.0] * 2, effort=[0.0] * 2)
    send.send("begin")
    begin = time.perf_counter()
    number = 0
    while number < seconds * rate:
        ahead = number / rate - (time.perf_counter() - begin)
        if ahead > 0.0:
            time.sleep(ahead)
            continue
        message.header.stamp.sec, message.header.stamp.nanosec = 1 + number // 1000, number % 1000 * 1_000_000
        message.position[0] = float(number)
        for publisher in publishers:
            publisher.publish(message)
        number += 1
    time.sleep(0.5)
    send.send("end")
    rclpy.shutdown()
