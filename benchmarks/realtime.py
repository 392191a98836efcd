"""From joint state to command in real time: latency and jitter, beside a bare publisher and subscriber of the same messages.

A driver in a process of its own publishes joint states at a rate and hears the commands; both moments are read from its steady
clock. The nodes of the loop are in one process, or in a process each; the bare pair's other half is one node that answers every
state at once. All have real-time scheduling as far as it is permitted (--ordinary: none). Ours and the bare pair are measured in
turn, several times, so that a busy machine slows both. Load: a process for each core that computes without end.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import sys
import time
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.children import deaf
from tcs_friction.commands.parser import positive
from tcs_friction.errors import InputError, JobError

Array = NDArray[np.float64]

PAIR = ("pair",)
PLACES = {"one": "one process", "several": "four processes"}
LOADS = {"without": "no load", "with": "under load"}
LISTEN_ON = 0.5  # s after the last state, in which its answer may come
SAMPLE = 5.0  # s between two looks at a process' memory, each of which takes a millisecond
BEGIN_LIMIT = 120.0  # s
MISSES = 0.01  # share of states without an answer from which on a run counts for nothing
PAGE = os.sysconf("SC_PAGE_SIZE")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    add = parser.add_argument
    add("--rates", default="250,500,1000", metavar="HZ,HZ", help="states per second (default %(default)s)")
    add("--seconds", type=positive, default=120, help="of each combination, and as long of its bare pair (default %(default)s)")
    add("--turns", type=positive, default=2, help="into which they are divided (default %(default)s)")
    add("--warm-up", type=positive, default=3, help="seconds before each turn (default %(default)s)")
    add("--places", default=",".join(PLACES), help="where the nodes are: one process, several (default %(default)s)")
    add("--loads", default=",".join(LOADS), help="without load, with it (default %(default)s)")
    add("--cores", default="all", metavar="2,3", help="processor cores of all that is measured (default: all)")
    add("--ordinary", action="store_true", help="no real-time scheduling")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows for each rate, place and load: latency, jitter and growth of memory."""
    from tcs_friction.nodes.core import scheduling

    rates = [_rate(word) for word in arguments.rates.split(",")]
    places, loads = _chosen("--places", arguments.places, PLACES), _chosen("--loads", arguments.loads, LOADS)
    if not arguments.ordinary:
        scheduling.ask(arguments.cores)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    rows: list[dict[str, Any]] = []
    for load in loads:
        for rate in rates:
            with _busy(load == "with"):
                rows += _measured(rate, load, places, arguments)
    return rows


def _rate(word: str) -> float:
    if not word.strip().isdecimal() or not 1 <= int(word) <= 10_000:
        raise InputError("--rates", repr(word), "whole numbers of 1/s from 1 to 10000")
    return float(word)


def _chosen(option: str, text: str, known: dict[str, str]) -> list[str]:
    words = text.split(",")
    for word in words:
        if word not in known:
            raise InputError(option, repr(word), f"some of {','.join(known)}")
    return words


