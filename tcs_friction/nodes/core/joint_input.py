"""Joint states as the nodes of the loop take them: of one joint, in range, in order; what is refused is reported."""

from __future__ import annotations

import math
import time
from typing import Protocol

from tcs_friction.control.stamps import (
    NEW_RUN,
    NEXT,
    REFUSED,
    REPEATED,
    SECOND,
    FollowRule,
    RecentStates,
    Step,
)
from tcs_friction.control.turns import beside
from tcs_friction.nodes.core.health import Health, Level
from tcs_friction.nodes.core.input_settings import InputSettings
from tcs_friction.nodes.core.joint_states import CommandedTorque
from tcs_friction.nodes.core.wire import JointWire

TOPIC = "joint_states"


class JointSettings(InputSettings, Protocol):
    """What it says about joint states beside that."""

    @property
    def largest_position(self) -> float: ...
    @property
    def largest_speed(self) -> float: ...
    @property
    def largest_torque(self) -> float: ...
    @property
    def largest_acceleration(self) -> float: ...
    @property
    def position_noise(self) -> float: ...
    @property
    def continuous(self) -> bool: ...
    def placed(self, position: float) -> float: ...


class JointInput:
    """The newest acceptable state of a joint. A driver that gives no speed gets the difference of its positions.

    The angles of a continuous axis, which may begin anew after a turn, go on over its turns.
    `level` says how bad it is in real time when none comes.
    """

    def __init__(self, health: Health, lock_step: bool, level: Level = Level.ERROR) -> None:
        self.stamp = -1
        self.position = self.speed = self.torque = math.nan
        self.contradicted = -math.inf
        """When a state was heard last that contradicts the others, steady time: a second publisher does that."""
        self.recent = RecentStates(math.inf)
        """Real time: the states that an answer may be about."""
        self._health, self._lock_step = health, lock_step
        self._rule = FollowRule(lock_step)
        self._judge = self._rule.judge
        self._wire = JointWire("")
        if not lock_step:
            health.expect(TOPIC, level)

    def configure(self, joint: str, config: JointSettings) -> None:
        """Another joint or other limits; what was heard stays."""
        self._config = config
        self._objection, self._continuous = config.state_objection, config.continuous
        self._farthest, self._fastest = config.largest_position, config.largest_speed
        limits = (config.largest_speed, config.period, config.largest_acceleration, config.position_noise)
        self._rule.configure(config.age_limit, config.patience, *limits, config.continuous)
        self.recent.configure(config.age_limit)
        if joint != self._wire.joint:
            self._wire = JointWire(joint)

    def take(self, data: bytes) -> Step:
        """Judge a serialised JointState; the attributes are those of the newest state that was not refused."""
        stamp, angle, reported, torque = self._wire.read(data)
        position = self._over_turns(stamp, angle, reported) if self._continuous else angle
        speed = reported if reported == reported else self._difference(stamp, position)
        farthest, fastest = self._farthest, self._fastest  # compared here, for a call takes longer than all of them
        if not (-farthest <= position <= farthest and -fastest <= speed <= fastest):
            if position == position or self._wire.is_about(data):
                objection = self._objection(position, speed) if stamp >= 0 else "not readable"
                self._health.refuse(f"{TOPIC} refused: {objection}")
            return REFUSED
        if not self._lock_step:
            step = self._judge_in_real_time(stamp, position, reported)
        else:
            step = self._judge_over_turns(stamp, position, reported) if self._continuous else self._judge(stamp)
        if step is NEXT or step is NEW_RUN:
            if self._continuous and (step is NEW_RUN or self.stamp < 0):
                position = self._config.placed(angle)
            self.stamp = stamp
            self.position = position
            self.speed = speed
            self.torque = torque
        return step

    def beside(self, position: float) -> float:
        """A position in the turn of the newest state, where the axis is continuous; what others say may be turns away."""
        return beside(position, self.position) if self._continuous else position

    def acted(self, commanded: CommandedTorque) -> float:
        """Torque (N m) until the newest state, the command's where the driver gives none; NaN where none is known.

        One that cannot be is refused with a report.
        """
        torque = self.torque if self.torque == self.torque else commanded.until(self.stamp)
        if abs(torque) > self._config.largest_torque:
            self._health.refuse(f"{TOPIC} refused: {self._config.torque_objection(torque)}")
            return math.nan
        return torque

    def _judge_over_turns(self, stamp: int, position: float, speed: float) -> Step:
        """Lock-step, of a continuous axis."""
        step = self._judge(stamp, position, 0.0, speed)
        if step is REFUSED:
            self._health.refuse(f"{TOPIC} refused: {self._rule.reason}")
        return step

    def _judge_in_real_time(self, stamp: int, position: float, speed: float) -> Step:
        now = time.monotonic()
        step = self._judge(stamp, position, now, speed)
        if step is REFUSED:
            self._refuse(self._rule.reason, now)
        elif step is not REPEATED:
            self.recent.add(stamp)
            self._health.stamp = stamp
            self._health.heard(TOPIC, now, self._config.period)
        elif position != self.position:
            self._refuse("two positions with one stamp", now)
        return step

    def _over_turns(self, stamp: int, angle: float, reported: float) -> float:
        """An angle in the turn in which it follows the newest state."""
        speed = 0.5 * (self.speed + reported) if reported == reported else self.speed
        return beside(angle, self.position + speed * max(stamp - self.stamp, 0) / SECOND)

    def _refuse(self, reason: str, now: float) -> None:
        if reason:
            self._health.disbelieve(TOPIC, reason)
            if self.stamp >= 0:
                self._health.refuse(f"{TOPIC} refused: {reason}")
                self.contradicted = now
            else:  # a start is seldom even; it is named where it leads to nothing
                self._health.refused += 1

    def _difference(self, stamp: int, position: float) -> float:
        """Speed from this position and the one before; 0 for the first."""
        span = (stamp - self.stamp) / SECOND
        if self.stamp < 0 or span < 0.0:
            return 0.0
        return (position - self.position) / span if span > 0.0 else self.speed
