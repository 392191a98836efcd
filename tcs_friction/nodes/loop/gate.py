"""The torque gate in a node, of the simulated axis or of a driver: limits from the axis file, told to others, and verdicts."""

from __future__ import annotations

from dataclasses import replace

from rclpy.node import Node
from sensor_msgs.msg import JointState

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.torque_gate import TorqueLimits, Verdict
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.qos import LATCHED

LIMITS = "joint_limits"
"""Topic, latched: a JointState whose velocity and effort are the largest that are let on."""
OVERSPEED_SHARE = 0.9
"""Share of the controller's speed limit; above what a reference asks for, and full torque takes a moment to the rest."""


def torque_limits(file: AxisFile) -> TorqueLimits:
    """The limits that an axis file states, or else implies."""
    control = control_of(file)
    pid = control.controller
    implied = TorqueLimits(torque_limit=pid.torque_limit, overspeed=OVERSPEED_SHARE * pid.velocity_limit)
    return replace(implied, **control.limits)


class LimitsPublisher:
    """Tells the others which limits hold, whenever they change: a command beyond them would be refused."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(JointState, LIMITS, LATCHED)
        self._told: JointState | None = None

    def tell(self, joint: str, limits: TorqueLimits) -> None:
        """The limits of a joint."""
        message = JointState(name=[joint], velocity=[limits.overspeed], effort=[limits.torque_limit])
        if message != self._told:
            self._told = message
            self._publisher.publish(message)


def limits_told(message: JointState, joint: str) -> tuple[float, float] | None:
    """Largest speed (rad/s) and torque (N m) of a joint from a message of LIMITS, None where it does not tell them."""
    if list(message.name) != [joint] or len(message.velocity) != 1 or len(message.effort) != 1:
        return None
    speed, torque = message.velocity[0], message.effort[0]
    return (speed, torque) if speed > 0.0 and torque > 0.0 else None


def say(verdict: Verdict, health: Health) -> None:
    """Torque that is withheld, in the next report."""
    if verdict.doubt:
        health.doubt("holding", f"holding zero torque: {verdict.doubt}")
    else:
        health.well("holding")
    if verdict.limited:
        health.note(verdict.limited)
