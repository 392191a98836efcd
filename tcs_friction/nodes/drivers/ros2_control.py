"""A joint of a robot under ros2_control as hardware of a driver: /joint_states in, commands to an effort controller out.

A forward command controller keeps its last command for ever, and the hardware keeps it while the controller is off. So nothing is
sent before everything is known, and from the first torque on there is a command in every period, zero where there is to be no
torque, until the node is deactivated or ends. While somebody else commands nothing is sent, unless the axis moves too fast or too
far; what they leave behind is replaced by zero as soon as they are silent.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection
from statistics import median
from typing import Any

from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from tcs_friction.control.stamps import NEW_RUN, NEXT, SECOND
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.managed import ManagedNode
from tcs_friction.nodes.core.qos import LISTEN, NEWEST
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.core.wire import message_of
from tcs_friction.nodes.drivers.controller_watch import ControllerWatch, OtherCommands
from tcs_friction.nodes.drivers.effort_commands import EffortCommand, Others, objection
from tcs_friction.nodes.drivers.hardware import Hardware, Measured

STATES = "/joint_states"
LOOK_EVERY = 0.1  # s
INTERVALS = 50
"""Intervals between stamps from which the robot's period is estimated."""
PERIOD_SHARE = 0.1
"""By how much the robot's period may differ from parameter `period`."""
NEAR, LEAST_NEAR = 1.5, 0.4
"""Factor between an interval and a period that it may be; share of the intervals from which on these tell the period."""
REPEATED = 1.0
"""s for which zero is sent after the node has been deactivated."""
LAST_WORDS = 0.2
"""s in which the controller must have confirmed the last command."""
NOT_LOOKED = "the robot's controller is being looked at"
CONTRADICTED = 1.0
"""s for which a second publisher of joint states that contradicts the first counts."""


def state_period(intervals: Collection[float], wanted: float) -> float:
    """The period (s) behind intervals between stamps (s), of which some are lost and others come late, in bursts.

    The median of those near the wanted period; of all where few are.
    """
    near = [interval for interval in intervals if wanted / NEAR < interval < wanted * NEAR]
    return median(near if len(near) > LEAST_NEAR * len(intervals) else intervals)


