"""The whole graph: all nodes on one executor, or one process each."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.node import Node

from tcs_friction.control.reference import load_reference
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.base import DEFAULT_AXIS, config_file
from tcs_friction.nodes.executor import run
from tcs_friction.physics.terms import nearest

CLASSES = {
    "plant": "Plant",
    "reference": "ReferenceNode",
    "dob": "Dob",
    "lugre_compensator": "LugreCompensatorNode",
    "controller": "Controller",
    "identifier": "Identifier",
    "diagnoser": "Diagnoser",
    "commission": "Commission",
}
LOOP = ("plant", "reference", "dob", "lugre_compensator", "controller")
GRAPH = tuple(CLASSES)
OTHERS = ("recorder", "player", "dynamometer")
PATIENCE = 5.0  # s that a process gets to end after the first signal


def node_names() -> tuple[str, ...]:
    """Every node that can be run by name."""
    return (*GRAPH, *OTHERS)


def factory(name: str) -> Callable[[], Node]:
    """The class of a node of the graph; its module is imported now."""
    module = importlib.import_module(f"tcs_friction.nodes.{name}")
    made: Callable[[], Node] = getattr(module, CLASSES[name])
    return made


def run_node(name: str, ros_arguments: Sequence[str] = ()) -> int:
    """Run one node until a signal; returns the exit status."""
    if name not in node_names():
        raise InputError(f"node {name!r}", "no such node", nearest(name, list(node_names())))
    main = importlib.import_module(f"tcs_friction.nodes.{name}").main
    return int(main([name, *ros_arguments]) or 0)


def arguments_for(axis: str = DEFAULT_AXIS, reference: str = "", ros_arguments: Sequence[str] = ()) -> list[str]:
    """ROS arguments that point every node to the same axis and reference; the user's own come last and win.

    They apply to all nodes; a node that has no such parameter does not mind.
    """
    chosen = ["--ros-args", "-p", f"axis:={config_file(axis)}"]
    if reference:
        path = config_file(reference)
        start = load_reference(Path(path)).at(0.0)[0]
        chosen += ["-p", f"reference_file:={path}", "-p", f"start_position:={start!r}"]
    return [*chosen, *(argument for argument in ros_arguments if argument != "--ros-args")]


def run_together(arguments: Sequence[str], names: Sequence[str] = GRAPH) -> int:
    """All nodes in this process on one executor, until a signal."""
    return run(*(factory(name) for name in names), args=["graph", *arguments])


def start_processes(arguments: Sequence[str], names: Sequence[str] = GRAPH) -> dict[str, subprocess.Popen[bytes]]:
    """One process for each node, started; to be ended with `end_processes`."""
    return {
        name: subprocess.Popen([sys.executable, "-P", "-m", f"tcs_friction.nodes.{name}", *arguments]) for name in names
    }


def end_processes(processes: dict[str, subprocess.Popen[bytes]]) -> None:
    """Ask every process to end, and kill those that do not within PATIENCE seconds."""
    for process in processes.values():
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + PATIENCE
    for process in processes.values():
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def run_processes(arguments: Sequence[str], names: Sequence[str] = GRAPH) -> int:
    """One process each until a signal. When one ends by itself all are ended; raises JobError naming it."""
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stop.append(number))
    processes = start_processes(arguments, names)
    try:
        while not stop:
            for name, process in processes.items():
                status = process.poll()
                if status is not None and not stop:
                    raise JobError(f"node {name}", _ending(status), "it to run; the other nodes have been ended")
            time.sleep(0.1)
    finally:
        end_processes(processes)
    return 0


def _ending(status: int) -> str:
    return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"


def discovery_on_this_machine() -> None:
    """Keep a graph that this program starts, and ends, to this machine unless the user has decided otherwise."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
