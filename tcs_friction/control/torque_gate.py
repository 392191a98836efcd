"""Real time: what becomes of a torque command at the motor. One rule for the simulated axis and for every driver.

A command acts while everything is well. On any doubt the torque goes to zero over `stop_time`. Beyond the travel, or faster than
`overspeed`, there is at once no torque that way; torque the other way may still act. In both cases torque comes back over the
ramp time. Nothing here knows ROS or hardware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tcs_friction.control.config_field import setting
from tcs_friction.control.fading import Ramp
from tcs_friction.control.turns import Travel


@dataclass(frozen=True)
class TorqueLimits(Travel):
    """What an axis is protected by, whatever it is commanded. For a linear axis read N, m/s, m."""

    torque_limit: float = setting(1e3, "N m", 0.0, 1e12, "commands beyond this are refused")
    overspeed: float = setting(1.0, "rad/s", 1e-9, 1e9, "real time: no torque in the direction of a motion faster than this")
    travel_margin: float = setting(1e9, "rad", 0.0, 1e9, "real time: no torque at all farther than this beyond the travel")
    watchdog: float = setting(0.1, "s", 1e-3, 60.0, "real time: no torque when commands stop for longer")
    state_limit: float = setting(0.1, "s", 1e-3, 60.0, "real time: no torque on a position older than this")
    stop_time: float = setting(0.05, "s", 0.0, 10.0, "real time: torque goes to zero over this time on any doubt")


class Situation(NamedTuple):
    """What is known of an axis at a moment. Times are steady, in s.

    doubt: why the caller wants no torque, "" when nothing is in the way: a fault of the drive, a second master.
    ready: whether torque has an effect; while a drive is being switched on it does not, and the ramp waits.
    """

    now: float
    position: float
    speed: float
    measured: float
    active: bool = True
    doubt: str = ""
    ready: bool = True


class Verdict(NamedTuple):
    """The torque to apply (N m).

    doubt: why it is zero or on its way there, "" when nothing is. limited: why a command does not act that way.
    exceeded: whether speed or travel is beyond its limit, whatever is commanded.
    """

    torque: float
    doubt: str = ""
    limited: str = ""
    exceeded: bool = False


class TorqueGate:
    """Holds the newest command and says at every period what of it may act."""

    def __init__(self, limits: TorqueLimits, ramp_time: float) -> None:
        """ramp_time: s in which torque comes, and goes when the axis is deactivated."""
        self._share, self._up, self._down = Ramp(ramp_time), Ramp(ramp_time), Ramp(ramp_time)
        self.configure(limits, ramp_time)
        self.restart()

    def configure(self, limits: TorqueLimits, ramp_time: float) -> None:
        """Other limits, at any time."""
        self._limits, self._ramp_time = limits, ramp_time
        self._share.duration = self._up.duration = self._down.duration = ramp_time

    def restart(self) -> None:
        """No command has come, and no torque acts."""
        self.forget()
        self._share.value = 0.0
        self._up.value = self._down.value = 1.0

    def forget(self) -> None:
        """A command that came before counts no more. What of it acts still fades out."""
        self._commanded: float | None = None

    _torque = 0.0

    @property
    def share(self) -> float:
        """What share of the command acts, 0 to 1."""
        return self._share.value

    def objection(self, torque: float) -> str:
        """Why a command is refused, "" when it is not. NaN is."""
        limit = self._limits.torque_limit
        return "" if -limit <= torque <= limit else f"{torque:g} N m was refused, the limit is {limit:g}"

    def command(self, torque: float, now: float) -> None:
        """A command to which there is no objection, at a steady time (s)."""
        self._torque, self._commanded = torque, now

    def at(self, situation: Situation, elapsed: float) -> Verdict:
        """What acts for a period that begins now, `elapsed` seconds after the one before."""
        doubt = self._doubt(situation)
        on = not doubt and situation.active and situation.ready
        self._share.duration = self._limits.stop_time if doubt else self._ramp_time
        self._share.toward(on, elapsed)
        above, below = self._against(1.0, situation), self._against(-1.0, situation)
        self._turn(self._up, above, elapsed)
        self._turn(self._down, below, elapsed)
        limit = self._limits.torque_limit
        torque = min(max(self._torque, -limit), limit)
        way, limited = (self._up, above) if torque > 0.0 else (self._down, below)
        share = min(self._share.value, way.value)
        return Verdict(torque * share, doubt, limited if torque and self._share.value else "", bool(above or below))

    def _turn(self, way: Ramp, against: str, elapsed: float) -> None:
        """Torque one way: none as soon as something is against it."""
        way.duration = 0.0 if against else self._ramp_time
        way.toward(not against, elapsed)

    def _doubt(self, situation: Situation) -> str:
        """Why there may be no torque at all, "" for nothing."""
        limits = self._limits
        if not (situation.active or self._share.value):
            return "not active"
        if situation.doubt:
            return situation.doubt
        if not situation.now - situation.measured <= limits.state_limit:
            return f"no position for {limits.state_limit:g} s"
        margin = limits.travel_margin
        if not limits.travel_from - margin <= situation.position <= limits.travel_to + margin:
            return f"position {situation.position:g} rad is more than {margin:g} rad beyond the travel"
        if self._commanded is None or situation.now - self._commanded > limits.watchdog:
            return f"no torque_command for {limits.watchdog:g} s"
        return ""

    def _against(self, way: float, situation: Situation) -> str:
        """Why there is to be no torque upwards (way 1) or downwards (-1), "" for nothing."""
        limits = self._limits
        if not way * situation.speed <= limits.overspeed:
            return f"faster than {limits.overspeed:g} rad/s: no torque that way"
        end = limits.travel_to if way > 0.0 else limits.travel_from
        return f"beyond the travel to {end:g} rad: no torque that way" if way * (situation.position - end) > 0.0 else ""
