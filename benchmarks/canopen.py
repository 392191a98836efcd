"""The demo's loop in real time on CANopen: a commissioning through the driver, against a simulated drive on a virtual bus.

Driver and drive share a process, since python-can's virtual bus does not leave it; the loop has one of its own, and so has the
commissioning. With --serve there is the drive alone, on a port that speaks the protocol of socketcand, to be tried by hand.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.driven import AXIS, commissioned, row, run_driver, tracking_rows, words
from tcs_friction.commands.parser import positive
from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings

CHANNEL = "bench"
MOTOR = {"counts_per_turn": 2.0**24, "gear": 4.0}
RATED = 250.0  # N m, of the motor: 1000 N m at the axis, of which a per mille is 1 N m


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
    outcome, (syncs, answers, fault) = commissioned("canopen", _drive, 1.0 / rate, directory)
    gaps = np.diff(np.array(syncs))
    late = np.abs(gaps - 1.0 / rate) * 1e3
    return [
        *tracking_rows(outcome),
        row("SYNC", 1.0 / float(np.mean(gaps)), "1/s"),
        row("SYNC off its time, median", float(np.median(late)), "ms"),
        row("SYNC off its time, 99 %", float(np.percentile(late, 99.0)), "ms"),
        row("SYNC off its time, largest", float(late.max()), "ms"),
        row("SYNC that became a state", 100.0 * answers / len(syncs), "%"),
        row("faults of the drive", float(bool(fault))),
    ]


def _drive(arguments: Sequence[str], over: Any, result: Connection) -> None:
    """In a process of its own: the drive and its driver, until it is over; then when SYNC came, and how often it was answered."""
    from benchmarks.simulated_drive import SimulatedDrive
    from tcs_friction.nodes.drivers.canopen_drive import CanopenDrive

    settings = drive_settings()
    times: list[float] = []
    drive = SimulatedDrive(load_axis(shipped(AXIS)).axis, settings, settings.bus(), RATED, sync_limit=0.5)
    drive.network.subscribe(0x80, lambda *_: times.append(time.monotonic()))
    own = {"interface": "virtual", "channel": CHANNEL, "heartbeat": settings.heartbeat, **MOTOR}
    run_driver(
        CanopenDrive,
        [*arguments, *words(own)],
        over,
        lambda node: result.send((times, node.health.ticks, node.hardware.fault)),
    )
    drive.close()
