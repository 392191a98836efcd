"""What every driver has: it publishes what the axis does, and lets on what the torque gate leaves of `torque_command`.

It takes the place and the name of the plant. The limits are here, in the driver, whatever the controller believes.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisTorque

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting
from tcs_friction.control.plausible import RANGE_OVER_LIMIT, ranges
from tcs_friction.control.stamps import AnswerRule, RecentStates
from tcs_friction.control.torque_gate import Situation, TorqueGate, TorqueLimits
from tcs_friction.control.turns import Turns
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.base import LOCK_STEP, REAL_TIME, derived
from tcs_friction.nodes.core.convert import SECOND
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.managed import ManagedConfig, ManagedNode
from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.core.rivals import Rivals
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.core.wire import TORQUE, JointWire
from tcs_friction.nodes.drivers.hardware import Hardware, Measured
from tcs_friction.nodes.loop.gate import LimitsPublisher, say, torque_limits
from tcs_friction.nodes.loop.plant import COMMAND

UNTOLD = 1e9  # rad


@dataclass(frozen=True)
class DriverConfig(TorqueLimits, ManagedConfig):
    """Settings of every driver. Those of the hardware are fixed: they hold from the start of the node to its end."""

    continuous: bool = False
    """As the axis file says: positions of the drive are angles that may begin anew after a turn."""
    start_near: float = setting(
        UNTOLD, "rad", -UNTOLD, UNTOLD, "continuous: where the axis is, within half a turn; 1e9: only the travel tells it"
    )


D = TypeVar("D", bound=DriverConfig)


def driver_defaults(kind: type[D]) -> Callable[[AxisFile], D]:
    """What gives a driver's settings as an axis file implies them."""

    def defaults(file: AxisFile) -> D:
        control = control_of(file)
        return derived(kind, control.loop, ranges(file.axis, control.controller), torque_limits(file), clock=REAL_TIME)

    return defaults


class DriverNode(ManagedNode[D]):
    """A node between the graph and a drive, in real time. Subclasses say what its hardware is."""

    hears = ""
    _opened = False

    def __init__(self, kind: type[D]) -> None:
        super().__init__("plant", driver_defaults(kind))
        self._states = self.create_publisher(JointState, "joint_states", self.publish_profile)
        self._recent = RecentStates(self.config.age_limit)
        self._answers = AnswerRule(self._recent)
        self._gate = TorqueGate(self.config, self.config.ramp_time)
        self._limits = LimitsPublisher(self)
        self._turns = Turns()
        self._measured, self._measured_at = Measured(-1, math.nan, math.nan, math.nan), -math.inf
        self.health.expect(COMMAND, Level.WARN)
        self.hardware = self.make(self.config)
        self.start()
        self.rivals = Rivals(self, {COMMAND: self._answers}, exclusive={COMMAND})
        self.hardware.open(self._on_measured)
        self._opened = True
        self.create_subscription(AxisTorque, COMMAND, self._on_command, LISTEN, raw=True)
        steady_timer(self, self.config.period, self._on_timer)

    @abstractmethod
    def make(self, config: D) -> Hardware:
        """The hardware, not yet opened. Raises InputError where settings cannot be meant."""

    def check(self, config: D, file: AxisFile) -> None:
        super().check(config, file)
        if config.clock == LOCK_STEP:
            raise InputError(f"{self.get_name()}: clock", LOCK_STEP, f"{REAL_TIME}: a drive does not wait")
        if self._opened and config.period != self.config.period:
            raise InputError(f"{self.get_name()}: period", f"{config.period:g} s", f"{self.config.period:g} s until a restart")

    def configure(self, config: D) -> None:
        super().configure(config)
        self._recent.configure(config.age_limit)
        self.use_limits(config)
        self._wire = JointWire(self.file.axis.name)

    def use_limits(self, config: D) -> None:
        """Let the limits hold, and tell them."""
        limits = self.limits(config)
        near = None if config.start_near >= UNTOLD else config.start_near
        self._turns.configure(limits, RANGE_OVER_LIMIT * limits.overspeed, near)
        self._gate.configure(limits, config.ramp_time)
        self._limits.tell(self.file.axis.name, limits)

    def limits(self, config: D) -> TorqueLimits:
        """What holds of the configured limits. For subclasses that know narrower ones."""
        return config

    def state_changed(self) -> None:
        """A command from before the activation counts no more, and a fault is forgotten by activating the node again."""
        if self.active:
            self._gate.forget()
            self.hardware.reset()

    def _on_measured(self, measured: Measured) -> None:
        if measured.stamp == self._measured.stamp:
            return  # a repetition
        if not (math.isfinite(measured.position) and math.isfinite(measured.speed)):
            self.health.refuse(f"position {measured.position:g}, speed {measured.speed:g} of the drive")
            return
        if self.config.continuous:
            position = self._turns.follow(measured.stamp / SECOND, measured.position, measured.speed)
            measured = measured._replace(position=position)
        age = (self.get_clock().now().nanoseconds - measured.stamp) / SECOND
        self._measured, self._measured_at = measured, time.monotonic() - max(age, 0.0)
        self._recent.add(measured.stamp)
        self.health.ticks += 1
        self._states.publish(self._wire.write(*measured))

    def _on_command(self, data: bytes) -> None:
        stamp, numbers = TORQUE.read(data)
        if not (self.active or self._gate.share):
            return
        now = time.monotonic()
        objection = self._gate.objection(numbers[0]) or self._answers.objection(stamp, numbers, now)
        if objection:
            self.health.refuse(f"{COMMAND} ({objection})")
            return
        self._gate.command(numbers[0], now)
        self.health.heard(COMMAND, now)
        self._let_on(now, 0.0)

    _before = -math.inf

    def _on_timer(self) -> None:
        """Once a period, also while nothing comes from anywhere: here the torque ends that nobody commands any more."""
        now, period = time.monotonic(), self.config.period
        if now - self._before > 2.0 * period:
            self.health.overruns += 1
        self._let_on(now, period)
        self._before = now
        self.hardware.tick()

    def _let_on(self, now: float, elapsed: float) -> None:
        hardware, measured = self.hardware, self._measured
        turn = self._turns.unknown if self.config.continuous else ""
        doubt = hardware.fault or hardware.doubt or turn or (f"two publishers of {COMMAND}" if self.rivals.topics else "")
        motion = (measured.position, measured.speed, self._measured_at)
        verdict = self._gate.at(Situation(now, *motion, self.active, doubt, not hardware.waits), elapsed)
        self._say_drive()
        say(verdict, self.health)
        if verdict.doubt and not self._gate.share:
            hardware.stop(verdict.doubt, verdict.exceeded)
        else:
            hardware.apply(verdict.torque)

    def _say_drive(self) -> None:
        """What the drive is at, in the next report."""
        hardware = self.hardware
        if hardware.fault:
            self.health.fail("drive", f"{hardware.fault}; activate the node again when that is mended")
        elif hardware.doubt or hardware.waits:
            self.health.doubt("drive", f"drive: {hardware.doubt or hardware.waits}")
        else:
            self.health.well("drive")
        if hardware.notes:
            self.health.doubt("drive lacks", "; ".join(hardware.notes))
        self.health.values["drive"] = hardware.fault or hardware.doubt or hardware.waits or "on"

    def destroy_node(self) -> None:
        """The drive first: nobody watches it afterwards."""
        self.hardware.stop("the node ends")
        self.hardware.close()
        super().destroy_node()
