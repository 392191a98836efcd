"""The friction observer (disturbance observer, or Kalman by parameter `estimator`): friction torque from torque and speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.observer import FrictionObserver
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import JobError
from tcs_friction.nodes.base import LOCK_STEP, AxisNode, ClockConfig, control_of, derived
from tcs_friction.nodes.calibration import CalibrationMemory, calibrated
from tcs_friction.nodes.convert import SECOND, nanoseconds
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.qos import COLLECT, LISTEN, PUBLISH
from tcs_friction.nodes.wire import ESTIMATE, TORQUE, JointWire


@dataclass(frozen=True)
class DobNodeConfig(ObserverSettings, ClockConfig):
    """The observer's settings and Switch1 of the paper."""

    switch1: bool = switch(False, "Switch1: torque and speed reach the observer")
    compensator: bool = switch(True, "a compensator is part of the loop: its share of the torque is awaited")
    memory: float = setting(600.0, "s", 1.0, 1e5, "for calibration: what is older is forgotten")


def defaults(file: AxisFile) -> DobNodeConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(DobNodeConfig, control.loop, control.observer)


class Dob(AxisNode[DobNodeConfig]):
    """Answers every joint state with an estimate; while Switch1 is off, with one that is not valid."""

    def __init__(self) -> None:
        super().__init__("dob", defaults)
        self._publisher = self.create_publisher(FrictionEstimate, "friction_estimate", PUBLISH)
        self._message = b""
        self._running = False  # Switch1 at the last tick
        self._done = self._pending = -1
        self._input = (0.0, 0.0)  # torque held until the pending stamp, speed measured then
        self._shares: dict[int, float] = {}  # the compensator's torque at the last stamps
        self._position = math.nan
        self._calibration = CalibrationMemory()
        self._waiter = Waiter(self)
        self.start()
        self.create_subscription(AxisTorque, "friction_compensation", self._on_compensation, LISTEN, raw=True)
        self.create_subscription(JointState, "joint_states", self._on_state, LISTEN, raw=True)
        self.create_subscription(WrenchStamped, "dynamometer", self._on_dynamometer, COLLECT)
        self._jobs = Jobs(self, self._waiter, "calibrate", self._calibrate, service=Trigger)

    def check(self, config: DobNodeConfig, file: AxisFile) -> None:  # noqa: ARG002
        config.design(config.period)

    def configure(self, config: DobNodeConfig) -> None:
        super().configure(config)
        self._period_ns = round(config.period * SECOND)
        self._wire = JointWire(self.file.axis.name)
        self._observer = FrictionObserver(config, config.period)
        self._calibration.configure(config.period, config.memory)

    def missing(self) -> str:
        if self._pending != self._done and self._pending >= 0:
            return f"friction_compensation for {(self._pending - self._period_ns) / SECOND:.6f} s"
        return ""

    def _on_compensation(self, data: bytes) -> None:
        stamp, (torque,) = TORQUE.read(data)
        if not math.isfinite(torque):
            self.health.refuse(f"friction_compensation of {torque:g} N m refused")
            return
        self._shares[stamp] = torque
        if len(self._shares) > 3:
            del self._shares[next(iter(self._shares))]
        if self._pending != self._done:
            self._estimate()

    def _on_state(self, data: bytes) -> None:
        stamp, position, speed, torque = self._wire.read(data)
        if stamp == self._done:
            self.health.repeats += 1
            self._publisher.publish(self._message)
            return
        if stamp == self._pending:
            self.health.repeats += 1
            self._estimate(give_up=True)
            return
        if stamp < self._done:  # the clock went back: a new run
            self._observer.reset()
            self._shares.clear()
            self._done = -1
        if math.isnan(speed):  # a driver that gives none
            speed = self._difference(position, stamp)
        if not (math.isfinite(torque) and math.isfinite(speed)):
            self.health.refuse(f"joint {self.file.axis.name} with torque {torque:g} and speed {speed:g} refused")
            return
        self._calibration.state(stamp, torque, speed)
        self._input = (torque, speed)
        self._pending = stamp
        self._estimate()

    def _on_dynamometer(self, message: WrenchStamped) -> None:
        wrench = message.wrench
        torque = wrench.torque.z if self.file.axis.kind == "rotary" else wrench.force.x
        if math.isfinite(torque):
            self._calibration.reading(nanoseconds(message.header.stamp), torque)

    async def _calibrate(self, _: Trigger.Request, __: Trigger.Response, ___: Progress) -> str:
        """From what has been heard since the first reading; the parameters found are used at once."""
        heard, config = self._calibration.comparisons(), self.config
        found = await self._waiter.in_thread(lambda: calibrated(heard, config))
        settings = found.observer
        values = {
            "torque_scale": settings.torque_scale,
            "torque_offset": settings.torque_offset,
            "plant.first": settings.plant.first,
        }
        answer = self.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
        if not answer.successful:
            raise JobError("calibration", answer.reason)
        accuracy = f"{100 * found.accuracy_uniform:.2f} % in uniform motion, {100 * found.accuracy:.2f} % over everything"
        return f"{', '.join(f'{name} {value:.6g}' for name, value in values.items())}; {accuracy}"

    def _difference(self, position: float, stamp: int) -> float:
        """Speed from this position and the one before."""
        before, self._position = self._position, position
        span = (stamp - self._pending) / SECOND
        return (position - before) / span if math.isfinite(before) and span > 0.0 else 0.0

    def _estimate(self, give_up: bool = False) -> None:
        """Publish the estimate for the pending state once the compensator's share of its torque is known."""
        stamp = self._pending
        share = self._share()
        if share is None:
            if not give_up:
                return
            share = 0.0
        if self.config.switch1:
            torque, speed = self._input
            estimate = self._observer.step(torque, speed, share)
            self._message = ESTIMATE.write(stamp, estimate, speed, self._observer.rest, True)
        else:
            if self._running:
                self._observer.reset()
            self._message = ESTIMATE.write(stamp, 0.0, 0.0, 0.0, False)
        self._running = self.config.switch1
        self._done = stamp
        self.health.ticks += 1
        self._publisher.publish(self._message)

    def _share(self) -> float | None:
        """The compensator's torque during the period before the pending state, None when it has yet to come."""
        if not self.config.compensator or self._done < 0:
            return 0.0
        if self.config.clock == LOCK_STEP:
            return self._shares.get(self._done)
        return next(reversed(self._shares.values()), 0.0)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Dob, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
