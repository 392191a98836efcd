"""Fixtures of the tests that need ROS: a private domain, nodes on one executor, nodes in processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from nursery import ROOT, Child, Nursery

import tcs_friction.nodes  # noqa: F401 - says how messages travel, before anything of ROS is made
from benchmarks.listening import Listening, Report, wait_until

__all__ = ["ROOT", "short_runs", "wait_until"]


@pytest.fixture(autouse=True)
def domain(ros_domain: None) -> None:
    """Every test here."""


class Together:
    """Nodes of the graph on one executor in this process; those of several axes by `/namespace/name`."""

    def __init__(self, arguments: Sequence[str], names: Sequence[str], axes: Sequence[str]) -> None:
        import rclpy

        from tcs_friction.nodes.axes import arguments_by_axis
        from tcs_friction.nodes.core.arguments import made_with
        from tcs_friction.nodes.core.executor import make_executor
        from tcs_friction.nodes.graph import factory

        by_axis = arguments_by_axis(axes, (), arguments)
        rclpy.init(args=["test", *next(iter(by_axis.values()))])
        self.executor = make_executor()
        self.nodes: dict[str, Any] = {}
        for space, own in by_axis.items():
            for name in names:
                self.nodes[f"{space}/{name}" if space else name] = made_with(factory(name), own)
        for node in self.nodes.values():
            self.executor.add_node(node)
        self.driver = rclpy.create_node("driver", namespace="azimuth")
        self.executor.add_node(self.driver)

    def __getitem__(self, name: str) -> Any:
        return self.nodes[name]

    def until(self, ready: Callable[[], bool], limit: float = 60.0) -> bool:
        """Spin until a condition holds; whether it did within the limit (s)."""
        from rclpy.task import Future

        from tcs_friction.nodes.core.executor import spin

        done, deadline = Future(), time.monotonic() + limit

        def look() -> None:
            if not done.done() and (ready() or time.monotonic() > deadline):
                done.set_result(None)

        timer = self.driver.create_timer(0.02, look)
        spin(self.executor, done)
        self.driver.destroy_timer(timer)
        return ready()

    def for_seconds(self, seconds: float) -> None:
        """Spin for a while."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)

    def result(self, coroutine: Any, limit: float = 60.0) -> Any:
        """Run a coroutine on the executor and return what it returns."""
        from rclpy.task import Future

        done = Future()

        async def work() -> None:
            try:
                done.set_result(await coroutine)
            except Exception as error:
                done.set_exception(error)

        self.executor.create_task(work)
        assert self.until(done.done, limit), "the coroutine did not finish in time"
        if done.exception() is not None:
            raise done.exception()
        return done.result()

    def close(self) -> None:
        from tcs_friction.nodes.core.executor import close

        close(self.executor, [*self.nodes.values(), self.driver])


@pytest.fixture
def together() -> Iterator[Callable[..., Together]]:
    """Makes a graph in this process: `together("-p", "seed:=1", nodes=LOOP)`; once a test."""
    import rclpy

    made: list[Together] = []

    def make(*arguments: str, nodes: Sequence[str] = (), axes: Sequence[str] = ("azimuth_1p2m.yaml",)) -> Together:
        from tcs_friction.nodes.graph import LOOP

        try:
            made.append(Together(arguments, nodes or LOOP, axes))
        except Exception:
            rclpy.try_shutdown()
            raise
        return made[0]

    yield make
    for graph in made:
        graph.close()


def short_runs(folder: Path) -> tuple[Path, Path]:
    """References of a few seconds: one to be tracked, with a reversal each way, and one on which friction is measured."""
    run, measure = folder / "run.yaml", folder / "measure.yaml"
    run.write_text("reference: {kind: legs, speed: 1.7453293e-3, leg: 0.7, acceleration: 5.0e-3, duration: 4.5}\n")
    measure.write_text("reference: {kind: sinusoid, amplitude: 1.5e-3, period: 4.0, duration: 5.0}\n")
    return run, measure


