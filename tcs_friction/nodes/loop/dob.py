"""The friction observer (disturbance observer, or Kalman by parameter `estimator`): friction torque from torque and speed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.fading import FadingInput
from tcs_friction.control.observer import FrictionObserver
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.plausible import Ranges, ranges
from tcs_friction.control.stamps import NEW_RUN, REFUSED, REPEATED, AnswerRule
from tcs_friction.errors import JobError
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived
from tcs_friction.nodes.core.convert import SECOND, nanoseconds
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.joint_states import CommandedTorque
from tcs_friction.nodes.core.qos import COLLECT, LISTEN
from tcs_friction.nodes.core.wire import ESTIMATE, TORQUE
from tcs_friction.nodes.loop.calibration import CalibrationMemory, calibrated
from tcs_friction.nodes.loop.model import MeasuredMotion, ModelConfig

COMPENSATION = "friction_compensation"
READING_AGE = 2.0
"""s by which a dynamometer's stamp may differ from that of the newest state: a gauge may take one second to answer."""


@dataclass(frozen=True)
class DobNodeConfig(ObserverSettings, ModelConfig, Ranges, ClockConfig):
    """The observer's settings and Switch1 of the paper."""

    switch1: bool = switch(False, "Switch1: torque and speed reach the observer")
    compensator: bool = switch(True, "a compensator is part of the loop: its share of the torque is awaited")
    ramp_time: float = setting(0.5, "s", 0.0, 60.0, "real time: as the controller's, over which a compensation comes and goes")
    memory: float = setting(600.0, "s", 1.0, 1e5, "for calibration: what is older is forgotten")


def defaults(file: AxisFile) -> DobNodeConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(DobNodeConfig, control.loop, control.observer, ranges(file.axis, control.controller))


