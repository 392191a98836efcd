"""A stand-in for a robot under ros2_control: a process with the nodes, topics and habits of the published sources.

It behaves as ros2_controllers and ros2_control of Jazzy do:

- `joint_state_broadcaster` publishes all joints in one order, NaN where an interface has no value.
- `effort_controller` (forward_command_controller) drops commands that are not finite and keeps the last one for ever. A command
  of another length makes its manager switch it off. What it commanded then stays in the hardware; a JointGroupEffortController
  writes zero instead. When it is switched on, commands from before count no more, and nothing is written until one comes.
- `controller_manager` reports the states of its controllers on /diagnostics once a second.

The axis' joint moves by the simulator, which keeps up with the clock; the others stand still. Joint states have the stamp of the
moment at which the positions were so. What acts on all joints is on /robot/applied. Parameters of the node /robot, to be set
while it runs, are the faults. By hand: `./tcs bench ros2_control --serve`.
"""

from __future__ import annotations

import math
import random
import signal
import sys
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_system_default
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from tcs_friction.nodes.core.convert import set_stamp
from tcs_friction.nodes.core.files import DEFAULT_AXIS, axis_file
from tcs_friction.nodes.core.qos import LATCHED
from tcs_friction.physics.simulate import Simulator

URDF = """<robot name="arm">
  <link name="base"/>
  <joint name="elbow" type="revolute"><limit effort="20" velocity="2" lower="-1" upper="1"/></joint>
  <joint name="{joint}" type="revolute">
    <limit effort="{effort}" velocity="0.5" lower="-0.5" upper="0.5"/><dynamics friction="60" damping="500"/>
  </joint>
  <joint name="wrist" type="continuous"><limit effort="5" velocity="3"/></joint>
  <ros2_control name="arm" type="system"><joint name="{joint}"/></ros2_control>
</robot>"""
DEFAULTS: dict[str, Any] = {
    "axis": DEFAULT_AXIS,
    "period": 0.005,  # s
    "joints": ["elbow", "azimuth"],  # of the controller
    "group": False,  # JointGroupEffortController: zero when it is switched off
    "active": True,  # the controller
    "effort_limit": 150.0,  # of the URDF, N m
    "late": 0.0,  # s that joint states are late
    "lost": 0.0,  # share of the joint states
    "swapped": False,  # every second joint state after the one that follows it
    "order": ["wrist", "azimuth", "elbow"],  # of the joint states
    "nan_effort": False,
    "silent": False,  # no joint states
}
STEP = 1e-3  # s, of the simulation
MOST_STEPS = 2000
"""At a time: what a machine that stood still for longer has missed is left out."""


class Controller:
    """A forward command controller, as far as it can be seen from outside."""

    def __init__(self, joints: list[str]) -> None:
        self.joints, self.active, self.group = joints, False, False
        self._buffer: list[float] | None = None

    def on_message(self, message: Float64MultiArray) -> None:
        if all(math.isfinite(value) for value in message.data):
            self._buffer = list(message.data)

    def switch(self, active: bool, interfaces: dict[str, float]) -> None:
        self._buffer = None
        if self.active and not active and self.group:
            interfaces.update(dict.fromkeys(self.joints, 0.0))
        self.active = active

    def update(self, interfaces: dict[str, float]) -> None:
        if not self.active or self._buffer is None:
            return
        if len(self._buffer) != len(self.joints):
            self.switch(False, interfaces)  # the update is an error: the manager switches the controller off
            return
        interfaces.update(zip(self.joints, self._buffer, strict=True))


