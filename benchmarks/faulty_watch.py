"""The judge of the benchmark of faults: hears what the axis does and what /diagnostics says, in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.faulty_nodes import TRUE_STATES

ERROR = 2


class Watch:
    """Extremes of the true motion, and the reports of every node."""

    def __init__(self) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger

        from tcs_friction.config import load_axis
        from tcs_friction.nodes.base import control_of
        from tcs_friction.nodes.files import DEFAULT_AXIS, config_file
        from tcs_friction.nodes.qos import COLLECT
        from tcs_friction.nodes.wire import JointWire

        file = load_axis(config_file(DEFAULT_AXIS))
        self._limits = control_of(file).controller
        self._wire = JointWire(file.axis.name)
        self.speed = self.torque = 0.0
        self._during = self._fastest = "the start"
        self._reports: dict[str, tuple[float, int, str, dict[str, str]]] = {}
        self._said: list[str] = []
        self._refused: dict[str, int] = {}
        self._refused_before = 0
        self._lock = threading.Lock()
        rclpy.init(args=["watch"])
        self._node = rclpy.create_node("watch", namespace="azimuth")
        self._node.create_subscription(JointState, TRUE_STATES, self._on_state, COLLECT, raw=True)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, COLLECT)
        self._start = self._node.create_client(Trigger, "reference/start")
        self._request = Trigger.Request()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=0.1)

    def _on_state(self, data: bytes) -> None:
        _, _, speed, torque = self._wire.read(data)
        self.torque = max(self.torque, abs(torque))
        if abs(speed) > self.speed:
            self.speed, self._fastest = abs(speed), self._during

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            name = status.name.rpartition("/")[2]
            values = {item.key: item.value for item in status.values}
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            with self._lock:
                self._reports[name] = (time.monotonic(), level, status.message, values)
                if level:
                    self._said.append(" ".join([status.message, *values.values()]))
                refused = int(values.get("inputs refused", 0))
                if refused < self._refused.get(name, 0):  # a process that was started anew
                    self._refused_before += self._refused[name]
                self._refused[name] = refused

    # Questions

    def forget(self, fault: str) -> None:
        """What was said before this fault."""
        self._during = fault
        with self._lock:
            self._said.clear()
            self._reports.clear()

    def until_named(self, words: str, limit: float) -> bool:
        """Whether a report that is not OK has these words within a time (s)."""

        def named() -> bool:
            with self._lock:
                return any(words in text for text in self._said)

        return _until(named, limit)

    def until_well(self, names: Sequence[str], limit: float) -> bool:
        """Whether every node has reported within the last seconds and none has an error, within a time (s)."""

        def well() -> bool:
            now = time.monotonic()
            with self._lock:
                reports = [self._reports.get(name) for name in names]
            return all(report is not None and now - report[0] < 2.5 and report[1] < ERROR for report in reports)

        return _until(well, limit)

    def until_running(self, limit: float) -> bool:
        """Tell the reference to begin until its report says that it runs; whether it did within a time (s)."""
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if self._start.service_is_ready():
                self._start.call_async(self._request)
            if _until(self._is_running, 3.5):
                return True
        return False

    def _is_running(self) -> bool:
        with self._lock:
            report = self._reports.get("reference")
        return report is not None and report[3].get("phase") == "running"

    def complaints(self) -> str:
        """What the nodes say now that are not well."""
        with self._lock:
            return ", ".join(f"{name}: {report[2]}" for name, report in self._reports.items() if report[1])

    def extremes(self) -> list[tuple[str, float, float, str]]:
        """Largest values with their limits."""
        return [
            ("largest true speed, beside its limit", self.speed, self._limits.velocity_limit, "rad/s"),
            ("largest torque, beside its limit", self.torque, self._limits.torque_limit, "N m"),
        ]

    def excesses(self) -> list[str]:
        """Limits that were not kept."""
        over = [item for item in self.extremes() if not item[1] <= item[2]]
        return [f"{name}: {value:.4g} {unit}, {limit:g}; fastest after {self._fastest}" for name, value, limit, unit in over]

    def refused(self) -> int:
        """Inputs that all nodes refused."""
        with self._lock:
            return self._refused_before + sum(self._refused.values())

    def close(self) -> None:
        """End the thread and ROS."""
        import rclpy

        self._over.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.try_shutdown()


def _until(ready: Callable[[], bool], limit: float) -> bool:
    deadline = time.monotonic() + limit
    while time.monotonic() < deadline:
        if ready():
            return True
        time.sleep(0.05)
    return ready()