class Processes:
    """Nodes as a user starts them by hand, each a real process."""

    def __init__(self, folder: Path, nursery: Nursery) -> None:
        self._folder = folder
        self._nursery = nursery
        self._processes: dict[str, Child] = {}

    def start(self, name: str, *arguments: str, label: str = "") -> None:
        """Start a node; a second one of the same name needs a label."""
        label = label or name
        self._run(label, "node", name, "--ros-args", *arguments)

    def start_graph(self, *arguments: str, options: Sequence[str] = (), one: bool = False) -> None:
        """Start the whole graph, a process for each node, all of them forked from one; or in `one`."""
        self._run("graph", "graph", *([] if one else ["--processes"]), *options, "--ros-args", *arguments)

    def start_ros(self, *words: str) -> None:
        """`./tcs ros` with these words."""
        self._run("ros", "ros", *words)

    def _run(self, label: str, *words: str) -> None:
        log = self._folder / f"{label}.log"
        log.touch()  # it is read before the process has opened it
        self._processes[label] = self._nursery.start(words, log)

    def kill(self, name: str) -> None:
        """The hard way."""
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes.pop(name).wait()

    def kill_graph(self) -> None:
        """All processes of `start_graph` at one stroke, as when the power fails."""
        process = self._processes.pop("graph")
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def suspend(self, name: str) -> None:
        """Stop it where it is, as a debugger or a machine without memory does."""
        self._processes[name].send_signal(signal.SIGSTOP)

    def resume(self, name: str) -> None:
        """Let it go on."""
        self._processes[name].send_signal(signal.SIGCONT)

    def interrupt(self, name: str) -> int:
        """As Ctrl-C does; the exit status."""
        self._processes[name].send_signal(signal.SIGINT)
        return self._processes.pop(name).wait(20.0)

    def alive(self, name: str) -> bool:
        return self._processes[name].poll() is None

    def log(self, name: str) -> str:
        return (self._folder / f"{name}.log").read_text()

    def close(self) -> None:
        for process in self._processes.values():
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGTERM)
        for process in self._processes.values():
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()


@pytest.fixture(scope="session")
def nursery() -> Iterator[Nursery]:
    """What processes of nodes are forked from."""
    made = Nursery()
    yield made
    made.close()


@pytest.fixture
def processes(tmp_path: Path, nursery: Nursery) -> Iterator[Processes]:
    """Starts and kills nodes in processes of their own; the rest is ended afterwards."""
    made = Processes(tmp_path, nursery)
    yield made
    made.close()


class Listener(Listening):
    """Hears joint states and diagnostics of a graph elsewhere."""

    def __init__(self) -> None:
        from sensor_msgs.msg import JointState

        from tcs_friction.nodes.core.qos import COLLECT
        from tcs_friction.nodes.core.wire import JointWire

        self.states: list[tuple[float, ...]] = []
        self.health: dict[str, tuple[int, str]] = {}
        self._wire = JointWire("azimuth")
        super().__init__("listener")
        self.node.create_subscription(JointState, "joint_states", self._on_state, COLLECT, raw=True)
        self.hear_reports(self._on_report)
        self.begin()

    def _on_state(self, data: bytes) -> None:
        state = self._wire.read(data)
        if not self.states or state[0] != self.states[-1][0]:
            self.states.append(state)

    def _on_report(self, name: str, report: Report) -> None:
        self.health[name] = (report.level, report.message)


@pytest.fixture
def listener() -> Iterator[Listener]:
    """A pair of ears on the graph of this test."""
    made = Listener()
    yield made
    made.close()


class Caller:
    """A node that calls the nodes of a graph elsewhere; spun by the test."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        rclpy.init(args=["caller"])
        self.driver = rclpy.create_node("caller", namespace="azimuth")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.driver)

    def until(self, ready: Callable[[], bool], limit: float = 30.0) -> bool:
        """Spin until a condition holds; whether it did within the limit (s)."""
        deadline = time.monotonic() + limit
        while not ready() and time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.05)
        return ready()

    def call(self, kind: Any, name: str, request: Any, limit: float = 60.0) -> Any:
        """The answer of a service, None when there is none in time."""
        client = self.driver.create_client(kind, name)
        if not self.until(client.service_is_ready, limit):
            return None
        future = client.call_async(request)
        self.until(future.done, limit)
        return future.result() if future.done() else None

    def parameters(self, node: str, names: list[str]) -> dict[str, Any]:
        """Values of a node's parameters."""
        from rcl_interfaces.srv import GetParameters
        from rclpy.parameter import parameter_value_to_python

        answer = self.call(GetParameters, f"{node}/get_parameters", GetParameters.Request(names=names))
        return dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))

    def positions(self, seconds: float) -> list[float]:
        """Where the axis is during the next seconds."""
        from sensor_msgs.msg import JointState

        heard: list[float] = []
        self.driver.create_subscription(JointState, "joint_states", lambda m: heard.append(m.position[0]), 100)
        self.until(lambda: bool(heard))
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end, seconds + 1.0)
        return heard

    def close(self) -> None:
        import rclpy

        self.driver.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def caller() -> Iterator[Caller]:
    """Calls services and actions of the graph of this test."""
    made = Caller()
    yield made
    made.close()