class Robot:
    """All nodes of the robot, and its hardware."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("robot")
        self.values = {name: self.node.declare_parameter(name, value).value for name, value in DEFAULTS.items()}
        manager, broadcaster = rclpy.create_node("controller_manager"), rclpy.create_node("joint_state_broadcaster")
        controller = rclpy.create_node("effort_controller")
        self.nodes = [self.node, manager, broadcaster, controller]
        controller.declare_parameter("joints", self.values["joints"])
        controller.declare_parameter("interface_name", "effort")
        self.controller = Controller(self.values["joints"])
        self._diagnostics = manager.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._states = broadcaster.create_publisher(JointState, "/joint_states", qos_profile_system_default)
        self._applied = self.node.create_publisher(Float64MultiArray, "/robot/applied", 100)
        description = self.node.create_publisher(String, "/robot_description", LATCHED)
        controller.create_subscription(
            Float64MultiArray, "/effort_controller/commands", self.controller.on_message, qos_profile_system_default
        )
        file = axis_file(self.values["axis"])
        self.joint = file.axis.name
        self.efforts = {"elbow": 3.0, self.joint: 0.0, "wrist": 0.0}  # the command interfaces
        description.publish(String(data=URDF.format(joint=self.joint, effort=self.values["effort_limit"])))
        self._simulator = Simulator(file.axis, STEP)
        self._began, self._began_at, self._steps = time.monotonic(), self.node.get_clock().now().nanoseconds, 0
        self._random = random.Random(0)
        self._waiting: deque[tuple[float, JointState]] = deque()
        self._held: JointState | None = None
        self.controller.group = self.values["group"]
        self.controller.switch(self.values["active"], self.efforts)
        self.node.add_on_set_parameters_callback(self._on_set)
        self.node.create_timer(self.values["period"], self._update)
        manager.create_timer(1.0, self._report)

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        for item in changes:
            self.values[item.name] = item.value
            if item.name == "active":
                self.controller.switch(item.value, self.efforts)
                self._report()
        return SetParametersResult(successful=True)

    def _report(self) -> None:
        """As the diagnostic updater of the controller manager does."""
        state = "active" if self.controller.active else "inactive"
        values = [KeyValue(key="joint_state_broadcaster.state", value="active")]
        values.append(KeyValue(key="effort_controller.state", value=state))
        status = DiagnosticStatus(name="controller_manager: Controllers Activity", hardware_id="ros2_control", values=values)
        self._diagnostics.publish(DiagnosticArray(status=[status]))

    def _update(self) -> None:
        """read, update, write."""
        simulator = self._simulator
        self._advance()
        self.controller.update(self.efforts)
        self._applied.publish(Float64MultiArray(data=[self.efforts["elbow"], self.efforts[self.joint], self.efforts["wrist"]]))
        motion = {self.joint: (simulator.measured_position, simulator.measured_velocity)}
        names = list(self.values["order"])
        message = JointState(name=names)
        set_stamp(message, self._began_at + round(self._steps * STEP * 1e9))
        message.header.frame_id = "base_link"
        message.position = [motion.get(name, (0.25, 0.0))[0] for name in names]
        message.velocity = [motion.get(name, (0.25, 0.0))[1] for name in names]
        message.effort = [math.nan if self.values["nan_effort"] else self.efforts[name] for name in names]
        if not (self.values["silent"] or self._random.random() < self.values["lost"]):
            self._waiting.append((time.monotonic() + self.values["late"], message))
        self._deliver()

    def _advance(self) -> None:
        """The axis up to now, under what has acted since the last time."""
        due = int((time.monotonic() - self._began) / STEP)
        for _ in range(min(due - self._steps, MOST_STEPS)):
            self._simulator.step(self.efforts[self.joint])
        self._steps = due

    def _deliver(self) -> None:
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            message = self._waiting.popleft()[1]
            if self.values["swapped"] and self._held is None:
                self._held = message
                continue
            self._states.publish(message)
            if self._held is not None:
                self._states.publish(self._held)
                self._held = None


def main(arguments: Sequence[str] | None = None) -> None:
    """Until a signal."""
    rclpy.init(args=sys.argv if arguments is None else ["robot", *arguments], signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    robot = Robot()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    for node in robot.nodes:
        executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
