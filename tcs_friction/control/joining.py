"""Real time: a reference that begins where the axis is and joins its programme within limits of speed, acceleration and jerk.

    rest     hold where the axis came to rest; a programme begins on command only
    joining  on the fastest way within the limits to where the programme begins, with its speed and acceleration
    running  the programme, whose time 0 is the moment of joining
    stopping slow down to rest within the limits: on command, and when the programme is over

When the axis is elsewhere than the reference, or has not been heard for a while, the reference begins again where the axis
is, slows down to rest from the speed it has, and stays. The ways are those of Ruckig (Berscheid and Kroeger 2021,
arXiv:2105.04830), time-optimal and exact. With limits of very different size it runs out of digits and finds none; a reference
that has to slow down does so at a constant deceleration then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import ruckig

from tcs_friction.control.plausible import MotionLimits
from tcs_friction.control.reference import Reference, Steps
from tcs_friction.errors import InputError, JobError

Sample = tuple[float, float, float]
CHECKED = 20_000
"""Instants of a programme whose speed and acceleration are checked."""


class Phase(Enum):
    """What the reference is doing."""

    REST = "rest"
    JOINING = "joining"
    RUNNING = "running"
    STOPPING = "stopping"


class JoinedReference:
    """Where the axis should be. To be told with `begin_at` where it is before anything else; times in s."""

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self.phase = Phase.REST
        self._way: ruckig.Trajectory | _Braking | None = None
        self._since = 0.0  # of the way, or of the programme
        self._programme: Reference | None = None
        self._shift = 0.0  # of the programme's positions
        self._last = (0.0, 0.0, 0.0)

    def begin_at(self, t: float, position: float, speed: float) -> None:
        """Begin at a position and speed at time t, slow down to rest and stay."""
        self._last = (position, speed, 0.0)
        self._stop_at(t)

    def join(self, t: float, programme: Reference, shift: float = 0.0) -> float:
        """Begin a programme from where the reference is at time t; returns the seconds until it is joined.

        shift: what is added to its positions, rad. Raises InputError when the programme does not keep the limits.
        """
        check_programme(programme, self.limits)
        self._way = _way(self.at(t), self.limits, _shifted(programme.at(0.0), shift))
        self._since, self._programme, self._shift, self.phase = t, programme, shift, Phase.JOINING
        return float(self._way.duration)

    def stop(self, t: float) -> float:
        """Slow down to rest from time t on; returns how long that takes, in s."""
        self.at(t)
        self._stop_at(t)
        return float(self._way.duration) if self._way else 0.0

    def at(self, t: float) -> Sample:
        """Position (rad), speed (rad/s) and acceleration (rad/s^2) at time t, which must not go back."""
        if self._way is not None and t >= self._since + self._way.duration:
            self._arrive()
        if self.phase is Phase.RUNNING and self._programme is not None:
            end = self._since + self._programme.duration
            if t > end:
                self._last = _shifted(self._programme.at(self._programme.duration), self._shift)
                self._stop_at(end)
            else:
                self._last = _shifted(self._programme.at(t - self._since), self._shift)
        if self._way is not None:
            self._last = _sample(self._way, t - self._since)
        return self._last

    @property
    def programme_time(self) -> float:
        """Moment at which the running programme had its time 0, s."""
        return self._since

    def _arrive(self) -> None:
        """At the end of a way: the programme begins, or rest."""
        assert self._way is not None
        self._since += self._way.duration
        if self.phase is Phase.JOINING:
            self.phase = Phase.RUNNING
        else:
            self.phase = Phase.REST
            self._last = (_sample(self._way, self._way.duration)[0], 0.0, 0.0)
        self._way = None

    def _stop_at(self, t: float) -> None:
        try:
            self._way = _way(self._last, self.limits)
        except JobError:
            self._way = _Braking(self._last[0], self._last[1], self.limits.acceleration_limit)
        self._since, self._programme, self.phase = t, None, Phase.STOPPING


def extent(programme: Reference) -> tuple[float, float]:
    """The lowest and the highest position (rad) of a programme."""
    position = programme.over(np.linspace(0.0, programme.duration, CHECKED))[:, 0]
    return float(position.min()), float(position.max())


def check_programme(programme: Reference, limits: MotionLimits) -> None:
    """Raises InputError when a programme is faster or accelerates more than the limits allow, JobError when it cannot be joined.

    Steps are jumps on purpose; they must be smaller than the following limit.
    """
    times = np.linspace(0.0, programme.duration, CHECKED)
    _, speed, acceleration = np.abs(programme.over(times)).max(axis=0)
    jump = abs(programme.config.height) if isinstance(programme.config, Steps) else 0.0
    for what, found, limit, name in (
        ("speed", speed, limits.speed_limit, "speed_limit"),
        ("acceleration", acceleration, limits.acceleration_limit, "acceleration_limit"),
        ("step", jump, limits.following_limit, "following_limit"),
    ):
        if not found <= limit:
            raise InputError("reference", f"a {what} of {found:.4g}", f"at most {name}, {limit:.4g}")
    _way((programme.at(0.0)[0], 0.0, 0.0), limits, programme.at(0.0))


def _shifted(sample: Sample, shift: float) -> Sample:
    return sample[0] + shift, sample[1], sample[2]


def _way(start: Sample, limits: MotionLimits, end: Sample | None = None) -> ruckig.Trajectory:
    """The fastest way from a state to another, or to rest anywhere; raises JobError where there is none."""
    wanted = ruckig.InputParameter(1)
    wanted.current_position, wanted.current_velocity, wanted.current_acceleration = ([value] for value in start)
    wanted.max_velocity, wanted.max_acceleration = [limits.speed_limit], [limits.acceleration_limit]
    wanted.max_jerk = [limits.jerk_limit]
    if end is None:
        wanted.control_interface = ruckig.ControlInterface.Velocity
        end = (0.0, 0.0, 0.0)
    wanted.target_position, wanted.target_velocity, wanted.target_acceleration = ([value] for value in end)
    way = ruckig.Trajectory(1)
    try:
        result = ruckig.Ruckig(1).calculate(wanted, way)
    except (ruckig.RuckigError, RuntimeError) as error:
        raise JobError("reference", f"no way to the programme ({error})") from None
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise JobError("reference", f"no way from {start} to {end} within the limits ({result})", "lower demands or wider limits")
    return way


@dataclass(frozen=True)
class _Braking:
    """From a position and speed to rest at a constant deceleration. There always is such a way."""

    position: float
    speed: float
    deceleration: float

    @property
    def duration(self) -> float:
        """s until rest."""
        return abs(self.speed) / self.deceleration

    def at_time(self, t: float) -> tuple[list[float], list[float], list[float]]:
        """Position, speed and acceleration after t seconds, as a ruckig.Trajectory gives them."""
        t = min(t, self.duration)
        change = -math.copysign(self.deceleration, self.speed)
        return [self.position + (self.speed + 0.5 * change * t) * t], [self.speed + change * t], [change]


def _sample(way: ruckig.Trajectory | _Braking, t: float) -> Sample:
    position, velocity, acceleration = way.at_time(t)
    return position[0], velocity[0], acceleration[0]
