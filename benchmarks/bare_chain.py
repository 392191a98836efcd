"""A bare chain: nodes that pass the same messages over the same hops as the control loop and compute nothing.

Written as a ROS tutorial would: typed messages, one callback, the stamp handed on. With `serialised`, the nodes pass on
bytes that nobody looks into, which is the least that ROS can do.
"""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisReference, AxisTorque, FrictionEstimate

from tcs_friction.nodes.core.qos import LISTEN, PUBLISH

HEARD: dict[str, tuple[str, ...]] = {
    "plant": ("torque_command",),
    "reference": ("joint_states",),
    "lugre_compensator": ("reference",),
    "dob": ("joint_states", "friction_compensation"),
    "controller": ("joint_states", "reference", "friction_compensation", "friction_estimate"),
}
SAID = {
    "plant": "joint_states",
    "reference": "reference",
    "lugre_compensator": "friction_compensation",
    "dob": "friction_estimate",
    "controller": "torque_command",
}
KINDS: dict[str, Any] = {
    "joint_states": JointState,
    "reference": AxisReference,
    "friction_compensation": AxisTorque,
    "friction_estimate": FrictionEstimate,
    "torque_command": AxisTorque,
}


class Bare(Node):
    """Publishes its message whenever one message of each topic that it listens to has come."""

    def __init__(self, name: str, serialised: bool) -> None:
        super().__init__(name, namespace="bare")
        self._publisher = self.create_publisher(KINDS[SAID[name]], SAID[name], PUBLISH)
        message = _joint_state() if name == "plant" else KINDS[SAID[name]]()
        self._message = serialize_message(message) if serialised else message
        self._serialised = serialised
        self._awaited = len(HEARD[name])
        self._count = 0
        self.ticks = 0
        self.last = -1  # the tick at which `done` is completed
        self.done = Future()
        for topic in HEARD[name]:
            self.create_subscription(KINDS[topic], topic, self._on_message, LISTEN, raw=serialised)

    def _on_message(self, message: Any) -> None:
        self._count += 1
        if self._count < self._awaited:
            return
        self._count = 0
        if not self._serialised:
            self._message.header.stamp = message.header.stamp
        self.ticks += 1
        if self.ticks == self.last:
            self.done.set_result(None)
        else:
            self.publish()

    def publish(self) -> None:
        """Send the message on."""
        self._publisher.publish(self._message)


def _joint_state() -> JointState:
    zero = array.array("d", [0.0])
    return JointState(name=["azimuth"], position=zero, velocity=zero, effort=zero)


def bare(name: str, serialised: bool) -> Callable[[], Bare]:
    """A maker of the bare node that stands for a node of the loop."""
    return lambda: Bare(name, serialised)
