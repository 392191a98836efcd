"""What benchmarks of drivers share: the demo's loop in real time beside a driver that takes the plant's place, in processes.

The driver has a process of its own, with its drive or beside it, and so has the loop; the commissioning is the benchmark's own.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from benchmarks.children import deaf
from tcs_friction.errors import JobError

AXIS, RUN = "azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml"
LOOP = ("controller", "reference", "dob", "lugre_compensator", "identifier")
TUNING = {
    "position_proportional": 12.0,
    "velocity_proportional": 6e4,
    "velocity_integral": 6e5,
    "bandwidth": 6.0,
    "age_limit": 0.3,
    "watchdog": 0.3,
    "state_limit": 0.3,
    "settle": 2.0,
    "diagnoses": 0,
    "simulated": False,
    "run_until": 0.0,
}
"""Gains for a period of 4 to 5 ms and one more until a torque acts, and times for a machine that others use too."""

Driver = Callable[[Sequence[str], Any, Connection], None]
"""Runs the driver in a process of its own until an event is set; then sends what it has to tell."""


def commissioned(
    title: str, driver: Driver, period: float, directory: Path, others: Sequence[BaseProcess] = (), **changes: Any
) -> tuple[Any, Any]:
    """The outcome of a commissioning whose results go to `directory`, and what the driver told at its end.

    others: processes to be started before the driver. changes: other settings of the nodes than TUNING. Raises JobError when a
    process ends by itself, KeyboardInterrupt when interrupted.
    """
    arguments = settings(period, directory, **changes)
    context = multiprocessing.get_context("spawn")
    ends, over = context.Pipe(duplex=False), context.Event()
    processes: list[BaseProcess] = [
        *others,
        context.Process(target=driver, args=(arguments, over, ends[1]), name="driver", daemon=True),
        context.Process(target=_loop, args=(arguments,), name="loop", daemon=True),
    ]
    try:
        for process in processes:
            with deaf():
                process.start()
        outcome = commission(title, arguments, directory, {process.name: process for process in processes})
        over.set()
        if not ends[0].poll(20.0):
            raise JobError(f"bench {title}", "the driver does not tell what it has seen", "its counts")
        return outcome, ends[0].recv()
    finally:
        for process in processes:
            if process.pid is not None:
                process.kill()
                process.join()


def settings(period: float, directory: Path, **changes: Any) -> list[str]:
    """ROS arguments of every node."""
    from tcs_friction.nodes.graph import arguments_for

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    values = TUNING | {"clock": "real_time", "period": period, "results": directory.parent} | changes
    return arguments_for(AXIS, RUN, [*words(values), "--log-level", "warn"])


def words(values: Mapping[str, Any]) -> list[str]:
    """Parameters as ROS arguments."""
    shown = {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in values.items()}
    return [word for name, value in shown.items() for word in ("-p", f"{name}:={value}")]


def _loop(arguments: Sequence[str]) -> None:
    """In a process of its own: all other nodes."""
    from tcs_friction.nodes.graph import run_together

    run_together({"": arguments}, LOOP)


def commission(
    title: str,
    arguments: Sequence[str],
    directory: Path,
    children: Mapping[str, BaseProcess],
    begin: Callable[[Any], None] = lambda _node: None,
) -> Any:
    """The action commission of a graph elsewhere; its outcome. begin: is given the node before it runs."""
    import rclpy
    from rclpy.task import Future

    from tcs_friction.nodes.commissioning.commission import Commission
    from tcs_friction.nodes.core.executor import close, make_executor, spin
    from tcs_friction.nodes.own_graph import drive_action

    rclpy.init(args=["bench", *arguments])
    executor, node, done = make_executor(), Commission(), Future()
    executor.add_node(node)
    begin(node)
    said: list[str] = []

    def tell(_share: float, stage: str) -> None:
        if stage not in said and sys.stderr.isatty():
            said.append(stage)
            print(f"{title}: {stage} ...", file=sys.stderr, flush=True)

    executor.create_task(drive_action(node, directory, children, tell, done))
    try:
        spin(executor, done)
    finally:
        close(executor, [node])
    if not done.done():
        raise KeyboardInterrupt
    if done.exception() is not None:
        raise done.exception()
    return node.outcome


def run_driver(make: Callable[[], Any], arguments: Sequence[str], over: Any, told: Callable[[Any], None]) -> None:
    """In the driver's process: its node until the event is set, then `told` with the node, which ends afterwards."""
    import rclpy
    from rclpy.task import Future

    from tcs_friction.nodes.core.executor import close, make_executor, spin
    from tcs_friction.nodes.core.steady import steady_timer

    rclpy.init(args=["driver", *arguments])
    executor, node, done = make_executor(), make(), Future()
    executor.add_node(node)
    steady_timer(node, 0.2, lambda: done.set_result(None) if over.is_set() and not done.done() else None)
    spin(executor, done)
    told(node)
    close(executor, [node])


def row(name: str, value: float, unit: str = "") -> dict[str, Any]:
    """A row of the benchmark's table."""
    return {"name": name, "value": value, "unit": unit, "beside": "", "ratio": None}


def tracking_rows(outcome: Any) -> list[dict[str, Any]]:
    """What the commissioning came to."""
    measured = outcome.to_mapping()
    return [
        row("tracking error without compensation", measured["before"]["rms"], "arcsec rms"),
        row("tracking error with compensation", measured["after"]["rms"], "arcsec rms"),
        row("coulomb identified, 78.1 is true", outcome.identified["coulomb"], "N m"),
    ]
