"""The double-loop controller: torque from joint state, reference, friction compensation and estimate."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisReference, AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.fading import FadingInput, Ramp
from tcs_friction.control.pid import DoubleLoopPid, PidConfig
from tcs_friction.control.plausible import Ranges, compensation_limit, motion_limits, ranges
from tcs_friction.control.stamps import NEW_RUN, REFUSED, REPEATED, AnswerRule, Step
from tcs_friction.nodes.core.base import derived
from tcs_friction.nodes.core.convert import SECOND
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.managed import ManagedConfig, ManagedNode
from tcs_friction.nodes.core.qos import LATCHED, LISTEN
from tcs_friction.nodes.core.rivals import HeardInput, Rivals
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, TORQUE
from tcs_friction.nodes.loop.gate import LIMITS, OVERSPEED_SHARE, limits_told
from tcs_friction.nodes.loop.model import MeasuredMotion, ModelConfig

COMPENSATION, OBSERVER = "friction_compensation", "friction_estimate"


@dataclass(frozen=True)
class ControllerConfig(PidConfig, ModelConfig, Ranges, ManagedConfig):
    """Gains and limits, and what takes part in the loop."""

    compensator: bool = switch(True, "a compensator is part of the loop: its torque is added")
    observer: bool = switch(True, "an observer is part of the loop: lock-step waits for its estimate")
    feed_back: bool = switch(False, "add the observer's estimate of friction that is not yet cancelled")
    compensation_limit: float = setting(500.0, "N m", 0.0, 1e12, "a larger friction_compensation or residual is refused")
    following_limit: float = setting(
        5e-3, "rad", 1e-12, 1e9, "real time: a reference farther than this from the axis is refused"
    )


def defaults(file: AxisFile) -> ControllerConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    pid = control.controller
    limits = (ranges(file.axis, pid), motion_limits(file.axis, pid))
    share = compensation_limit(file.axis, pid)
    return derived(ControllerConfig, control.loop, pid, *limits, compensation_limit=share)


class Controller(ManagedNode[ControllerConfig]):
    """Answers every joint state with one torque command; in lock-step once all inputs of its stamp are there."""

    def __init__(self) -> None:
        self._motion = MeasuredMotion()
        self._told: tuple[float, float] | None = None  # speed and torque that the driver lets on
        super().__init__("controller", defaults)
        self._publisher = self.create_publisher(AxisTorque, "torque_command", self.publish_profile)
        self._message = b""
        self._pending = self._done = -1
        self._reference: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._reference_stamp = -1
        self._compensation_stamp = self._estimate_stamp = -1
        config = self.config
        self._pid = DoubleLoopPid(config, config.period)
        self._state = JointInput(self.health, self.lock_step)
        self._answers = {name: AnswerRule(self._state.recent) for name in ("reference", COMPENSATION, OBSERVER)}
        self._handlers = {"reference": self._on_reference, COMPENSATION: self._on_compensation, OBSERVER: self._on_estimate}
        self._compensation, self._estimate = (FadingInput(config.age_limit, config.ramp_time) for _ in range(2))
        self._ramp = Ramp(config.ramp_time)
        self.start()
        self.hear_driver(self._on_state, LISTEN)
        self.create_subscription(AxisReference, "reference", self._on_reference, LISTEN, raw=True)
        self.create_subscription(AxisTorque, "friction_compensation", self._on_compensation, LISTEN, raw=True)
        self.create_subscription(FrictionEstimate, "friction_estimate", self._on_estimate, LISTEN, raw=True)
        self.create_subscription(JointState, LIMITS, self._on_limits, LATCHED)
        heard: dict[str, HeardInput] = {"joint_states": self._state, **self._answers}
        self.rivals = Rivals(self, heard)

    def check(self, config: ControllerConfig, file: AxisFile) -> None:
        self._motion.check(config, file)

    def configure(self, config: ControllerConfig) -> None:
        super().configure(config)
        self._pid.configure(self._within(config), config.period, config.entry_time)
        self._motion.configure(config, config.period)
        self._lock_step = self.lock_step
        self._limits = config.reference_limits(self.file.axis.inertia)
        self._state.configure(self.file.axis.name, config)
        self._ramp.duration = config.ramp_time
        for faded in (self._compensation, self._estimate):
            faded.configure(config.age_limit, config.ramp_time)
        if not self._lock_step:
            self._expect_inputs()

    def _on_limits(self, message: JointState) -> None:
        """Those of the driver: a command beyond them would be refused, and a speed beyond them ends the torque."""
        told = limits_told(message, self.file.axis.name)
        if told is None:
            self.health.refuse(f"{LIMITS} refused: not those of {self.file.axis.name}")
            return
        self._told = told
        self._pid.configure(self._within(self.config), time=self.config.entry_time)

    def _within(self, config: ControllerConfig) -> ControllerConfig:
        """The configuration with the smaller limits of its own and the driver's; in lock-step there are its own alone."""
        if self._told is None or self.lock_step:
            return config
        speed, torque = min(config.velocity_limit, self._told[0]), min(config.torque_limit, self._told[1])
        values = f"{torque:g} N m, {speed:g} rad/s"
        narrower = torque < config.torque_limit or speed < OVERSPEED_SHARE * config.velocity_limit
        if narrower and values != self.health.values.get("limits"):
            own = f"{config.torque_limit:g} N m, {config.velocity_limit:g} rad/s"
            self.get_logger().warning(f"limits: {values}, where the driver's are smaller than its own ({own})")
        self.health.values["limits"] = values
        return replace(config, velocity_limit=speed, torque_limit=torque)

    def _expect_inputs(self) -> None:
        """Real time: without a reference there is no torque; without the others there is less accuracy."""
        self.health.expect("reference", Level.ERROR)
        for name, wanted in ((COMPENSATION, self.config.compensator), (OBSERVER, self.config.observer)):
            if wanted:
                self.health.expect(name, Level.WARN)
            else:
                self.health.forget(name)

    names_rate = True

    def missing(self) -> str:
        if self._pending == self._done:
            return ""
        stamps = {
            "reference": self._reference_stamp,
            "friction_compensation": self._compensation_stamp if self._takes_part() else self._pending,
            "friction_estimate": self._estimate_stamp if self.config.observer else self._pending,
        }
        late = [name for name, stamp in stamps.items() if stamp != self._pending]
        return f"{' and '.join(late)} for {self._pending / SECOND:.6f} s"

    # Inputs

    def _on_state(self, data: bytes) -> None:
        step = self._state.take(data)
        if step is REFUSED:
            return
        stamp = self._state.stamp
        if not self._lock_step:
            if step is not REPEATED:
                self._take_due()
                self._command_with_latest(stamp, step)
            return
        if step is REPEATED and stamp == self._done:
            self.health.repeats += 1
            self._publisher.publish(self._message)
            return
        if step is NEW_RUN:
            self._pid.reset()
            self._motion.reset()
            self._done = -1
        self._pending = stamp
        self._command_when_complete()

    def _take_due(self) -> None:
        """Real time: answers that had overtaken their state."""
        for name, rule in self._answers.items():
            for data in rule.due():
                self._handlers[name](data)

    def _early(self, name: str, stamp: int, data: bytes) -> bool:
        return not self._lock_step and self._answers[name].wait(stamp, data)

    def _on_reference(self, data: bytes) -> None:
        stamp, numbers = REFERENCE.read(data)
        if self._early("reference", stamp, data):
            return
        (position, speed, acceleration), (farthest, fastest, most) = numbers, self._limits
        objection = ""
        if not (-farthest <= position <= farthest and -fastest <= speed <= fastest and -most <= acceleration <= most):
            objection = self.config.reference_objection(self.file.axis.inertia, *numbers)
        if not (objection or self._lock_step):
            objection = self._out_of_reach(position)
        if (objection or not self._lock_step) and not self._usable("reference", stamp, numbers, objection):
            return
        self._reference, self._reference_stamp = (self._state.beside(position), speed, acceleration), stamp
        if self._lock_step:
            self._command_when_complete()

    def _on_compensation(self, data: bytes) -> None:
        stamp, numbers = TORQUE.read(data)
        if self._early(COMPENSATION, stamp, data):
            return
        limit = self.config.compensation_limit
        objection = "" if -limit <= numbers[0] <= limit else f"{numbers[0]:g} N m, the limit is {limit:g}"
        if (objection or not self._lock_step) and not self._usable(COMPENSATION, stamp, numbers, objection):
            return
        self._compensation_stamp = stamp
        self._compensation.put(numbers[0], stamp)
        if self._lock_step:
            self._command_when_complete()

    def _on_estimate(self, data: bytes) -> None:
        stamp, numbers = ESTIMATE.read(data)
        if self._early(OBSERVER, stamp, data):
            return
        residual, valid, limit = numbers[2], numbers[3], self.config.compensation_limit
        if not -limit <= residual <= limit or not self._lock_step:
            if not self._usable(OBSERVER, stamp, numbers, self.config.torque_objection(residual)):
                return
            residual = min(max(residual, -limit), limit)
        self._estimate_stamp = stamp
        if valid:
            self._estimate.put(residual, stamp)
        else:
            self._estimate.withdraw()
        if self._lock_step:
            self._command_when_complete()

    def _out_of_reach(self, position: float) -> str:
        away, limit = abs(self._state.beside(position) - self._state.position), self.config.following_limit
        return f"{away:.4g} from the axis, following_limit is {limit:.4g}" if away > limit else ""

    def _usable(self, name: str, stamp: int, numbers: tuple[float, ...], objection: str) -> bool:
        """Whether an input may be used; what is refused is reported. Lock-step asks for what is out of range only."""
        now = time.monotonic()
        if not self._lock_step:
            if self._state.stamp < 0:
                return False  # which states it is about is not known yet
            objection = objection or self._answers[name].objection(stamp, numbers, now)
        if objection:
            self.health.refuse(f"{name} refused: {objection}")
            return False
        if name in self.health.inputs:
            self.health.heard(name, now)
        return True

    # Commands

    def _command_when_complete(self) -> None:
        """Lock-step: command once everything for the pending stamp is there."""
        stamp, config = self._pending, self.config
        if (
            self._reference_stamp != stamp
            or (self._compensation_stamp != stamp and (config.compensator or self._takes_part()))
            or (self._estimate_stamp != stamp and config.observer)
            or self._done == stamp
            or not self.active
        ):
            return
        added = self._added(stamp, self._done < 0)
        position, velocity, acceleration = self._reference
        self._command(stamp, position, velocity, acceleration, added)

    def _takes_part(self) -> bool:
        """Whether the compensator's torque is used, or has yet to fade out."""
        return self.config.compensator or self._compensation.share > 0.0

    def _added(self, stamp: int, at_once: bool) -> float:
        """Compensation and what the observer adds.

        What comes was held by the integrator and is taken out of it; what is switched off is put into it, what is lost is not.
        """
        config, compensation, estimate = self.config, self._compensation, self._estimate
        if at_once:
            return compensation.at_once(stamp, config.compensator) + estimate.at_once(stamp, config.feed_back)
        added = compensation.at(stamp, config.compensator) + estimate.at(stamp, config.feed_back)
        if compensation.entered or estimate.entered:
            self._hand_over(compensation, config.compensator)
            self._hand_over(estimate, config.feed_back)
        return added

    def _hand_over(self, faded: FadingInput, wanted: bool) -> None:
        if faded.rises:
            self._pid.give_up(faded.entered)
        elif not wanted:
            self._pid.take_over(-faded.entered)

    def _command_with_latest(self, stamp: int, step: Step) -> None:
        """Real time: use the latest inputs that are young enough; no torque without a reference that begins at the axis."""
        elapsed = (stamp - self._done) / SECOND if self._done >= 0 else 0.0
        if step is NEW_RUN or elapsed > self.config.age_limit:
            self._begin_anew(step is NEW_RUN)
            elapsed = 0.0
        self._done = stamp
        if not self.active and self._ramp.value == 0.0:
            return
        age = stamp - self._reference_stamp
        if self._reference_stamp < 0:
            pass  # the report says that it is waited for
        elif abs(age) > self.config.age_limit * SECOND:
            self.health.fail("no reference", f"no reference within {self.config.age_limit:g} s: commanding zero torque")
        else:
            self.health.well("no reference")
            if not self.rivals.topics:
                self._command_in_real_time(stamp, age / SECOND, elapsed)
                return
        self._begin_anew(False)
        self._publish(stamp, 0.0)

    def _begin_anew(self, new_run: bool) -> None:
        """Forget the past: the next torque comes from zero. A new run has stamps of its own."""
        self._pid.reset()
        self._motion.reset()
        self._ramp.value = 0.0
        self._compensation.restart()
        self._estimate.restart()
        if new_run:
            self._reference_stamp = -1

    def _command_in_real_time(self, stamp: int, late: float, elapsed: float) -> None:
        """The torque for a reference that is `late` seconds old."""
        self._pid.share_limit(self._ramp.toward(self.active, elapsed))
        added = self._added(stamp, False)
        position, velocity, acceleration = self._reference
        position += velocity * late + 0.5 * acceleration * late * late
        self._command(stamp, position, velocity + acceleration * late, acceleration, added)

    def _command(self, stamp: int, position: float, velocity: float, acceleration: float, added: float) -> None:
        state = self._state
        measured = self._motion.at(state.position, state.speed)
        torque = self._pid.step(*measured, position, velocity, acceleration, added)
        if not math.isfinite(torque):
            self._begin_anew(False)
            self.health.note("the controller's state left the range of numbers: reset, zero torque")
            torque = 0.0
        self._publish(stamp, torque)

    def _publish(self, stamp: int, torque: float) -> None:
        self._message = TORQUE.write(stamp, torque)
        self._done = stamp
        self._publisher.publish(self._message)
        self.health.ticks += 1


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Controller, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
