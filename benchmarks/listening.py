"""A node that listens in a thread of its own, to what goes on in processes elsewhere; waiting for a condition."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Report:
    """What a node has said of itself on /diagnostics: when it was heard (steady time, s), its level, message and values."""

    at: float
    level: int
    message: str
    values: dict[str, str]


class Listening:
    """ROS, a node and its thread, from `begin` until `close`. Callbacks of `node` run in that thread.

    What the node subscribes to is made before `begin`: made under a waiting thread, it makes the middleware crash now and then.
    """

    def __init__(self, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        rclpy.init(args=[name])
        self.node = rclpy.create_node(name, namespace="azimuth")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._spin)

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with suppress(ExternalShutdownException):  # an interrupt has ended ROS
            while not self._over.is_set():
                self.executor.spin_once(timeout_sec=0.1)

    def hear_reports(self, heard: Callable[[str, Report], None]) -> None:
        """Call `heard(name, report)` for every report of a node; the name without its namespace."""
        from diagnostic_msgs.msg import DiagnosticArray

        from tcs_friction.nodes.core.qos import COLLECT

        def on_diagnostics(message: Any) -> None:
            for status in message.status:
                level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
                values = {item.key: item.value for item in status.values}
                heard(status.name.rpartition("/")[2], Report(time.monotonic(), level, status.message, values))

        self.node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, COLLECT)

    def close(self) -> None:
        """End the thread and ROS."""
        import rclpy

        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


def wait_until(ready: Callable[[], bool], limit: float = 30.0) -> bool:
    """Poll a condition; whether it came true within the limit (s)."""
    deadline = time.monotonic() + limit
    while time.monotonic() < deadline:
        if ready():
            return True
        time.sleep(0.05)
    return ready()
