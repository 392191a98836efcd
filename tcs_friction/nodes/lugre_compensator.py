"""The friction feed-forward: answers every reference with the torque that the LuGre model wants for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.parameter import Parameter
from tcs_friction_msgs.msg import AxisReference, AxisTorque, LugreParameters

from tcs_friction.config import AxisFile
from tcs_friction.control.compensator import CompensatorConfig, LugreCompensator
from tcs_friction.control.config_field import switch
from tcs_friction.nodes.base import AxisNode, ClockConfig, control_of, derived
from tcs_friction.nodes.convert import friction_of
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.qos import LATCHED, LISTEN, PUBLISH
from tcs_friction.nodes.wire import REFERENCE, TORQUE


@dataclass(frozen=True)
class CompensatorNodeConfig(CompensatorConfig, ClockConfig):
    """Both directions' parameters and Switch3 of the paper."""

    switch3: bool = switch(False, "Switch3: the compensation reaches the controller")


def defaults(file: AxisFile) -> CompensatorNodeConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(CompensatorNodeConfig, control.loop, control.compensator)


class LugreCompensatorNode(AxisNode[CompensatorNodeConfig]):
    """While Switch3 is off the torque published is 0; the bristle starts at rest when it is switched on."""

    def __init__(self) -> None:
        super().__init__("lugre_compensator", defaults)
        self._publisher = self.create_publisher(AxisTorque, "friction_compensation", PUBLISH)
        self._message = b""
        self._stamp = -1
        self._compensator = LugreCompensator(self.config, self.config.period)
        self.start()
        self.create_subscription(AxisReference, "reference", self._on_reference, LISTEN, raw=True)
        self.create_subscription(LugreParameters, "lugre_parameters", self._on_parameters, LATCHED)

    def configure(self, config: CompensatorNodeConfig) -> None:
        if config.period != self.config.period:
            self._compensator = LugreCompensator(config, config.period)
        super().configure(config)
        self._compensator.configure(config)

    hears = "reference"

    def _on_reference(self, data: bytes) -> None:
        stamp, (_, velocity, acceleration) = REFERENCE.read(data)
        if stamp == self._stamp:
            self.health.repeats += 1
            self._publisher.publish(self._message)
            return
        if not (math.isfinite(velocity) and math.isfinite(acceleration)):
            self.health.refuse(f"reference with speed {velocity:g}, acceleration {acceleration:g} refused")
            return
        if stamp < self._stamp or not self.config.switch3:  # a new run
            self._compensator.reset()
        on = self.config.switch3
        self._message = TORQUE.write(stamp, self._compensator.step(velocity, acceleration) if on else 0.0)
        self._stamp = stamp
        self.health.ticks += 1
        self._publisher.publish(self._message)

    def _on_parameters(self, message: LugreParameters) -> None:
        """Identified parameters become this node's parameters, all of them or none."""
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
