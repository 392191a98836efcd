"""The friction feed-forward: answers every reference with the torque that the LuGre model wants for it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.parameter import Parameter
from tcs_friction_msgs.msg import AxisReference, AxisTorque, LugreParameters

from tcs_friction.config import AxisFile
from tcs_friction.control.compensator import CompensatorConfig, LugreCompensator
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.fading import Ramp
from tcs_friction.control.plausible import Ranges, ranges
from tcs_friction.control.stamps import NEW_RUN, NEXT, REFUSED, REPEATED, FollowRule, Step
from tcs_friction.errors import InputError
from tcs_friction.nodes.base import AxisNode, ClockConfig, control_of, derived
from tcs_friction.nodes.convert import SECOND, friction_of, nanoseconds
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.qos import LATCHED, LISTEN, PUBLISH
from tcs_friction.nodes.wire import REFERENCE, TORQUE, message_of


@dataclass(frozen=True)
class CompensatorNodeConfig(CompensatorConfig, Ranges, ClockConfig):
    """Both directions' parameters and Switch3 of the paper."""

    switch3: bool = switch(False, "Switch3: the compensation reaches the controller")
    ramp_time: float = setting(0.5, "s", 0.0, 60.0, "real time: the compensation comes and goes with Switch3 over this time")


def defaults(file: AxisFile) -> CompensatorNodeConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(CompensatorNodeConfig, control.loop, control.compensator, ranges(file.axis, control.controller))


class LugreCompensatorNode(AxisNode[CompensatorNodeConfig]):
    """While Switch3 is off the torque published is 0; the bristle starts at rest when it is switched on."""

    def __init__(self) -> None:
        super().__init__("lugre_compensator", defaults)
        self._publisher = self.create_publisher(AxisTorque, "friction_compensation", PUBLISH)
        self._message = b""
        self._identified = 0  # ns, stamp of the parameters taken last
        self._stamp = -1
        self._compensator = LugreCompensator(self.config, self.config.period)
        self._rule = FollowRule(self.lock_step)
        self._ramp = Ramp(self.config.ramp_time)
        if not self.lock_step:
            self.health.expect("reference")
        self.start()
        self.create_subscription(AxisReference, "reference", self._on_reference, LISTEN, raw=True)
        self.create_subscription(LugreParameters, "lugre_parameters", self._on_parameters, LATCHED, raw=True)

    def configure(self, config: CompensatorNodeConfig) -> None:
        if config.period != self.config.period:
            self._compensator = LugreCompensator(config, config.period)
        super().configure(config)
        self._compensator.configure(config)
        self._limits = config.reference_limits(self.file.axis.inertia)
        self._ramp.duration = config.ramp_time
        self._rule.configure(config.age_limit, config.patience, period=config.period)

    def check(self, config: CompensatorNodeConfig, file: AxisFile) -> None:  # noqa: ARG002
        for way in ("positive", "negative"):
            friction = getattr(config, way)
            objection = config.torque_objection(max(friction.coulomb, friction.static))
            if objection:
                raise InputError(f"{self.get_name()}: {way}", objection)

    hears = "reference"

    def _on_reference(self, data: bytes) -> None:
        stamp, numbers = REFERENCE.read(data)
        (position, speed, acceleration), (farthest, fastest, most) = numbers, self._limits
        if not (-farthest <= position <= farthest and -fastest <= speed <= fastest and -most <= acceleration <= most):
            self.health.refuse(f"reference refused: {self.config.reference_objection(self.file.axis.inertia, *numbers)}")
            return
        step = self._rule.judge(stamp) if self.lock_step else self._judge_in_real_time(stamp)
        if step is REFUSED:
            return
        if step is REPEATED:
            if self.lock_step:
                self.health.repeats += 1
                self._publisher.publish(self._message)
            return
        self._message = TORQUE.write(stamp, self._torque(stamp, step, speed, acceleration))
        self._stamp = stamp
        self.health.ticks += 1
        self._publisher.publish(self._message)

    def _judge_in_real_time(self, stamp: int) -> Step:
        now = time.monotonic()
        step = self._rule.judge(stamp, 0.0, now)
        if step is REFUSED and self._rule.reason:
            self.health.refuse(f"reference refused: {self._rule.reason}")
        elif step is NEXT or step is NEW_RUN:
            self.health.heard("reference", now, self.config.period)
        return step

    def _torque(self, stamp: int, step: Step, velocity: float, acceleration: float) -> float:
        """The compensation, 0 while Switch3 is off; in real time it comes and goes over `ramp_time`."""
        share = 1.0 if self.config.switch3 else 0.0
        if not self.lock_step:
            late = step is NEW_RUN or stamp - self._stamp > self.config.age_limit * SECOND
            share = self._ramp.toward(self.config.switch3, 0.0 if late else (stamp - self._stamp) / SECOND)
        if step is NEW_RUN or not share:
            self._compensator.reset()
        if not share:
            return 0.0
        torque = share * self._compensator.step(velocity, acceleration)
        limit = self.config.largest_torque
        if -limit <= torque <= limit:
            return torque
        self._compensator.reset()
        self.health.note(f"compensation reset: {self.config.torque_objection(torque)}")
        return 0.0

    def _on_parameters(self, data: bytes) -> None:
        """Identified parameters become this node's parameters, all of them or none."""
        message = message_of(data, LugreParameters)
        if message is None:
            self.health.refuse("lugre_parameters refused: not readable")
            return
        stamp = nanoseconds(message.header.stamp)
        if 0 < stamp < self._identified:
            return  # latched by another publisher, and replaced since
        self._identified = stamp
        values = friction_of(message)
        result = self.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
        if result.successful:
            self.get_logger().info(f"LuGre parameters taken from {message.source or 'lugre_parameters'}")
        else:
            self.health.refuse(f"lugre_parameters refused: {result.reason}")
            self.get_logger().warning(f"lugre_parameters refused: {result.reason}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(LugreCompensatorNode, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
