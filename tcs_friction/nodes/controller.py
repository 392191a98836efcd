"""The double-loop controller: torque from joint state, reference, friction compensation and estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisReference, AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.pid import DoubleLoopPid, PidConfig
from tcs_friction.nodes.base import LOCK_STEP, AxisNode, ClockConfig, control_of, derived
from tcs_friction.nodes.convert import SECOND
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.qos import LISTEN, PUBLISH
from tcs_friction.nodes.wire import ESTIMATE, REFERENCE, TORQUE, JointWire


@dataclass(frozen=True)
class ControllerConfig(PidConfig, ClockConfig):
    """Gains and limits, and what takes part in the loop."""

    compensator: bool = switch(True, "a compensator is part of the loop: its torque is added")
    observer: bool = switch(True, "an observer is part of the loop: lock-step waits for its estimate")
    feed_back: bool = switch(False, "add the observer's estimate of friction that is not yet cancelled")
    age_limit: float = setting(0.1, "s", 1e-3, 10.0, "real time: older inputs are not used")


def defaults(file: AxisFile) -> ControllerConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(ControllerConfig, control.loop, control.controller)


class Controller(AxisNode[ControllerConfig]):
    """Answers every joint state with one torque command; in lock-step once all inputs of its stamp are there."""

    def __init__(self) -> None:
        super().__init__("controller", defaults)
        self._publisher = self.create_publisher(AxisTorque, "torque_command", PUBLISH)
        self._message = b""
        self._pending = self._done = -1
        self._position = self._velocity = 0.0
        self._reference: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._reference_stamp = -1
        self._compensation, self._compensation_stamp = 0.0, -1
        self._residual, self._estimate_stamp = 0.0, -1
        self._pid = DoubleLoopPid(self.config, self.config.period)
        self.start()
        self.create_subscription(JointState, "joint_states", self._on_state, LISTEN, raw=True)
        self.create_subscription(AxisReference, "reference", self._on_reference, LISTEN, raw=True)
        self.create_subscription(AxisTorque, "friction_compensation", self._on_compensation, LISTEN, raw=True)
        self.create_subscription(FrictionEstimate, "friction_estimate", self._on_estimate, LISTEN, raw=True)

    def configure(self, config: ControllerConfig) -> None:
        if config.period != self.config.period:
            self._pid = DoubleLoopPid(config, config.period)
        super().configure(config)
        self._pid.configure(config)
        self._lock_step = config.clock == LOCK_STEP
        self._wire = JointWire(self.file.axis.name)

    def missing(self) -> str:
        if self._pending == self._done:
            return ""
        stamps = {
            "reference": self._reference_stamp,
            "friction_compensation": self._compensation_stamp if self.config.compensator else self._pending,
            "friction_estimate": self._estimate_stamp if self.config.observer else self._pending,
        }
        late = [name for name, stamp in stamps.items() if stamp != self._pending]
        return f"{' and '.join(late)} for {self._pending / SECOND:.6f} s"

    # Inputs

    def _on_state(self, data: bytes) -> None:
        stamp, position, velocity, _ = self._wire.read(data)
        if stamp == self._done:
            self.health.repeats += 1
            self._publisher.publish(self._message)
            return
        if not (math.isfinite(position) and math.isfinite(velocity)):
            self.health.refuse(f"joint {self.file.axis.name} at {position:g} with speed {velocity:g} refused")
            return
        if stamp < self._done:  # the clock went back: a new run
            self._pid.reset()
        self._pending, self._position, self._velocity = stamp, position, velocity
        if self._lock_step:
            self._command_when_complete()
        else:
            self._command_with_latest(stamp)

    def _on_reference(self, data: bytes) -> None:
        stamp, numbers = REFERENCE.read(data)
        if not math.isfinite(sum(numbers)):
            self.health.refuse("reference {:g}, {:g}, {:g} refused".format(*numbers))
            return
        self._reference, self._reference_stamp = numbers, stamp
        if self._lock_step:
            self._command_when_complete()

    def _on_compensation(self, data: bytes) -> None:
        stamp, (torque,) = TORQUE.read(data)
        if not math.isfinite(torque):
            self.health.refuse(f"friction_compensation of {torque:g} N m refused")
            return
        self._compensation, self._compensation_stamp = torque, stamp
        if self._lock_step:
            self._command_when_complete()

    def _on_estimate(self, data: bytes) -> None:
        stamp, (_, _, residual, _) = ESTIMATE.read(data)
        if not math.isfinite(residual):
            self.health.refuse(f"friction_estimate with residual {residual:g} N m refused")
            return
        self._residual, self._estimate_stamp = residual, stamp
        if self._lock_step:
            self._command_when_complete()

    # Commands

    def _command_when_complete(self) -> None:
        """Lock-step: command once everything for the pending stamp is there."""
        stamp, config = self._pending, self.config
        if (
            self._reference_stamp != stamp
            or (config.compensator and self._compensation_stamp != stamp)
            or (config.observer and self._estimate_stamp != stamp)
            or self._done == stamp
        ):
            return
        added = self._compensation if config.compensator else 0.0
        if config.feed_back:
            added += self._residual
        position, velocity, acceleration = self._reference
        self._command(stamp, position, velocity, acceleration, added)

    def _command_with_latest(self, stamp: int) -> None:
        """Real time: use the latest inputs that are young enough; no torque without a reference."""
        limit = self.config.age_limit * SECOND
        age = stamp - self._reference_stamp
        if self._reference_stamp < 0 or abs(age) > limit:
            self._pid.reset()
            self.health.problem = f"no reference within {self.config.age_limit:g} s: commanding zero torque"
            self._publish(stamp, 0.0)
            return
        self.health.problem = ""
        added = 0.0
        if self.config.compensator and abs(stamp - self._compensation_stamp) <= limit:
            added = self._compensation
        if self.config.feed_back and abs(stamp - self._estimate_stamp) <= limit:
            added += self._residual
        (position, velocity, acceleration), late = self._reference, age / SECOND
        position += velocity * late + 0.5 * acceleration * late * late
        self._command(stamp, position, velocity + acceleration * late, acceleration, added)

    def _command(self, stamp: int, position: float, velocity: float, acceleration: float, added: float) -> None:
        torque = self._pid.step(self._position, self._velocity, position, velocity, acceleration, added)
        self._publish(stamp, torque)
        self.health.ticks += 1

    def _publish(self, stamp: int, torque: float) -> None:
        self._message = TORQUE.write(stamp, torque)
        self._done = stamp
        self._publisher.publish(self._message)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Controller, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
