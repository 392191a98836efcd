"""The main job: a graph of its own, commissioned, and what was measured handed back."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level
from rclpy.task import Future
from tcs_friction_msgs.action import Commission as CommissionAction

from tcs_friction.errors import JobError
from tcs_friction.nodes import graph
from tcs_friction.nodes.commissioning.commission import Commission
from tcs_friction.nodes.core.executor import close, make_executor, spin
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.entry import keep_logs, stay_local
from tcs_friction.report.commission import CommissionResult

NODES = (*graph.LOOP, "identifier", "diagnoser")
"""Besides commission itself."""
SETTINGS = {
    "diagnose_file": "azimuth_geared_diagnose.yaml",
    "diagnoses": 1,
    "trials": 1,
    "listen": False,
    "run_until": 0.0,
    "time_limit": 60.0,  # s; identification and diagnosis are waited for
}
"""One round of diagnosis, of a bag, and one run for each way to compensate, so that it is over in two minutes."""


def own_domain() -> int:
    """A ROS domain that no other graph is likely to be on, on this machine only, unless the user has chosen one."""
    stay_local()
    return int(os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100)))


def commission(
    axis: str,
    reference: str,
    directory: Path,
    processes: bool = False,
    tell: Callable[[float, str], None] = lambda _share, _stage: None,
    seed: int = 0,
    mujoco: tuple[str, str] | None = None,
) -> CommissionResult:
    """Start the graph, run the action commission on it, end the graph.

    `directory` gets the bags, identification.json, axis.yaml, commission.json and report.html; `processes` gives every
    node a process of its own. `tell` hears the share of the work done and what is being done. mujoco: model and joint ("" for the
    one that has the axis' name) of a plant that is MuJoCo's. Raises JobError with the reason when a node dies or a step fails,
    KeyboardInterrupt when interrupted.
    """
    own_domain()
    keep_logs()
    tell(0.0, "starting the graph (a minute the first time: kernels are compiled)")
    directory = directory.resolve()
    settings = SETTINGS | {"results": directory.parent, "seed": seed}
    words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
    names = NODES if mujoco is None else ("mujoco_plant", *(name for name in NODES if name != "plant"))
    words += graph.mujoco_arguments(*mujoco) if mujoco else []
    arguments = graph.arguments_for(axis, reference, [*words, "--log-level", "warn"])
    children = graph.start_processes(arguments, names) if processes else {}
    with _ended(children):
        rclpy.init(args=["demo", *arguments])
        return _commissioned(() if processes else names, directory, children, tell)


def _commissioned(
    names: Sequence[str], directory: Path, children: Mapping[str, BaseProcess], tell: Callable[[float, str], None]
) -> CommissionResult:
    """The action's outcome, on nodes of this process and what runs in others."""
    executor = make_executor()
    together = [graph.factory(name)() for name in names]
    node, done = Commission(), Future()
    together.append(node)
    for item in together:
        executor.add_node(item)
    executor.create_task(drive_action(node, directory, children, tell, done))
    try:
        spin(executor, done)
    finally:
        close(executor, together)
    if not done.done():
        raise KeyboardInterrupt
    if done.exception() is not None:
        raise done.exception()
    assert node.outcome is not None
    return node.outcome


@contextlib.contextmanager
def _ended(children: Mapping[str, BaseProcess]) -> Iterator[None]:
    """ROS and the processes end with it; what is logged by default is the process' own again, rclpy would keep the demo's."""
    level = LoggingSeverity(get_logger_level(""))
    try:
        yield
    finally:
        rclpy.try_shutdown()
        set_logger_level("", level)
        graph.end_processes(children)


async def drive_action(
    node: Commission,
    directory: Path,
    children: Mapping[str, BaseProcess],
    tell: Callable[[float, str], None],
    done: Future,
) -> None:
    """Send the goal and wait for its end, with an eye on the processes."""
    try:
        done.set_result(await _action(node, Waiter(node), directory, children, tell))
    except BaseException as error:
        done.set_exception(error)


async def _action(
    node: Commission,
    waiter: Waiter,
    directory: Path,
    children: Mapping[str, BaseProcess],
    tell: Callable[[float, str], None],
) -> Any:
    client = ActionClient(node, CommissionAction, "commission/commission")
    await waiter.until(client.server_is_ready, 10.0)
    sent = client.send_goal_async(
        CommissionAction.Goal(directory=directory.name),
        feedback_callback=lambda message: tell(message.feedback.progress, message.feedback.stage),
    )
    await waiter.until(sent.done, 10.0)
    finished = sent.result().get_result_async()
    while not await waiter.until(finished.done, 0.2):
        for name, process in children.items():
            if process.exitcode is not None:
                raise JobError(f"node {name}", graph.ending(process.exitcode), "it to run until the end")
    result = finished.result().result
    if not result.success:
        raise JobError("commission", result.message)
    return result