def _measured(rate: float, load: str, places: Sequence[str], arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """The rows of one rate and load. The bare pair is the same for every place."""
    heard: dict[str, list[Heard]] = {kind: [] for kind in ("pair", *places)}
    for _ in range(arguments.turns):
        for kind, some in heard.items():
            some.append(_turn(kind, rate, arguments.seconds / arguments.turns, float(arguments.warm_up)))
    pair = Together.of(heard["pair"])
    granted = heard["pair"][0].memory[0].scheduling or "ordinary"
    rows: list[dict[str, Any]] = [{"name": f"{rate:.0f} Hz, {LOADS[load]}: scheduling", "value": granted}]
    for place in places:
        rows += _rows(f"{rate:.0f} Hz, {PLACES[place]}, {LOADS[load]}", Together.of(heard[place]), pair)
    return rows


# What is measured


@dataclass
class Memory:
    """One process, looked at now and then: steady time (s), resident memory (B), blocks that Python has allocated.

    scheduling: what it was granted and refused of real time, "" for nothing asked.
    """

    name: str
    scheduling: str = ""
    at: array[float] = field(default_factory=lambda: array("d"))
    resident: array[float] = field(default_factory=lambda: array("d"))
    blocks: array[float] = field(default_factory=lambda: array("d"))

    def look(self) -> None:
        """One more sample."""
        self.at.append(time.monotonic())
        self.resident.append(float(Path("/proc/self/statm").read_text().split()[1]) * PAGE)
        self.blocks.append(float(sys.getallocatedblocks()))


@dataclass(frozen=True)
class Heard:
    """One turn: steady times (s) at which states were said and answers heard, NaN for none, (n,); memory of the processes."""

    said: Array
    heard: Array
    memory: tuple[Memory, ...]


@dataclass(frozen=True)
class Together:
    """All turns of one kind: latency and jitter in ms, share of states without an answer, growth per minute with its error."""

    latency: Array
    jitter: Array
    misses: float
    resident: tuple[float, float]  # kB/min
    blocks: tuple[float, float]  # 1/min

    @classmethod
    def of(cls, turns: Sequence[Heard]) -> Together:
        """Raises JobError where too many states had no answer."""
        latency = np.concatenate([turn.heard - turn.said for turn in turns])
        gaps = np.concatenate([np.abs(np.diff(turn.heard) - np.median(np.diff(turn.said))) for turn in turns])
        misses = float(np.mean(np.isnan(latency)))
        if misses > MISSES:
            raise JobError("bench realtime", f"{100.0 * misses:.1f} % of the states had no answer", "a machine that keeps up")
        memories = [memory for turn in turns for memory in turn.memory]
        return cls(
            1e3 * latency[~np.isnan(latency)],
            1e3 * gaps[~np.isnan(gaps)],
            misses,
            growth([(memory.at, memory.resident) for memory in memories], 60.0 / 1024.0),
            growth([(memory.at, memory.blocks) for memory in memories], 60.0),
        )


def growth(series: Sequence[tuple[Sequence[float], Sequence[float]]], scale: float) -> tuple[float, float]:
    """The steepest of some series (times, values), its slope times `scale`, with the standard error of that.

    Only the second half of each counts: what Python keeps for the next object of its kind has to fill first. The error is that of
    a sum of independent steps. NaN for series of less than six samples.
    """
    found = []
    for times, values in series:
        half = len(times) // 2
        t, x = np.array(times[half:]), np.array(values[half:])
        if len(t) >= 3:
            span, steps = float(t[-1] - t[0]), np.diff(x)
            found.append((scale * float(steps.sum()) / span, scale * float(np.std(steps, ddof=1)) * len(steps) ** 0.5 / span))
    return max(found, default=(float("nan"), float("nan")))


def _rows(name: str, ours: Together, pair: Together) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for quantity, own, other in (("latency", ours.latency, pair.latency), ("jitter", ours.jitter, pair.jitter)):
        for what, share in (("median", 50.0), ("99.9 %", 99.9), ("worst", 100.0)):
            value, beside = float(np.percentile(own, share)), float(np.percentile(other, share))
            row = {"name": f"{name}: {quantity}, {what}", "value": value, "unit": "ms", "beside": beside}
            rows.append(row | {"ratio": value / beside})
    rows.append({"name": f"{name}: states without an answer", "value": ours.misses, "unit": "1", "beside": pair.misses})
    grown = (("memory", "kB/min", ours.resident, pair.resident), ("allocated blocks", "1/min", ours.blocks, pair.blocks))
    for what, unit, (value, error), (beside, _) in grown:
        if not np.isnan(value + beside):  # else the turns were too short to tell
            rows.append({"name": f"{name}: growth of {what}", "value": value, "error": error, "unit": unit, "beside": beside})
    return rows


# Processes


@contextlib.contextmanager
def _busy(wanted: bool) -> Iterator[None]:
    """With a process for each core that computes without end, where it is wanted."""
    context = multiprocessing.get_context("spawn")
    cores = len(os.sched_getaffinity(0))
    processes = [context.Process(target=_compute, daemon=True) for _ in range(cores if wanted else 0)]
    with _started(processes):
        yield


def _compute() -> None:
    while True:
        pass


@contextlib.contextmanager
def _started(processes: Sequence[BaseProcess]) -> Iterator[None]:
    for process in processes:
        with deaf():
            process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _turn(kind: str, rate: float, seconds: float, warm_up: float) -> Heard:
    """One run, in fresh processes."""
    from tcs_friction.nodes.graph import LOOP

    context = multiprocessing.get_context("spawn")
    loop = tuple(name for name in LOOP if name != "plant")
    apart = [(name,) for name in loop]
    groups: dict[str, Sequence[Sequence[str]]] = {"pair": [PAIR], "one": [loop], "several": apart}
    over = context.Event()
    ends = [context.Pipe(duplex=False) for _ in range(len(groups[kind]) + 1)]
    processes: list[BaseProcess] = [context.Process(target=_drive, args=(rate, seconds, warm_up, ends[-1][1]), daemon=True)]
    for group, (_, send) in zip(groups[kind], ends, strict=False):
        processes.append(context.Process(target=_answer, args=(group, rate, warm_up, over, send), daemon=True))
    with _started(processes):
        said, heard = _received(ends[-1][0], warm_up + seconds + BEGIN_LIMIT, kind)
        over.set()
        memory = tuple(_received(end[0], 10.0, kind) for end in ends[:-1])
    return Heard(said, heard, memory)


def _received(end: Connection, limit: float, kind: str) -> Any:
    if not end.poll(limit):
        raise JobError("bench realtime", f"{kind}: no result within {limit:.0f} s", "ROS and an idle domain")
    return end.recv()


def _answer(names: Sequence[str], rate: float, warm_up: float, over: Any, result: Connection) -> None:
    """In a process of its own: nodes that answer, until it is over; then what memory they took."""
    import rclpy
    from rclpy.task import Future

    from tcs_friction.nodes.core import scheduling
    from tcs_friction.nodes.core.executor import make_executor, spin
    from tcs_friction.nodes.core.steady import steady_timer
    from tcs_friction.nodes.graph import arguments_for, factory

    granted = scheduling.prepare()
    words = ["-p", "clock:=real_time", "-p", f"period:={1.0 / rate!r}", "-p", "switch1:=true", "-p", "switch3:=true"]
    arguments = arguments_for("azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml", [*words, "--log-level", "error"])
    rclpy.init(args=["bench", *arguments])
    executor = make_executor()
    nodes = [_pair() if name == "pair" else factory(name)() for name in names]
    for node in nodes:
        executor.add_node(node)
    memory, done = Memory(" ".join(names), granted), Future()
    started = time.monotonic()

    def look() -> None:
        if over.is_set() and not done.done():
            done.set_result(None)
        elif time.monotonic() - started > warm_up:
            memory.look()

    steady_timer(nodes[0], SAMPLE, look)
    scheduling.keep_memory_tidy(nodes[0])
    spin(executor, done)
    result.send(memory)
    os._exit(0)  # without a farewell to the others




def _pair() -> Any:
    """The bare subscriber and publisher: answers a state with a command of the same stamp, computing nothing."""
    import rclpy
    from sensor_msgs.msg import JointState
    from tcs_friction_msgs.msg import AxisTorque

    from tcs_friction.nodes.core.qos import LISTEN, PUBLISH_IN_REAL_TIME
    from tcs_friction.nodes.core.wire import TORQUE, JointWire

    node = rclpy.create_node("pair", namespace="azimuth")
    publisher, wire = node.create_publisher(AxisTorque, "torque_command", PUBLISH_IN_REAL_TIME), JointWire("azimuth")
    node.create_subscription(
        JointState, "joint_states", lambda data: publisher.publish(TORQUE.write(wire.read(data)[0], 0.0)), LISTEN, raw=True
    )
    return node


class Driver:
    """Says where an axis at rest is, once a period, and keeps the moments at which it said so and was answered."""

    def __init__(self, rate: float, seconds: float, warm_up: float) -> None:
        import rclpy
        from rclpy.task import Future
        from sensor_msgs.msg import JointState
        from tcs_friction_msgs.msg import AxisTorque

        from tcs_friction.nodes.core.qos import LISTEN, PUBLISH_IN_REAL_TIME
        from tcs_friction.nodes.core.steady import steady_timer
        from tcs_friction.nodes.core.wire import JointWire

        self.node = rclpy.create_node("driver", namespace="azimuth")
        self.done = Future()
        self._wire, self._count = JointWire("azimuth"), round(rate * seconds)
        self._warm_up, self._after = round(rate * warm_up), round(rate * LISTEN_ON)
        self._numbers: dict[int, int] = {}  # of states by stamp, of those that count
        self._said, self._heard = array("d", bytes(8 * self._count)), array("d", [float("nan")]) * self._count
        self._ticks = -1  # -1: nobody has answered yet
        self._publisher = self.node.create_publisher(JointState, "joint_states", PUBLISH_IN_REAL_TIME)
        self.node.create_subscription(AxisTorque, "torque_command", self._on_command, LISTEN, raw=True)
        self._timer = steady_timer(self.node, 1.0 / rate, self._on_timer)

    def _on_timer(self) -> None:
        stamp = time.time_ns()
        state = self._wire.write(stamp, 0.0, 0.0, 0.0)
        number = self._ticks - self._warm_up
        if self._ticks >= 0:
            self._ticks += 1
        if 0 <= number < self._count:
            self._numbers[stamp] = number
            self._said[number] = time.perf_counter()
        elif number >= self._count + self._after and not self.done.done():
            self.done.set_result(None)
        self._publisher.publish(state)

    def _on_command(self, data: bytes) -> None:
        from tcs_friction.nodes.core.wire import TORQUE

        now = time.perf_counter()
        if self._ticks < 0:
            self._ticks = 0
        number = self._numbers.pop(TORQUE.read(data)[0], None)
        if number is not None:
            self._heard[number] = now

    def result(self) -> tuple[Array, Array]:
        """When each state was said and answered, steady time in s."""
        return np.array(self._said), np.array(self._heard)


def _drive(rate: float, seconds: float, warm_up: float, result: Connection) -> None:
    """In a process of its own: the driver."""
    import rclpy

    from tcs_friction.nodes.core import scheduling
    from tcs_friction.nodes.core.executor import make_executor, spin

    scheduling.prepare()
    rclpy.init(args=["bench"])
    executor = make_executor()
    driver = Driver(rate, seconds, warm_up)
    executor.add_node(driver.node)
    scheduling.keep_memory_tidy(driver.node)
    spin(executor, driver.done)
    result.send(driver.result())
    os._exit(0)
