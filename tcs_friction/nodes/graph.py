"""The whole graph: all nodes on one executor, or one process each."""

from __future__ import annotations

import ctypes
import functools
import importlib
import multiprocessing
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

from rclpy.node import Node

from tcs_friction.control.reference import load_reference
from tcs_friction.errors import InputError, JobError, nearest
from tcs_friction.nodes.core.arguments import made_with
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import DEFAULT_AXIS, config_file
from tcs_friction.physics.registry import effects

CLASSES = {
    "plant": "Plant",
    "controller": "Controller",
    "reference": "ReferenceNode",
    "dob": "Dob",
    "lugre_compensator": "LugreCompensatorNode",
    "identifier": "Identifier",
    "diagnoser": "Diagnoser",
    "commission": "Commission",
}
BESIDE = {"monitor": "Monitor"}
"""Nodes of an axis that are not part of its graph unless they are asked for."""
DRIVERS = {"canopen_drive": "CanopenDrive", "ros2_control_driver": "Ros2ControlDriver"}
"""Nodes for real drives."""
PLANTS = {"mujoco_plant": "MujocoPlant", **DRIVERS}
"""Nodes that take the place, and the name, of the plant."""
FOLDERS = {
    "analysis": ("identifier", "diagnoser", "monitor"),
    "bags": ("recorder", "player"),
    "commissioning": ("commission",),
    "drivers": ("dynamometer", *DRIVERS),
}
"""Where nodes are that are not in the folder `loop`."""
LOOP = ("plant", "controller", "reference", "dob", "lugre_compensator")
"""On one executor the node made first hears first: in real time the controller answers a state before others work on it."""
GRAPH = tuple(CLASSES)
OTHERS = (*BESIDE, "recorder", "player", "dynamometer", *PLANTS)
_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
PATIENCE = 5.0  # s that a process gets to end after the first signal


def node_names() -> tuple[str, ...]:
    """Every node that can be run by name."""
    return (*GRAPH, *OTHERS)


def module_of(name: str) -> str:
    """The module in which a node is."""
    folder = next((folder for folder, names in FOLDERS.items() if name in names), "loop")
    return f"tcs_friction.nodes.{folder}.{name}"


def factory(name: str) -> Callable[[], Node]:
    """The class of a node of the graph; its module is imported now."""
    module = importlib.import_module(module_of(name))
    made: Callable[[], Node] = getattr(module, (CLASSES | BESIDE | PLANTS)[name])
    return made


def run_node(name: str, ros_arguments: Sequence[str] = ()) -> int:
    """Run one node until a signal; returns the exit status."""
    if name not in node_names():
        raise InputError(f"node {name!r}", "no such node", nearest(name, list(node_names())))
    main = importlib.import_module(module_of(name)).main
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


def mujoco_arguments(model: str, joint: str = "") -> list[str]:
    """ROS arguments of a graph whose plant is a joint of a MuJoCo model, "" for the one that has the axis' name."""
    words = ["-p", f"mujoco_model:={config_file(model)}", "-p", "truth:=false"]
    return [*words, "-p", f"mujoco_joint:={joint}"] if joint else words


def run_together(axes: Mapping[str, Sequence[str]], names: Sequence[str] = GRAPH) -> int:
    """All nodes in this process on one executor, until a signal. axes: the arguments of each axis' nodes by namespace."""
    makers = [functools.partial(made_with, factory(name), own) for own in axes.values() for name in names]
    return run(*makers, args=["graph", *next(iter(axes.values()))])  # of the process; those of a node win


def start_processes(
    arguments: Sequence[str], names: Sequence[str] = GRAPH, namespace: str = ""
) -> dict[str, BaseProcess]:
    """One process for each node, started, by `namespace/name`; to be ended with `end_processes`.

    They are forked from this one, which has loaded everything that they need, so that the start costs two seconds and not two
    for every node. This process must not have initialised ROS before.
    """
    for name in names:
        importlib.import_module(module_of(name))
    effects()
    context = multiprocessing.get_context("fork")
    processes: dict[str, BaseProcess] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of fork beside the idle threads of the linear algebra
        for name in names:
            label = f"{namespace}/{name}" if namespace else name
            processes[label] = context.Process(target=_child, args=(name, tuple(arguments)), name=label)
            processes[label].start()
    return processes


def _child(name: str, arguments: Sequence[str]) -> None:
    """In the new process: the node, ended with its parent, under its own name in the list of processes (Linux)."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode())
    sys.exit(run_node(name, arguments))


def end_with_parent() -> None:
    """In a new process: it gets SIGTERM when the one that made it ends, however that ends (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def end_processes(processes: Mapping[str, BaseProcess]) -> None:
    """Ask every process to end, and kill those that do not within PATIENCE seconds."""
    for process in processes.values():
        if process.is_alive() and process.pid is not None:
            os.kill(process.pid, signal.SIGINT)
    deadline = time.monotonic() + PATIENCE
    for process in processes.values():
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()


def run_processes(axes: Mapping[str, Sequence[str]], names: Sequence[str] = GRAPH) -> int:
    """One process each until a signal. When one ends by itself all are ended; raises JobError naming it.

    axes: the arguments of each axis' nodes by namespace.
    """
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stop.append(number))
    processes: dict[str, BaseProcess] = {}
    try:
        for namespace, arguments in axes.items():
            processes |= start_processes(arguments, names, namespace)
        while not stop:
            for name, process in processes.items():
                status = process.exitcode
                if status is not None and not stop:
                    raise JobError(f"node {name}", ending(status), "it to run; the other nodes have been ended")
            time.sleep(0.1)
    finally:
        end_processes(processes)
    return 0


def ending(status: int) -> str:
    """What happened to a process, in words."""
    return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
