"""What an axis can do at all, from its axis file: ranges beyond which an input is a mistake, and limits of a safe motion.

The nodes refuse an input outside the ranges, in lock-step as in real time. The motion limits are those of a reference in
real time.
"""

from __future__ import annotations

from dataclasses import dataclass

from tcs_friction.control.config_field import setting
from tcs_friction.control.pid import PidConfig
from tcs_friction.physics.axis import Axis

RANGE_OVER_LIMIT = 10.0
"""Range of plausible speeds over the speed that the controller may command: an axis that is pushed is faster than it should."""
ACCELERATION_MARGIN = 2.0
"""Over what the torque limit and the believed inertia give: the inertia may be less, and a load may push."""
NOISE_MULTIPLE = 10.0
"""Error of a position over resolution and RMS noise of the encoder."""
NOISE_TIME = 1e-3
"""s at the largest speed: error of a position where nobody has stated the encoder."""
OWN_SHARE = 0.5
"""Share of the torque limit that a compensation may take: as much is left for the controller to hold against a wrong one."""
FRICTION_MARGIN = 1.5
"""What a compensation may be over the believed dry friction, where that takes more than its share."""
SPEED_SHARE = 0.8
"""Share of the controller's speed limit that a reference may ask for; the rest is there to catch up."""
TORQUE_SHARE = 0.2
"""Share of the torque for the acceleration on the way to a programme: gentle, and friction takes its part as well."""
FRICTION_MULTIPLE = 10.0
"""Torque of an axis whose limit nobody has stated, over its dry friction."""
RISE_TIME = 0.1
"""s in which the acceleration rises to its limit: slow against the structure's first mode of a few Hz and more."""
SPEED_UP_TIME = 0.5
"""s to the largest speed, where nobody has stated one."""
FOLLOWING_TIME = 0.05
"""s at the largest speed: how far the axis may be from its reference."""
NO_LIMIT = 1e6
"""A speed limit from here on says that there is none (`config.default_control`)."""


@dataclass(frozen=True)
class Ranges:
    """Inputs beyond these are refused. For a linear axis read m, m/s, N."""

    largest_position: float = setting(1e6, "rad", 1e-9, 1e9, "travel either way: states and references beyond it are refused")
    largest_speed: float = setting(10.0, "rad/s", 1e-9, 1e9, "states and references that are faster are refused, as are jumps")
    largest_torque: float = setting(1e4, "N m", 1e-9, 1e13, "larger torques and friction estimates are refused")
    largest_acceleration: float = setting(
        1e15, "rad/s^2", 1e-9, 1e15, "real time: positions that take more, beyond the reported speed, are refused"
    )
    position_noise: float = setting(0.0, "rad", 0.0, 1e9, "real time: by how much a measured position may be off")
    continuous: bool = False
    """As the axis file says: positions are angles that may begin anew after a turn."""

    def placed(self, position: float) -> float:
        """The first position of an axis, in the turn that is taken for it."""
        return position

    def state_objection(self, position: float, speed: float) -> str:
        """Why a state cannot be, "" when it can. NaN cannot."""
        if not -self.largest_position <= position <= self.largest_position:
            return f"position {position:g}, the travel is {self.largest_position:g}"
        if not -self.largest_speed <= speed <= self.largest_speed:
            return f"speed {speed:g}, the largest is {self.largest_speed:g}"
        return ""

    def torque_objection(self, torque: float) -> str:
        """Why a torque cannot be, "" when it can. NaN cannot."""
        if -self.largest_torque <= torque <= self.largest_torque:
            return ""
        return f"torque {torque:g}, the largest is {self.largest_torque:g}"

    def reference_limits(self, inertia: float) -> tuple[float, float, float]:
        """The largest position, speed and acceleration of a reference to which `reference_objection` does not object."""
        return self.largest_position, self.largest_speed, self.largest_torque / inertia

    def reference_objection(self, inertia: float, position: float, speed: float, acceleration: float) -> str:
        """Why a reference cannot be meant, "" when it can. The largest torque gives the largest acceleration."""
        most = self.reference_limits(inertia)[2]
        if -most <= acceleration <= most:
            return self.state_objection(position, speed)
        return f"acceleration {acceleration:g}"


@dataclass(frozen=True)
class MotionLimits:
    """How a reference may move the axis. For a linear axis read m/s, m/s^2, m/s^3, m."""

    speed_limit: float = setting(0.1, "rad/s", 1e-9, 1e9, "real time: largest speed of the reference")
    acceleration_limit: float = setting(0.2, "rad/s^2", 1e-9, 1e12, "real time: largest acceleration of the reference")
    jerk_limit: float = setting(2.0, "rad/s^3", 1e-9, 1e15, "real time: largest jerk on the way to a programme")
    following_limit: float = setting(
        5e-3, "rad", 1e-12, 1e9, "real time: a reference farther than this from the axis is given up"
    )


def ranges(axis: Axis, controller: PidConfig) -> Ranges:
    """The ranges that an axis and the limits of its controller imply."""
    speed = controller.velocity_limit
    if speed >= NO_LIMIT:
        speed = motion_limits(axis, controller).speed_limit
    encoder = NOISE_MULTIPLE * (axis.sensors.resolution + axis.sensors.noise)
    return Ranges(
        largest_speed=min(RANGE_OVER_LIMIT * speed, 1e9),
        largest_torque=min(RANGE_OVER_LIMIT * controller.torque_limit, 1e13),
        largest_acceleration=min(ACCELERATION_MARGIN * controller.torque_limit / axis.inertia, 1e15),
        position_noise=min(encoder or NOISE_TIME * speed, 1e9),
        continuous=axis.continuous,
    )


def heard_ranges(axis: Axis, controller: PidConfig | None) -> Ranges:
    """The ranges for nodes that only listen: wide where nobody has said how the axis is controlled, which may be any machine."""
    if controller is None:
        return Ranges(largest_speed=1e9, largest_torque=1e13, continuous=axis.continuous)
    return ranges(axis, controller)


def compensation_limit(axis: Axis, controller: PidConfig) -> float:
    """Largest torque (N m) that makes sense as a compensation of friction."""
    share = max(OWN_SHARE * controller.torque_limit, FRICTION_MARGIN * dry_friction(axis))
    return min(share, controller.torque_limit)


def dry_friction(axis: Axis) -> float:
    """The largest friction torque at rest that is believed of an axis (N m), 0 where its law has none of the usual names."""
    return max(axis.friction.values.get(name, 0.0) for name in ("coulomb", "static"))


def motion_limits(axis: Axis, controller: PidConfig) -> MotionLimits:
    """The motion limits that an axis and the limits of its controller imply."""
    dry = dry_friction(axis)
    torque = min(controller.torque_limit, FRICTION_MULTIPLE * dry) if dry > 0.0 else controller.torque_limit
    acceleration = min(TORQUE_SHARE * torque / axis.inertia, 1e12)
    speed = SPEED_SHARE * controller.velocity_limit
    if controller.velocity_limit >= NO_LIMIT:
        speed = min(SPEED_UP_TIME * acceleration, 1e9)
    return MotionLimits(speed, acceleration, acceleration / RISE_TIME, FOLLOWING_TIME * speed)
