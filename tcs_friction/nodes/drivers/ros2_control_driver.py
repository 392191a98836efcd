"""An axis that is a joint of a robot under ros2_control: /joint_states in, commands to an effort controller out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from std_msgs.msg import String

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import text, texts
from tcs_friction.control.plausible import Ranges
from tcs_friction.control.torque_gate import TorqueLimits
from tcs_friction.errors import InputError, one_line
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.qos import LATCHED
from tcs_friction.nodes.drivers.driver_node import DriverConfig, DriverNode
from tcs_friction.nodes.drivers.effort_commands import others_of
from tcs_friction.nodes.drivers.ros2_control import STATES, RobotJoint
from tcs_friction.nodes.drivers.urdf import JointLimits, joint_limits, load_joint_limits

DESCRIPTION = "/robot_description"
NO_URDF = "none"
IF_KILLED = "the controller keeps the last torque for ever: the drive needs a watchdog of its own"


@dataclass(frozen=True)
class Ros2ControlConfig(Ranges, DriverConfig):
    """Which joint of which robot the axis is. Topics are renamed as usual: -r /joint_states:=/arm/joint_states."""

    joint: str = text("", "joint of the robot; none: the one that has the axis' name", fixed=True)
    controller: str = text("/effort_controller", "effort controller, by the name of its node", fixed=True)
    manager: str = text(
        "/controller_manager", "whose diagnostics say what the controller does; none: that is not checked", fixed=True
    )
    others: tuple[str, ...] = texts(
        "what each other joint of the controller keeps: JOINT=EFFORT, or JOINT=measured at the start", fixed=True
    )
    urdf: str = text("", f"URDF file with the joint's limits; empty: from {DESCRIPTION}; none: own limits only", fixed=True)


class Ros2ControlDriver(DriverNode[Ros2ControlConfig]):
    """Lets torque on through a forward command controller, within the smaller ones of its own and the URDF's limits."""

    hardware: RobotJoint
    _described: JointLimits | None = None

    def __init__(self) -> None:
        super().__init__(Ros2ControlConfig)
        self.health.values["if killed"] = IF_KILLED
        self.get_logger().warning(f"if this node is killed, {IF_KILLED}")

    def make(self, config: Ros2ControlConfig) -> RobotJoint:
        if self.resolve_topic_name(STATES) == self.resolve_topic_name("joint_states"):
            raise InputError(f"{self.get_name()}: namespace", "that of the robot's joint_states", "one of the axis' own")
        self._joint = config.joint or self.file.axis.name
        made = RobotJoint(self, self._joint, config.controller, config.manager, others_of(config.others, self._others_name))
        if config.urdf not in ("", NO_URDF):
            self._described = load_joint_limits(Path(config.urdf), self._joint)
        elif not config.urdf:
            made.needed = f"no {DESCRIPTION} yet; without one set urdf to a file or to {NO_URDF}"
            self.create_subscription(String, DESCRIPTION, self._on_description, LATCHED)
        return made

    @property
    def _others_name(self) -> str:
        return f"{self.get_name()}: parameter others"

    def check(self, config: Ros2ControlConfig, file: AxisFile) -> None:
        super().check(config, file)
        if self._opened and (config.joint or file.axis.name) != self._joint:
            raise InputError(f"{self.get_name()}: axis", file.axis.name, f"{self._joint}, the joint, until a restart")
        self._within(self._described, config, file)

    def configure(self, config: Ros2ControlConfig) -> None:
        super().configure(config)
        self.hardware.configure(config)

    def limits(self, config: Ros2ControlConfig) -> TorqueLimits:
        limits, described = self._within(self._described, config, self.file), self._described
        travel = f"{limits.travel_from:g} to {limits.travel_to:g} rad"
        believed = f"; URDF: friction {described.friction:g} N m, damping {described.damping:g} N m s/rad" if described else ""
        values = f"{limits.torque_limit:g} N m, {limits.overspeed:g} rad/s, {travel}{believed}"
        if values != self.health.values.get("limits"):
            self.get_logger().info(f"limits: {values}")
        self.health.values["limits"] = values
        return limits

    def _within(self, described: JointLimits | None, config: Ros2ControlConfig, file: AxisFile) -> TorqueLimits:
        """The smaller limits. Raises InputError where description and axis cannot be the same thing."""
        if described is None:
            return config
        where = f"{self.get_name()}: URDF of joint {config.joint or file.axis.name}"
        if described.kind != file.axis.kind:
            raise InputError(where, f"a {described.kind} joint", f"a {file.axis.kind} one, as the axis file says")
        return described.within(config, where)

    def _on_description(self, message: String) -> None:
        """A description, also a later one: its limits hold at once. One that cannot be used changes nothing, and is named."""
        try:
            described = joint_limits(message.data, self._joint, DESCRIPTION)
            self._within(described, self.config, self.file)
        except InputError as error:
            self.health.fail("description", one_line(str(error)))
            return
        self.health.well("description")
        self._described, self.hardware.needed = described, ""
        self.use_limits(self.config)

    def destroy_node(self) -> None:
        """Torque goes over `stop_time` here too; zero is the last thing that is sent."""
        self.hardware.fade(self.config.stop_time)
        super().destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Ros2ControlDriver, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
