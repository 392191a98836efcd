"""What recorder, player and dynamometer share: a configuration that holds from the start on, and diagnostics. No axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tcs_friction.nodes.core import parameters
from tcs_friction.nodes.core.arguments import own_arguments
from tcs_friction.nodes.core.steady import steady_timer

C = TypeVar("C")


class PlainNode(Node, Generic[C]):
    """A node without an axis. Not on /rosout: its last words come when the context has ended."""

    def __init__(self, name: str, defaults: C) -> None:
        super().__init__(name, namespace="azimuth", enable_rosout=False, cli_args=own_arguments())
        self.config: C = parameters.declare(self, defaults, fixed=True)
        parameters.refuse_unknown(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady_timer(self, 1.0, self._report)

    def condition(self) -> tuple[str, dict[str, str]]:
        """What is wrong ("" for nothing), and counters. For subclasses."""
        raise NotImplementedError

    def resolved(self, names: Sequence[str]) -> list[str]:
        """Topics as full names."""
        return [self.resolve_topic_name(name) for name in names]

    def _report(self) -> None:
        problem, counters = self.condition()
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        status = DiagnosticStatus(level=level, name=self.get_fully_qualified_name(), message=problem or "ok")
        status.hardware_id = str(getattr(self.config, "port", self.get_namespace().strip("/")))
        status.values = [KeyValue(key=key, value=value) for key, value in counters.items()]
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(report)
