"""What runs beside the loop in the benchmark of faults: nodes that listen, record, play, read a gauge, and what they need."""

from __future__ import annotations

import importlib.util
import os
import pty
import threading
from pathlib import Path

from tcs_friction.nodes.graph import LOOP, PLANTS, node_names

LISTENERS = ("identifier", "diagnoser", "commission")
"""They hear the loop, and report what it says wrongly."""
RECORDED = "joint_states"
PLAYED = "/azimuth/wind"


def companions() -> tuple[str, ...]:
    """Every node that is not of the loop; the dynamometer where pyserial is installed."""
    missing = () if importlib.util.find_spec("serial") else ("dynamometer",)
    return tuple(name for name in node_names() if name not in (*LOOP, *PLANTS, *missing))


class Surroundings:
    """A bag to play, places to record to, a gauge on a pseudo-terminal; all of it in one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._made = 0
        self.recordings: list[Path] = []
        self._gauge, other = pty.openpty()
        self._port = os.ttyname(other)
        threading.Thread(target=self._answer, daemon=True).start()
        self._write_bag()

    def _answer(self) -> None:
        """What a gauge does that shows 80 N."""
        while asked := os.read(self._gauge, 64):
            if b"?" in asked:
                os.write(self._gauge, b"80.00 N\r\n")

    def _write_bag(self) -> None:
        import numpy as np

        from tcs_friction.recording.encode import encoded
        from tcs_friction.recording.write import EPOCH, write_bag

        times = EPOCH + np.arange(500) * 10_000_000
        write_bag(self._folder / "played", [encoded(PLAYED, "std_msgs/msg/Float64", times, {"data": np.arange(500.0)})])

    def parameters(self, name: str) -> list[str]:
        """ROS parameters of a companion that is started now."""
        if name == "recorder":
            self._made += 1
            self.recordings.append(self._folder / f"recorded_{self._made}")
            return [f"bag:={self.recordings[-1]}", f"topics:=[{RECORDED}]"]
        if name == "player":
            return [f"bag:={self._folder / 'played'}", "loop:=true"]
        if name == "dynamometer":
            return [f"port:={self._port}"]
        return [f"results:={self._folder}"]

    def recorded(self, path: Path) -> int:
        """Messages that a recorder which was killed has left behind; 0 also where its bag cannot be read."""
        from tcs_friction.errors import TcsError
        from tcs_friction.recording.bags import Bag
        from tcs_friction.recording.play import in_log_order

        try:
            return sum(1 for _ in in_log_order(Bag(path)))
        except TcsError:
            return 0