class Dob(AxisNode[DobNodeConfig]):
    """Answers every joint state with an estimate; while Switch1 is off, with one that is not valid."""

    def __init__(self) -> None:
        self._motion = MeasuredMotion()
        super().__init__("dob", defaults)
        self._publisher = self.create_publisher(FrictionEstimate, "friction_estimate", self.publish_profile)
        self._message = b""
        self._running = False  # Switch1 at the last tick
        self._done = self._pending = -1
        self._state = JointInput(self.health, self.lock_step)
        self._torque = 0.0  # held until the pending stamp
        self._speed = 0.0  # at it
        self._shares: dict[int, float] = {}  # lock-step: the compensator's torque at the last stamps
        self._answers = AnswerRule(self._state.recent)
        self._faded = FadingInput(self.config.age_limit, self.config.ramp_time)
        self._commanded = CommandedTorque(self)
        self._calibration = CalibrationMemory()
        self._waiter = Waiter(self)
        self.start()
        self.create_subscription(AxisTorque, "friction_compensation", self._on_compensation, LISTEN, raw=True)
        self.hear_driver(self._on_state, LISTEN)
        self.create_subscription(WrenchStamped, "dynamometer", self._on_dynamometer, COLLECT)
        self._jobs = Jobs(self, self._waiter, "calibrate", self._calibrate, service=Trigger)

    def check(self, config: DobNodeConfig, file: AxisFile) -> None:
        config.design(config.period)
        self._motion.check(config, file)

    def configure(self, config: DobNodeConfig) -> None:
        super().configure(config)
        self._period_ns = round(config.period * SECOND)
        self._limit = config.largest_torque
        self._motion.configure(config, self.file, config.period)
        self._state.configure(self.file.axis.name, config)
        self._faded.configure(config.age_limit, config.ramp_time)
        if not self.lock_step:
            if config.compensator:
                self.health.expect(COMPENSATION, Level.WARN)
            else:
                self.health.forget(COMPENSATION)
        self._observer = FrictionObserver(config, config.period)
        self._calibration.configure(config.period, config.memory)

    def missing(self) -> str:
        if self._pending != self._done and self._pending >= 0:
            return f"friction_compensation for {(self._pending - self._period_ns) / SECOND:.6f} s"
        return ""

    def _on_compensation(self, data: bytes) -> None:
        stamp, numbers = TORQUE.read(data)
        if not self.lock_step and self._answers.wait(stamp, data):
            return
        plausible = -self._limit <= numbers[0] <= self._limit
        if not (plausible and self.lock_step):
            objection = "" if plausible else self.config.torque_objection(numbers[0])
            if plausible and self._state.stamp >= 0:
                objection = self._take_in_real_time(stamp, numbers)
            if objection:
                self.health.refuse(f"{COMPENSATION} refused: {objection}")
            return
        self._shares[stamp] = numbers[0]
        if len(self._shares) > 3:
            del self._shares[next(iter(self._shares))]
        if self._pending != self._done:
            self._estimate()

    def _take_in_real_time(self, stamp: int, numbers: tuple[float, ...]) -> str:
        """Why the compensator's torque cannot be used, "" when it is."""
        now = time.monotonic()
        objection = self._answers.objection(stamp, numbers, now)
        if not objection:
            self._faded.put(numbers[0], stamp)
            if COMPENSATION in self.health.inputs:
                self.health.heard(COMPENSATION, now)
        return objection

    def _on_state(self, data: bytes) -> None:
        step = self._state.take(data)
        if step is REFUSED:
            return
        if step is REPEATED:
            self._repeat()
            return
        for early in self._answers.due():
            self._on_compensation(early)
        stamp, torque = self._state.stamp, self._state.torque
        if torque != torque:  # a driver that gives none
            torque = self._commanded.until(stamp)
        if not -self._limit <= torque <= self._limit:
            self.health.refuse(f"joint_states refused: {self.config.torque_objection(torque)}")
            return
        if step is NEW_RUN or (not self.lock_step and stamp - self._done > self.config.age_limit * SECOND):
            self._begin_anew()
        _, self._speed = self._motion.at(self._state.position, self._state.speed)
        self._calibration.state(stamp, torque, self._speed)
        self._pending, self._torque = stamp, torque
        self._estimate()

    def _repeat(self) -> None:
        """Lock-step: the same answer again, or one without the compensator's share if that is what nobody gives."""
        if not self.lock_step or self._pending < 0:
            return
        self.health.repeats += 1
        if self._pending == self._done:
            self._publisher.publish(self._message)
        else:
            self._estimate(give_up=True)

    def _begin_anew(self) -> None:
        """Forget the past: a new run, or in real time a gap that no observer bridges."""
        self._observer.reset()
        self._motion.reset()
        self._shares.clear()
        self._faded.restart()
        self._done = -1

    def _on_dynamometer(self, message: WrenchStamped) -> None:
        wrench, stamp = message.wrench, nanoseconds(message.header.stamp)
        torque = wrench.torque.z if self.file.axis.kind == "rotary" else wrench.force.x
        objection = self.config.torque_objection(torque) or self._stamp_objection(stamp)
        if objection:
            self.health.refuse(f"dynamometer refused: {objection}")
        else:
            self._calibration.reading(stamp, torque)

    def _stamp_objection(self, stamp: int) -> str:
        """Why a reading cannot be of now. In lock-step stamps are simulated time, and an older one is another run."""
        if stamp < 0:
            return f"stamp of {stamp / SECOND:g} s is no time"
        if self.lock_step:
            return ""
        away = (stamp - self._state.stamp) / SECOND
        if abs(away) > READING_AGE:
            side = "older" if away < 0.0 else "newer"
            return f"stamp {abs(away):.6g} s {side} than the newest state, the limit is {READING_AGE:g} s"
        return "stamp older than that of the one before" if stamp < self._calibration.last_reading else ""

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

    def _estimate(self, give_up: bool = False) -> None:
        """Publish the estimate for the pending state once the compensator's share of its torque is known."""
        stamp = self._pending
        share = self._share()
        if share is None:
            if not give_up:
                return
            share = 0.0
        if self.config.switch1:
            speed = self._speed
            estimate = self._observer.step(self._torque, speed, share)
            if not -self._limit <= estimate <= self._limit:
                estimate = self._reset_observer(estimate)
            self._message = ESTIMATE.write(stamp, estimate, speed, self._observer.rest, True)
        else:
            if self._running:
                self._observer.reset()
            self._message = ESTIMATE.write(stamp, 0.0, 0.0, 0.0, False)
        self._running = self.config.switch1
        self._done = stamp
        self.health.ticks += 1
        self._publisher.publish(self._message)

    def _reset_observer(self, estimate: float) -> float:
        """Internal state that cannot be is not kept: the observer begins anew with the next state."""
        self._observer.reset()
        self.health.note(f"observer reset: its {self.config.torque_objection(estimate)}")
        return 0.0

    def _share(self) -> float | None:
        """The compensator's torque during the period before the pending state, None when it has yet to come."""
        if not self.config.compensator or self._done < 0:
            return 0.0
        return self._shares.get(self._done) if self.lock_step else self._faded.at(self._pending)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Dob, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
