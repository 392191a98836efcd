"""The judge of the benchmark of faults: hears what the axis does and what /diagnostics says, in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from benchmarks.faulty_nodes import GARBLED_COUNT, HEARS, TRUE_REFERENCE, TRUE_STATES
from benchmarks.listening import Listening, Report, wait_until

ERROR = 2
SILENT = 2.2
"""s without a report, which come every second."""
BEGUN_AT = 1e-9
"""rad from the axis: there the reference begins when it has lost it."""
REFUSED = "inputs refused"


class Watch(Listening):
    """Extremes of the true motion, and the reports of every node."""

    def __init__(self) -> None:
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger

        from tcs_friction.config import control_of, load_axis
        from tcs_friction.control.plausible import motion_limits
        from tcs_friction.nodes.core.files import DEFAULT_AXIS, config_file
        from tcs_friction.nodes.core.qos import COLLECT
        from tcs_friction.nodes.core.wire import JointWire

        file = load_axis(config_file(DEFAULT_AXIS))
        self._limits = control_of(file).controller
        self._speed_limit = motion_limits(file.axis, self._limits).speed_limit
        self._wire = JointWire(file.axis.name)
        self.speed = self.torque = self.stepped = 0.0
        self._reference: tuple[int, float, float] | None = None
        self._slows_down = False
        self._during = self._fastest = "the start"
        self._reports: dict[str, Report] = {}
        self._said: list[str] = []
        self._counts: dict[tuple[str, str], _Count] = {}
        self._lock = threading.Lock()
        super().__init__("watch")
        self.node.create_subscription(JointState, TRUE_STATES, self._on_state, COLLECT, raw=True)
        self.node.create_subscription(JointState, TRUE_REFERENCE, self._on_reference, COLLECT, raw=True)
        self.hear_reports(self._on_report)
        self._start = self.node.create_client(Trigger, "reference/start")
        self._request = Trigger.Request()
        self.begin()

    def _on_state(self, data: bytes) -> None:
        _, _, speed, torque = self._wire.read(data)
        self.torque = max(self.torque, abs(torque))
        if abs(speed) > self.speed:
            self.speed, self._fastest = abs(speed), self._during

    def _on_report(self, name: str, report: Report) -> None:
        with self._lock:
            self._reports[name] = report
            if report.level:
                self._said.append(" ".join([report.message, *report.values.values()]))
            for counted in (REFUSED, GARBLED_COUNT):
                self._counts.setdefault((name, counted), _Count()).add(int(report.values.get(counted, 0)))

    def _on_reference(self, data: bytes) -> None:
        """From one stamp to the next it goes no faster than its limit, unless it begins where the axis is, and with its speed."""
        stamp, position, speed, axis = self._wire.read(data)
        before, self._reference = self._reference, (stamp, position, abs(speed))
        if before is None or stamp <= before[0]:
            return
        step = abs(position - before[1]) * 1e9 / (stamp - before[0])
        if abs(position - axis) <= BEGUN_AT or (self._slows_down and step <= before[2]):
            self._slows_down = abs(speed) > self._speed_limit
        else:
            self.stepped = max(self.stepped, step)

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

        return wait_until(named, limit)

    def until_silent(self, name: str, limit: float) -> bool:
        """Whether a node that has reported stops to report, within a time (s)."""

        def silent() -> bool:
            with self._lock:
                report = self._reports.get(name)
            return report is not None and time.monotonic() - report.at > SILENT

        return wait_until(silent, limit)

    def until_well(self, names: Sequence[str], limit: float) -> bool:
        """Whether every node has reported within the last seconds and none has an error, within a time (s)."""

        def well() -> bool:
            now = time.monotonic()
            with self._lock:
                reports = [self._reports.get(name) for name in names]
            return all(report is not None and now - report.at < 2.5 and report.level < ERROR for report in reports)

        return wait_until(well, limit)

    def until_running(self, limit: float) -> bool:
        """Tell the reference to begin until its report says that it runs; whether it did within a time (s)."""
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if self._start.service_is_ready():
                self._start.call_async(self._request)
            if wait_until(self.is_running, 3.5):
                return True
        return False

    def is_running(self) -> bool:
        with self._lock:
            report = self._reports.get("reference")
        return report is not None and report.values.get("phase") == "running"

    def complaints(self) -> str:
        """What the nodes say now that are not well."""
        with self._lock:
            return ", ".join(f"{name}: {report.message}" for name, report in self._reports.items() if report.level)

    def extremes(self) -> list[tuple[str, float, float, str]]:
        """Largest values with their limits."""
        return [
            ("largest true speed, beside its limit", self.speed, self._limits.velocity_limit, "rad/s"),
            ("largest torque, beside its limit", self.torque, self._limits.torque_limit, "N m"),
            ("largest step of the reference per tick, as a speed, beside its limit", self.stepped, self._speed_limit, "rad/s"),
        ]

    def excesses(self) -> list[str]:
        """Limits that were not kept."""
        over = [item for item in self.extremes() if not item[1] <= item[2] * (1.0 + 1e-6)]
        return [f"{name}: {value:.4g} {unit}, {limit:g}; fastest after {self._fastest}" for name, value, limit, unit in over]

    def counted(self, name: str, what: str) -> int:
        """A counter of a node, over all its processes; what a process that was killed had counted last is not known."""
        with self._lock:
            count = self._counts.get((name, what))
        return count.total if count else 0

    def refusals(self) -> list[tuple[str, int, int]]:
        """For each node of the loop: inputs that it refused, and those that were sent to it garbled beyond doubt."""
        return [
            (name, self.counted(name, REFUSED), sum(self.counted(sender, GARBLED_COUNT) for sender in senders))
            for name, senders in HEARS.items()
        ]


class _Count:
    """A counter that begins at 0 again when its process is started anew."""

    def __init__(self) -> None:
        self._before = self._last = 0

    def add(self, value: int) -> None:
        if value < self._last:
            self._before += self._last
        self._last = value

    @property
    def total(self) -> int:
        return self._before + self._last
