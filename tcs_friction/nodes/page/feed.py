"""The page's ear in the graph: hears everything, holds up nobody, and hands orders on.

Its subscriptions are best effort: no publisher waits for an acknowledgement of it, and what it does not take in time is lost to
the page alone. Samples are read from bytes and appended to memory that is there already.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from tcs_friction.control.config_field import text
from tcs_friction.errors import printable
from tcs_friction.nodes.core.files import DEFAULT_AXIS, axis_file
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.plain_node import PlainNode
from tcs_friction.nodes.core.remote import Remotes
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, TORQUE, JointWire, Wire
from tcs_friction.nodes.page.orders import Orders
from tcs_friction.nodes.page.state import Condition, Sink
from tcs_friction.nodes.page.switches import SwitchWatch

BEST_EFFORT = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Deep enough for a busy machine, on which this process does not run for a good part of a second."""
MOST_TEXT, MOST_VALUES = 300, 60
"""Characters of a text and values of a report that are handed on; anybody may publish reports."""


@dataclass(frozen=True)
class PageConfig:
    """Whose page."""

    axis: str = text(DEFAULT_AXIS, "axis file of the axis that is shown")


class PageFeed(PlainNode[PageConfig]):
    """Hands what the graph of one axis says to a sink."""

    def __init__(self, sink: Sink) -> None:
        super().__init__("live", PageConfig())
        self._sink = sink
        self.heard = self.unreadable = 0
        self._file = axis_file(self.config.axis)
        self._subscribe()
        waiter = Waiter(self)
        remotes = Remotes(self, waiter)
        self._switches = SwitchWatch(self, remotes, self._file, sink.switched)
        self._orders = Orders(self, waiter, remotes, sink)

    def _subscribe(self) -> None:
        states = JointWire(self._file.axis.name)
        self.create_subscription(
            states.kind, "joint_states", self._listener("joint_states", states.read), BEST_EFFORT, raw=True
        )
        for topic, wire in (("reference", REFERENCE), ("torque_command", TORQUE), ("friction_compensation", TORQUE)):
            self.create_subscription(wire.kind, topic, self._listener(topic, _flat(wire)), BEST_EFFORT, raw=True)
        estimate = self._listener("friction_estimate", _estimate)
        self.create_subscription(ESTIMATE.kind, "friction_estimate", estimate, BEST_EFFORT, raw=True)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_reports, BEST_EFFORT)

    def _listener(self, topic: str, read: Callable[[bytes], tuple[Any, ...]]) -> Callable[[bytes], None]:
        write = self._sink.writer(topic)

        def hear(data: bytes) -> None:
            sample = read(data)
            if sample[0] < 0:
                self.unreadable += 1
                return
            self.heard += 1
            write(*sample)

        return hear

    def _on_reports(self, message: DiagnosticArray) -> None:
        """Reports of the nodes in this node's namespace."""
        own, now = f"{self.get_namespace().rstrip('/')}/", time.monotonic()
        for status in message.status[:MOST_VALUES]:
            if not status.name.startswith(own) or status.name == self.get_fully_qualified_name():
                continue
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            values = {_short(item.key): _short(item.value) for item in status.values[:MOST_VALUES]}
            self._sink.report(_short(status.name[len(own) :]), Condition(now, level, _short(status.message), values))

    def condition(self) -> tuple[str, dict[str, str]]:
        """Never a problem: what the page does not hear, nobody else misses."""
        return "", {"messages heard": str(self.heard), "messages not readable": str(self.unreadable)}

    @property
    def introduction(self) -> str:
        """What the log says when the node is ready."""
        return f"shows {self.get_namespace()}"


def _short(words: str) -> str:
    return printable(words[:MOST_TEXT])


def _flat(wire: Wire) -> Callable[[bytes], tuple[Any, ...]]:
    read = wire.read

    def flat(data: bytes) -> tuple[Any, ...]:
        stamp, numbers = read(data)
        return stamp, *numbers

    return flat


def _estimate(data: bytes) -> tuple[Any, ...]:
    stamp, (torque, velocity, _, valid) = ESTIMATE.read(data)
    return stamp, torque if valid else math.nan, velocity


