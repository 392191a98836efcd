"""The demo's loop in real time on CANopen: a commissioning through the driver, against a simulated drive on a virtual bus.

Driver and drive share a process, since python-can's virtual bus does not leave it; the loop has one of its own, and so has the
commissioning. With --serve there is the drive alone, on a port that speaks the protocol of socketcand, to be tried by hand.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.children import deaf
from tcs_friction.commands.parser import positive
from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings

AXIS, RUN = "azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml"
CHANNEL = "bench"
LOOP = ("controller", "reference", "dob", "lugre_compensator", "identifier")
MOTOR = {"counts_per_turn": 2.0**24, "gear": 4.0}
RATED = 250.0  # N m, of the motor: 1000 N m at the axis, of which a per mille is 1 N m
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
"""Gains for a period of 4 ms and one more until a torque acts, and times for a machine that others use too."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--rate", type=positive, default=250, metavar="HZ", help="SYNC per second (default %(default)s)")
    parser.add_argument("--serve", type=int, metavar="PORT", help="measure nothing: a simulated drive to try a driver on")
    parser.add_argument("-o", "--output", type=Path, help="directory to keep bags and report in (default: none)")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: tracking errors, what was identified, and how regular SYNC was."""
    try:
        import can  # noqa: F401
    except ModuleNotFoundError:
        raise InputError("bench canopen", "needs the packages canopen and python-can", "./tcs bench canopen") from None
    if arguments.serve is not None:
        _serve(arguments.serve)
        return []
    if arguments.output is not None:
        return _measured(arguments.rate, arguments.output.resolve())
    with TemporaryDirectory() as folder:
        return _measured(arguments.rate, Path(folder) / "result")


def drive_settings(**changes: Any) -> DriveSettings:
    """What the driver is told of the drive."""
    return DriveSettings(**{"interface": "virtual", "channel": CHANNEL, "heartbeat": 0.1, **MOTOR, **changes})


def _serve(port: int) -> None:
    from benchmarks.can_server import CanServer
    from benchmarks.simulated_drive import SimulatedDrive

    settings = drive_settings()
    server = CanServer(CHANNEL, port)
    drive = SimulatedDrive(load_axis(shipped(AXIS)).axis, settings, settings.bus(), RATED)
    print(f"a drive (node 1, {RATED:g} N m, {MOTOR['counts_per_turn']:.0f} counts, gear {MOTOR['gear']:g}) on port {server.port}")
    print("Ctrl-C ends it. What it does:", flush=True)
    said = None
    try:
        while True:
            if drive.state is not said:
                said = drive.state
                print(f"{said.value} at {drive.simulator.position:.6f} rad, {drive.torque:.0f} N m", flush=True)
            time.sleep(0.05)
    except KeyboardInterrupt:
        drive.close()
        server.close()


def _measured(rate: float, directory: Path) -> list[dict[str, Any]]:
    from tcs_friction.nodes.graph import arguments_for

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    settings = TUNING | {"clock": "real_time", "period": 1.0 / rate, "results": directory.parent}
    words = [word for name, value in settings.items() for word in ("-p", f"{name}:={_ros(value)}")]
    arguments = arguments_for(AXIS, RUN, [*words, "--log-level", "warn"])
    context = multiprocessing.get_context("spawn")
    ends = context.Pipe(duplex=False)
    over = context.Event()
    driver: BaseProcess = context.Process(target=_drive, args=(arguments, over, ends[1]), name="canopen_drive", daemon=True)
    loop: BaseProcess = context.Process(target=_loop, args=(arguments,), name="loop", daemon=True)
    for process in (driver, loop):
        with deaf():
            process.start()
    try:
        outcome = _commission(arguments, directory, {"canopen_drive": driver, "loop": loop})
        over.set()
        if not ends[0].poll(20.0):
            raise JobError("bench canopen", "the drive does not say when it heard SYNC", "a list of times")
        syncs, answers, fault = ends[0].recv()
    finally:
        for process in (driver, loop):
            process.kill()
            process.join()
    return _rows(rate, outcome, np.array(syncs), answers, fault)


def _ros(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _rows(rate: float, outcome: Any, syncs: Any, answers: int, fault: str) -> list[dict[str, Any]]:
    def row(name: str, value: float, unit: str) -> dict[str, Any]:
        return {"name": name, "value": value, "unit": unit, "beside": "", "ratio": None}

    gaps = np.diff(syncs)
    late = np.abs(gaps - 1.0 / rate) * 1e3
    measured = outcome.to_mapping()
    return [
        row("tracking error without compensation", measured["before"]["rms"], "arcsec rms"),
        row("tracking error with compensation", measured["after"]["rms"], "arcsec rms"),
        row("coulomb identified, 78.1 is true", outcome.identified["coulomb"], "N m"),
        row("SYNC", 1.0 / float(np.mean(gaps)), "1/s"),
        row("SYNC off its time, median", float(np.median(late)), "ms"),
        row("SYNC off its time, 99 %", float(np.percentile(late, 99.0)), "ms"),
        row("SYNC off its time, largest", float(late.max()), "ms"),
        row("SYNC that became a state", 100.0 * answers / len(syncs), "%"),
        row("faults of the drive", float(bool(fault)), ""),
    ]


def _commission(arguments: Sequence[str], directory: Path, children: Mapping[str, BaseProcess]) -> Any:
    """The action commission of a graph elsewhere; its outcome."""
    import rclpy
    from rclpy.task import Future

    from tcs_friction.nodes.commission import Commission
    from tcs_friction.nodes.demo import drive_action
    from tcs_friction.nodes.executor import close, make_executor, spin

    rclpy.init(args=["bench", *arguments])
    executor, node, done = make_executor(), Commission(), Future()
    executor.add_node(node)
    said: list[str] = []

    def tell(_share: float, stage: str) -> None:
        if stage not in said:
            said.append(stage)
            print(f"canopen: {stage} ...", flush=True)

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


def _loop(arguments: Sequence[str]) -> None:
    """In a process of its own: all other nodes."""
    from tcs_friction.nodes.graph import run_together

    run_together({"": arguments}, LOOP)


def _drive(arguments: Sequence[str], over: Any, result: Connection) -> None:
    """In a process of its own: the drive and its driver, until it is over; then when SYNC came, and how often it was answered."""
    import rclpy
    from rclpy.task import Future

    from benchmarks.simulated_drive import SimulatedDrive
    from tcs_friction.nodes.drivers.canopen_drive import CanopenDrive
    from tcs_friction.nodes.executor import close, make_executor, spin
    from tcs_friction.nodes.steady import steady_timer

    settings = drive_settings()
    times: list[float] = []
    drive = SimulatedDrive(load_axis(shipped(AXIS)).axis, settings, settings.bus(), RATED, sync_limit=0.5)
    drive.network.subscribe(0x80, lambda *_: times.append(time.monotonic()))
    own = {"interface": "virtual", "channel": CHANNEL, "heartbeat": settings.heartbeat, **MOTOR}
    words = [word for name, value in own.items() for word in ("-p", f"{name}:={value}")]
    rclpy.init(args=["drive", *arguments, *words])
    executor, node, done = make_executor(), CanopenDrive(), Future()
    executor.add_node(node)
    steady_timer(node, 0.2, lambda: done.set_result(None) if over.is_set() and not done.done() else None)
    spin(executor, done)
    result.send((times, node.health.ticks, node.hardware.fault))
    close(executor, [node])
    drive.close()
