"""The demo's loop in real time on ros2_control: a commissioning through the driver, beside a stand-in for a robot, at its rate.

Robot, driver, loop and commissioning are processes of their own. The robot's controller has two joints, of which the driver keeps
one as it is told. With --serve there is the robot alone, to be tried by hand.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.driven import AXIS, commissioned, row, run_driver, tracking_rows, words
from tcs_friction.commands.parser import positive
from tcs_friction.errors import InputError

OTHERS = {"others": "['elbow=7']"}
EFFORT = 1000.0  # N m, of the URDF: the drive of the axis file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--rate", type=positive, default=200, metavar="HZ", help="of the robot (default %(default)s)")
    parser.add_argument("--serve", action="store_true", help="measure nothing: a robot to try the driver on")
    parser.add_argument("-o", "--output", type=Path, help="directory to keep bags and report in (default: none)")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: tracking errors, what was identified, and how regular the robot's states came."""
    try:
        import rclpy  # noqa: F401
    except ModuleNotFoundError:
        raise InputError("bench ros2_control", "needs ROS 2", "./tcs on a machine with a C and a C++ compiler") from None
    robot = ["--ros-args", *words({"axis": AXIS, "period": 1.0 / arguments.rate})]
    if arguments.serve:
        _serve(robot, arguments.rate)
        return []
    robot += words({"effort_limit": EFFORT})
    if arguments.output is not None:
        return _measured(arguments.rate, robot, arguments.output.resolve())
    with TemporaryDirectory() as folder:
        return _measured(arguments.rate, robot, Path(folder) / "result")


def _serve(robot: Sequence[str], rate: float) -> None:
    from benchmarks.simulated_robot import main
    from tcs_friction.nodes.entry import stay_local

    stay_local()
    print(f"a robot with elbow, azimuth and wrist, {rate:g} joint states a second; /effort_controller has the first two")
    print("Ctrl-C ends it. What acts on the joints is on /robot/applied.", flush=True)
    main(robot)


def _measured(rate: float, robot: Sequence[str], directory: Path) -> list[dict[str, Any]]:
    from benchmarks.simulated_robot import main

    beside = multiprocessing.get_context("spawn").Process(target=main, args=(robot,), name="robot", daemon=True)
    outcome, (heard, refused, fault) = commissioned("ros2_control", _drive, 1.0 / rate, directory, [beside])
    gaps = np.diff(np.array(heard))
    late = np.abs(gaps - 1.0 / rate) * 1e3
    return [
        *tracking_rows(outcome),
        row("states of the robot", 1.0 / float(np.mean(gaps)), "1/s"),
        row("states off their time, median", float(np.median(late)), "ms"),
        row("states off their time, 99 %", float(np.percentile(late, 99.0)), "ms"),
        row("states off their time, largest", float(late.max()), "ms"),
        row("messages refused by the driver", float(refused)),
        row("faults of the driver", float(bool(fault))),
    ]


def _drive(arguments: Sequence[str], over: Any, result: Connection) -> None:
    """In a process of its own: the driver, until it is over; then when states came (steady, s), refusals, its fault."""
    from tcs_friction.nodes.drivers.hardware import Measured
    from tcs_friction.nodes.drivers.ros2_control_driver import Ros2ControlDriver

    times: list[float] = []

    class Timed(Ros2ControlDriver):
        def _on_measured(self, measured: Measured) -> None:
            times.append(time.monotonic())
            super()._on_measured(measured)

    run_driver(
        Timed,
        [*arguments, *words(OTHERS)],
        over,
        lambda node: result.send((times, node.health.refused, node.hardware.fault)),
    )
