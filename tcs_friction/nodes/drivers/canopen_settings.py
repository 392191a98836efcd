"""What a CANopen drive is told and how its numbers are read: settings, and scales between counts, per mille and SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tcs_friction.control.config_field import setting, text, texts

WRAP = 2**32
"""Counts after which the position of a drive (32 bits) begins anew."""
MOST_PER_MILLE = 32767


@dataclass(frozen=True)
class DriveSettings:
    """One drive with profile CiA 402 on a CAN bus. All of it holds from the start of the node to its end."""

    interface: str = text("socketcan", "python-can's name of the kind of CAN adapter", fixed=True)
    channel: str = text("can0", "the adapter's channel", fixed=True)
    bitrate: int = setting(1000000, "bit/s", 10000, 1000000, "of the bus; a socketcan interface has its own", fixed=True)
    bus_options: tuple[str, ...] = texts("further options of the adapter for python-can, NAME=VALUE each", fixed=True)
    node_id: int = setting(1, "", 1, 127, "the drive's node id", fixed=True)
    own_id: int = setting(127, "", 1, 127, "node id under which this driver sends its heartbeat", fixed=True)
    eds: str = text("", "EDS or DCF file of the drive; none: the objects that every CiA 402 drive has", fixed=True)
    counts_per_turn: float = setting(65536.0, "", 1e-3, 1e12, "position (0x6064) counts in a motor turn", fixed=True)
    speed_per_turn: float = setting(0.0, "", 0.0, 1e12, "speed (0x606C) at one motor turn per s; 0: counts_per_turn", fixed=True)
    gear: float = setting(1.0, "", 1e-9, 1e9, "motor turns in a turn of the axis, or in a metre of a linear one", fixed=True)
    direction: int = setting(1, "", -1, 1, "1 or -1: which way the motor turns when the axis moves upwards", fixed=True)
    position_range: float = setting(
        float(WRAP), "", 1.0, float(WRAP), "counts after which the position (0x6064) begins anew", fixed=True
    )
    zero: float = setting(0.0, "", -1e12, 1e12, "position (0x6064) at which the axis is at 0, counts", fixed=True)
    rated_torque: float = setting(0.0, "N m", 0.0, 1e9, "of the motor; 0: what the drive says in 0x6076", fixed=True)
    current_limit: float = setting(0.0, "A", 0.0, 1e6, "the drive is told with 0x6073; 0: it keeps its own", fixed=True)
    heartbeat: float = setting(0.05, "s", 1e-3, 10.0, "between two heartbeats, of this driver and of the drive", fixed=True)
    enable_time: float = setting(5.0, "s", 0.1, 60.0, "time that the drive gets to become operation enabled", fixed=True)

    def conflict(self) -> list[str]:
        """What does not go together."""
        found = ["direction is 0, expected 1 or -1"] if self.direction == 0 else []
        if self.node_id == self.own_id:
            found.append(f"own_id is {self.own_id}, expected another than node_id")
        bad = [option for option in self.bus_options if option and "=" not in option]
        return found + [f"bus_options has {option!r}, expected NAME=VALUE" for option in bad]

    def bus(self) -> dict[str, object]:
        """Arguments of `can.Bus`; whole numbers and truth values in the options as such."""
        options = dict(option.split("=", 1) for option in self.bus_options if option)
        given = {name.strip(): _value(value.strip()) for name, value in options.items()}
        return {"interface": self.interface, "channel": self.channel, "bitrate": self.bitrate} | given

    @property
    def silence(self) -> float:
        """s without a heartbeat after which the other side is taken for dead."""
        return 3.0 * self.heartbeat


def _value(written: str) -> object:
    if written.lower() in ("true", "false"):
        return written.lower() == "true"
    try:
        return int(written)
    except ValueError:
        return written


class Scale:
    """Between a drive's numbers and those of the axis: rad, rad/s, N m, or m, m/s, N of a linear axis."""

    def __init__(self, settings: DriveSettings, linear: bool, rated_torque: float) -> None:
        """rated_torque: of the motor, N m."""
        turns = settings.direction * settings.gear
        travel = (1.0 if linear else 2.0 * math.pi) / turns  # of the axis, in a motor turn
        self.position_step = travel / settings.counts_per_turn
        self._speed = travel / (settings.speed_per_turn or settings.counts_per_turn)
        self._per_mille = rated_torque * 2.0 * math.pi / travel / 1000.0
        self._range = settings.position_range
        self._turned = 0
        self._zero = settings.zero
        self._last: int | None = None

    def position(self, counts: int) -> float:
        """Where the axis is. Goes on where the drive's counts begin anew."""
        if self._last is not None:
            self._turned -= round((counts - self._last) / self._range)
        self._last = counts
        return (counts + self._turned * self._range - self._zero) * self.position_step

    def speed(self, value: int) -> float:
        """How fast it is."""
        return value * self._speed

    def torque(self, per_mille: float) -> float:
        """Torque at the axis of some per mille of the rated torque; friction of a gear is the axis' own."""
        return per_mille * self._per_mille

    def per_mille(self, torque: float) -> int:
        """What a drive is to be commanded for a torque at the axis."""
        return max(-MOST_PER_MILLE, min(MOST_PER_MILLE, round(torque / self._per_mille)))

    def limit(self, torque: float) -> int:
        """What limits a drive to a torque at the axis: never more than it, and 16 bits."""
        return min(65535, math.floor(torque / abs(self._per_mille) + 1e-9))