class RobotJoint(Hardware):
    """One joint of several. What is in the way of torque is one line: `waits` before it has begun, `fault` thereafter."""

    def __init__(self, node: ManagedNode[Any], joint: str, controller: str, manager: str, others: Others) -> None:
        self._node, self._joint, self._others = node, joint, others
        self._controller, self._manager = controller, manager
        self._topic = f"{controller}/commands"
        self._input = JointInput(node.health, False)
        self._intervals: deque[float] = deque(maxlen=INTERVALS)
        self._efforts: dict[str, float] = {}
        self._command: EffortCommand | None = None
        self._sent, self._stopped_at = 0.0, -math.inf
        self._joints: tuple[str, ...] = ()
        self._obstacle_met = ""
        self.waits = NOT_LOOKED
        self.needed = ""
        """What else is in the way, said from outside."""

    def configure(self, config: Any) -> None:
        """Other limits of what joint states may be: a ClockConfig with Ranges and TorqueLimits."""
        self._config = config
        self._input.configure(self._joint, config)

    def open(self, heard: Callable[[Measured], None]) -> None:
        self._heard = heard
        self._watch = ControllerWatch(self._node, self._controller, self._manager)
        self._publisher = self._node.create_publisher(Float64MultiArray, self._topic, NEWEST)
        self._rivals = OtherCommands(self._node, self._topic)
        self._node.hear_driver(self._on_states, LISTEN, STATES, self._joint)
        steady_timer(self._node, LOOK_EVERY, self._look)

    def apply(self, torque: float) -> None:
        if self._command is None and not self.waits:
            self._command = EffortCommand(self._joints, self._joint, self._kept())
        self._stopped_at = math.inf
        self._send(torque)

    def stop(self, reason: str, exceeded: bool = False) -> None:  # noqa: ARG002 - the gate says it
        now = time.monotonic()
        self._stopped_at = min(self._stopped_at, now)
        if exceeded or self._rivals.silent(now, self._config.watchdog):
            self._send(0.0)
        if self._changed() or (not self._node.active and now - self._stopped_at > REPEATED):
            self._command = None

    def tick(self) -> None:
        pass

    def reset(self) -> None:
        self._obstacle_met = self.fault = ""
        self.waits = NOT_LOOKED
        self._command = None
        self._efforts.clear()

    def fade(self, duration: float) -> None:
        """Let what acts go to zero over some seconds, now: nobody calls any more."""
        steps, torque = max(1, round(duration / self._config.period)), self._sent
        for step in range(steps if torque else 0):
            self._send(torque * (1.0 - (step + 1) / steps))
            time.sleep(duration / steps)

    def close(self) -> None:
        self._publisher.wait_for_all_acked(Duration(seconds=LAST_WORDS))

    def _send(self, torque: float) -> None:
        if self._command is not None and not self._changed():
            self._sent = torque
            data = self._command.write(torque)
            self._rivals.sent(data)
            self._publisher.publish(data)

    # What the robot says

    def _on_states(self, data: bytes) -> None:
        if self._command is None:
            self._note_efforts(data)
        before, step = self._input.stamp, self._input.take(data)
        if step is NEXT and before >= 0:
            self._intervals.append((self._input.stamp - before) / SECOND)
        if step in (NEXT, NEW_RUN) and self._in_time(self._input.stamp):
            state = self._input
            torque = state.torque if math.isfinite(state.torque) else self._sent
            self._heard(Measured(state.stamp, state.position, state.speed, torque))

    def _in_time(self, stamp: int) -> bool:
        """Whether a stamp may be believed; one that is late is believed, and no torque acts on it."""
        limit = self._config.state_limit
        age = (self._node.get_clock().now().nanoseconds - stamp) / SECOND
        if age > limit:
            self._node.health.note(f"{STATES} older than {limit:g} s when they come: late, or the clocks differ")
        if age < -limit:
            self._node.health.refuse(f"{STATES} from the future by more than {limit:g} s: the clocks differ")
        return age >= -limit

    def _note_efforts(self, data: bytes) -> None:
        """Efforts of those joints that are to keep what they have. They may come in other messages than the axis."""
        wanted = {name for name, effort in self._others.items() if effort is None}
        message = message_of(data, JointState) if wanted else None
        if message is not None:
            pairs = zip(message.name, message.effort, strict=False)
            self._efforts |= {name: value for name, value in pairs if name in wanted and math.isfinite(value)}

    def _kept(self) -> dict[str, float]:
        return {name: self._efforts[name] if effort is None else effort for name, effort in self._others.items()}

    # What is in the way

    def _look(self) -> None:
        self._rivals.look()
        obstacle = self._obstacle(time.monotonic())
        if obstacle and self._command is not None:
            self._obstacle_met = self._obstacle_met or obstacle
        self.fault = self._obstacle_met + (self._left_behind() if self._obstacle_met else "")
        self.waits = "" if self.fault else obstacle
        if self._command is None:
            self._joints = self._watch.joints
        self._node.health.values["controller"] = f"{self._topic}: {', '.join(self._watch.joints) or 'joints not known'}"

    def _left_behind(self) -> str:
        """What acts on the axis of what somebody else has commanded, "" when they did not."""
        efforts = self._rivals.efforts
        if efforts is None:
            return ""
        own = self._joints.index(self._joint) if self._joint in self._joints else len(efforts)
        kept = f"{efforts[own]:g} N m" if own < len(efforts) else "commands of another length"
        return f"; the controller keeps their {kept}" if not self._rivals.replaced else f"; their {kept} was replaced by zero"

    def _obstacle(self, now: float) -> str:
        """The first thing in the way of torque, "" for none."""
        watch = self._watch
        return (
            self.needed
            or watch.unknown(now)
            or objection(watch.joints, watch.interface, self._joint, self._others, watch.controller)
            or watch.inactive(now)
            or self._rivals.objection(now)
            or self._states_objection(now)
            or self._changed()
        )

    def _states_objection(self, now: float) -> str:
        if len(self._intervals) < INTERVALS // 2:
            return f"the rate of {STATES} is not known yet"
        wanted = self._config.period
        period = state_period(self._intervals, wanted)
        self._node.health.values["period of the robot [s]"] = f"{period:.6g}"
        if abs(period - wanted) > PERIOD_SHARE * wanted:
            return f"{STATES} come every {period:.6g} s, expected {wanted:g} s: set the parameter period of all nodes"
        if now - self._input.contradicted < CONTRADICTED and self._node.count_publishers(STATES) > 1:
            return f"two publishers of {STATES} contradict each other"
        missing = [name for name, effort in self._others.items() if effort is None and name not in self._efforts]
        return f"{STATES} without an effort of {', '.join(missing)}, which others wants measured" if missing else ""

    def _changed(self) -> str:
        """That the command is laid out for other joints than the controller has now, "" when it is not."""
        same = self._command is None or self._joints == self._watch.joints
        return "" if same else f"{self._controller} has other joints than before"
