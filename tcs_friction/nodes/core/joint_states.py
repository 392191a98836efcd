"""What drivers differ in: quality of service, joint names, speeds and torques that they do not report. Served, or else named."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisTorque

from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.core.wire import TORQUE, message_of

TOPIC = "joint_states"
SHOWN = 5
"""Joints named in one line."""
KEPT = 32
"""Commands remembered: a driver answers with a state long before so many more have been given."""


@dataclass(frozen=True)
class Judgement:
    """What a driver leaves out and is made up for, and what makes its messages useless; in words."""

    served: tuple[str, ...] = ()
    useless: str = ""


def judge(message: JointState, joint: str) -> Judgement:
    """What a joint state lacks for a joint."""
    names = list(message.name)
    if names and joint not in names:
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        return Judgement(useless=f"{TOPIC} name {', '.join(names[:SHOWN])}{more}, expected {joint}")
    if not names and len(message.position) > 1:
        return Judgement(useless=f"{TOPIC} hold {len(message.position)} joints and name none, expected {joint}")
    at = names.index(joint) if names else 0
    if not _given(message.position, at):
        return Judgement(useless=f"{TOPIC} without a position of {joint}")
    served = []
    if not _given(message.velocity, at):
        served.append("no velocity, derived from position")
    if not _given(message.effort, at):
        served.append("no effort, torque_command is taken for it")
    return Judgement(tuple(served))


def _given(values: Sequence[float], at: int) -> bool:
    return len(values) > at and not math.isnan(values[at])


class DriverWatch:
    """A subscription to joint states as a driver may publish them, and what there is to say about them."""

    def __init__(
        self, node: Node, callback: Callable[[bytes], None], profile: QoSProfile, joint: str, topic: str = TOPIC
    ) -> None:
        self._node, self._callback, self._topic = node, callback, topic
        self._newest = self._own = b""
        self._name = _in_message(joint)
        self._best_effort = False
        events = SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible)
        self._subscription: Any = node.create_subscription(
            JointState, topic, self._hear, profile, event_callbacks=events, raw=True
        )

    def _hear(self, data: bytes) -> None:
        self._newest = data
        if self._name in data:
            self._own = data
        self._callback(data)

    def _on_incompatible(self, _: Any) -> None:
        """A driver that publishes best effort is heard by best effort only; one that is reliable, by both."""
        if self._best_effort:
            return
        self._best_effort = True
        profile = QoSProfile(depth=LISTEN.depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._node.create_subscription(JointState, self._topic, self._hear, profile, raw=True)

    def judge(self, joint: str) -> Judgement:
        """About the newest message of the joint since the last question; where there is none, about the newest of all.

        Other joints may have messages of their own on the topic.
        """
        newest, self._own, self._name = self._own or self._newest, b"", _in_message(joint)
        message = message_of(newest, JointState) if newest else None
        found = judge(message, joint) if message is not None else Judgement()
        if self._best_effort:
            return Judgement((*found.served, "published best effort, heard likewise"), found.useless)
        return found


def _in_message(joint: str) -> bytes:
    """A joint's name as it stands in a serialised message that has it."""
    return joint.encode() + b"\0"


class CommandedTorque:
    """The torque of a driver that does not report it: the command that acted. Listens from the first question on."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._commands: deque[tuple[int, float]] = deque(maxlen=KEPT)
        self._listening = False

    def until(self, stamp: int) -> float:
        """Torque (N m) that acted until a stamp (ns): of the newest command before it; NaN before the first."""
        if not self._listening:
            self._listening = True
            self._node.create_subscription(AxisTorque, "torque_command", self._on_command, LISTEN, raw=True)
        return next((torque for commanded, torque in reversed(self._commands) if commanded < stamp), math.nan)

    def _on_command(self, data: bytes) -> None:
        stamp, (torque,) = TORQUE.read(data)
        if math.isfinite(torque):
            self._commands.append((stamp, torque))
