"""Ticks per second of the full lock-step graph (plant, reference, dob, compensator, controller) beside a bare chain of nodes.

The bare chain passes the same messages over the same hops and computes nothing: as ordinary nodes with typed messages, and as
nodes that only pass bytes on. Both ways: all nodes in one process on one executor, and one process each. The graph that cancels
five effects of an axis model stands beside the one that cancels none. Every row is the median of several runs, ours and the
others' in turn, so that a busy machine slows all.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks.children import deaf
from tcs_friction.commands.parser import positive
from tcs_friction.config import load_axis, save_axis, shipped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

LOOP = ("plant", "reference", "dob", "lugre_compensator", "controller")
KINDS = ("graph", "model", "typed", "serialised")
OURS = ("graph", "model")
FIVE: tuple[tuple[str, dict[str, float]], ...] = (
    ("cogging", {"order": 72.0, "amplitude": 0.5}),
    ("imbalance", {"amplitude": 2.0}),
    ("coulomb_asymmetry", {"asymmetry": 0.01}),
    ("torque_ripple", {"order": 24.0, "amplitude": 0.02}),
    ("encoder_periodic_error", {"order": 3000.0, "amplitude": 1e-8}),
)
WARM_UP = 500  # ticks


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--ticks", type=positive, default=20_000, help="of each run in one process (default %(default)s)")
    parser.add_argument("--repeat", type=positive, default=3, help="runs of each kind (default %(default)s)")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure everything."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with tempfile.TemporaryDirectory(prefix="tcs_friction-bench-") as folder:
        return _measured(arguments, _five_effects(Path(folder)))


def _measured(arguments: argparse.Namespace, model: Path) -> list[dict[str, Any]]:
    """Every row; `model`: the axis file whose effects are cancelled."""
    results: list[dict[str, Any]] = []
    for together, where, ticks in ((True, "one process", arguments.ticks), (False, "five processes", arguments.ticks // 4)):
        rates: dict[str, list[float]] = {kind: [] for kind in KINDS}
        for _ in range(arguments.repeat):
            for kind in KINDS:
                rates[kind].append(_rate(kind, together, ticks, model))
        ours = statistics.median(rates["graph"])
        for kind, what in (("typed", "a bare chain of nodes"), ("serialised", "a bare chain that passes bytes")):
            beside = statistics.median(rates[kind])
            results.append(
                {"name": f"{where}, beside {what}", "value": ours, "unit": "ticks/s", "beside": beside, "ratio": ours / beside}
            )
        cancelling = statistics.median(rates["model"])
        name = f"{where}, five effects cancelled, beside none"
        results.append({"name": name, "value": cancelling, "unit": "ticks/s", "beside": ours, "ratio": cancelling / ours})
    return results


def _rate(kind: str, together: bool, ticks: int, model: Path) -> float:
    """Ticks per second of one run, in fresh processes."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    groups: list[Sequence[str]] = [LOOP] if together else [("plant",), *((name,) for name in LOOP[1:])]
    processes = [context.Process(target=_measure, args=(kind, group, ticks, model, send), daemon=True) for group in groups]
    for process in reversed(processes):  # the plant last, when the others are on their way
        with deaf():
            process.start()
    try:
        if not receive.poll(120.0):
            raise TimeoutError(f"the {kind} graph did not finish {ticks} ticks in 120 s")
        return float(receive.recv())
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _measure(kind: str, names: Sequence[str], ticks: int, model: Path, result: Connection) -> None:
    """In a process of its own: run some nodes; the one with the plant sends the rate."""
    import rclpy

    from tcs_friction.nodes.core.executor import make_executor, spin

    rclpy.init(args=["bench", *_ros_arguments(kind, model)])
    executor = make_executor()
    nodes = [_factory(kind, name)() for name in names]
    for node in nodes:
        executor.add_node(node)
    gc.collect()
    gc.freeze()
    if "plant" not in names:
        spin(executor)
        sys.exit(0)
    rate = _timed(kind, nodes[0], executor, ticks, spin)
    result.send(rate)
    os._exit(0)  # without a farewell to the nodes that are still waiting


def _ros_arguments(kind: str, model: Path) -> list[str]:
    if kind not in OURS:
        return []
    from tcs_friction.nodes.graph import arguments_for

    switches = ["-p", "switch1:=true", "-p", "switch3:=true", "-p", "time_limit:=60.0"]
    if kind == "model":
        switches += ["-p", f"model:={model}"]
    return arguments_for("azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml", switches)


def _five_effects(folder: Path) -> Path:
    """An axis file of the telescope with five effects."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    items = tuple(instance(effect(name), values) for name, values in FIVE)
    path = folder / "model.yaml"
    save_axis(path, file.with_axis(replace(file.axis, effects=items)))
    return path


def _factory(kind: str, name: str) -> Callable[[], Any]:
    if kind in OURS:
        from tcs_friction.nodes.graph import factory

        return factory(name)
    from benchmarks.bare_chain import bare

    return bare(name, kind == "serialised")


def _timed(kind: str, plant: Any, executor: Any, ticks: int, spin: Callable[..., None]) -> float:
    """Rate of the plant's ticks after a warm-up."""
    from rclpy.task import Future

    marks: list[float] = []
    done = Future()
    if kind in OURS:
        advance = plant._advance

        def counted(torque: float) -> None:
            advance(torque)
            _mark(plant.health.ticks, ticks, marks, done)

        plant._advance = counted
    else:
        hand_on = plant.publish

        def publish() -> None:
            hand_on()
            _mark(plant.ticks, ticks, marks, done)

        plant.publish = publish
        _start(plant)
    spin(executor, done)
    return ticks / (marks[1] - marks[0])


def _mark(now: int, ticks: int, marks: list[float], done: Any) -> None:
    if now == WARM_UP or now == WARM_UP + ticks:
        marks.append(time.perf_counter())
        if len(marks) == 2:
            done.set_result(None)


def _start(plant: Any) -> None:
    """Give the chain its first message once everybody listens, which may take a while."""
    deadline = time.monotonic() + 60.0
    while plant._publisher.get_subscription_count() < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)
    plant.publish()
