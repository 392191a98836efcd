"""One axis commissioned in real time while another moves: azimuth and altitude, which feels the azimuth's acceleration.

Both axes are in one process, with real-time scheduling as far as it is permitted, the commissioning of the azimuth in another.
The altitude follows a sinusoid all the time.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.children import deaf
from benchmarks.driven import AXIS, RUN, TUNING, commission, row, tracking_rows, words
from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError

OTHER = "altitude_1p2m.yaml"
SWINGING = "reference: {kind: sinusoid, amplitude: 5.0e-3, period: 30.0, duration: 1200.0}\n"
SPACE = "/azimuth"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--rate", type=positive, default=250, metavar="HZ", help="of both loops (default %(default)s)")
    parser.add_argument("-o", "--output", type=Path, help="directory to keep bags and report in (default: none)")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: tracking errors of the azimuth, what was identified, and what the altitude did meanwhile."""
    with TemporaryDirectory() as folder:
        directory = arguments.output.resolve() if arguments.output is not None else Path(folder) / "result"
        return _measured(1.0 / arguments.rate, directory, Path(folder) / "swinging.yaml")


def _measured(period: float, directory: Path, swinging: Path) -> list[dict[str, Any]]:
    from tcs_friction.nodes.axes import arguments_by_axis
    from tcs_friction.nodes.core import scheduling

    scheduling.ask(scheduling.ALL)
    swinging.write_text(SWINGING)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    values = TUNING | {"clock": "real_time", "period": period, "results": directory.parent, "simulated": True}
    axes = arguments_by_axis([AXIS, OTHER], [RUN, str(swinging)], [*words(values), "--log-level", "warn"])
    process = multiprocessing.get_context("spawn").Process(target=_graph, args=(axes,), name="graph", daemon=True)
    try:
        with deaf():
            process.start()
        altitude = Altitude()
        outcome = commission("axes", axes[SPACE], directory, {"graph": process}, altitude.begin)
    finally:
        process.kill()
        process.join()
    return [*tracking_rows(outcome), *altitude.rows()]


def _graph(axes: Mapping[str, Sequence[str]]) -> None:
    """In a process of its own: all nodes of both axes but the commissioning."""
    from tcs_friction.nodes.graph import GRAPH, run_together

    run_together(axes, [name for name in GRAPH if name not in ("commission", "diagnoser")])


class Altitude:
    """Has the other axis move from when its reference hears it, and looks on."""

    def begin(self, node: Any) -> None:
        """Ears and hands on a node of this process."""
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger
        from tcs_friction_msgs.msg import AxisReference

        from tcs_friction.nodes.core.qos import COLLECT
        from tcs_friction.nodes.core.steady import steady_timer

        self._states: dict[int, float] = {}
        self._wanted: dict[int, float] = {}
        node.create_subscription(JointState, "/altitude/joint_states", self._on_state, COLLECT)
        node.create_subscription(AxisReference, "/altitude/reference", self._on_reference, COLLECT)
        client = node.create_client(Trigger, "/altitude/reference/start")
        begun: list[Any] = []

        def start() -> None:
            """Again until the reference has begun: it refuses while the axis has not been heard."""
            if client.service_is_ready() and (not begun or (begun[-1].done() and not begun[-1].result().success)):
                begun.append(client.call_async(Trigger.Request()))

        steady_timer(node, 1.0, start)

    def _on_state(self, message: Any) -> None:
        self._states[_stamp(message)] = message.position[0]

    def _on_reference(self, message: Any) -> None:
        self._wanted[_stamp(message)] = message.position

    def rows(self) -> list[dict[str, Any]]:
        """Its travel, and how it tracked from when it moved. Raises JobError where it did not."""
        stamps = sorted(self._states.keys() & self._wanted.keys())
        positions = np.array([self._states[stamp] for stamp in stamps])
        if not len(positions) or np.ptp(positions) < 1e-3:
            raise JobError("bench axes", "the altitude did not move", "its reference to be followed")
        errors = np.array([self._wanted[stamp] for stamp in stamps]) - positions
        rms = float(np.degrees(np.sqrt(np.mean(errors[len(errors) // 2 :] ** 2))) * 3600.0)
        return [
            row("altitude meanwhile: travel", float(np.ptp(positions)), "rad"),
            row("altitude meanwhile: tracking error, second half", rms, "arcsec rms"),
        ]


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
