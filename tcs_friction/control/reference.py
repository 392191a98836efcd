"""References: where the axis should be at time t, with the exact first and second derivative.

A reference is a frozen configuration of one of the `KINDS`, and may be shaped so that it leaves a flexible mode at rest.
`Reference` evaluates it for one instant (a node's tick) or for an array of instants with the same compiled formula.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tcs_friction.control import reference_kernels as kernels
from tcs_friction.control.config_field import choice, from_mapping, setting, validate
from tcs_friction.control.shaper import NONE, Shaper
from tcs_friction.errors import InputError, nearest
from tcs_friction.yaml_files import load_yaml

_ANGLE = 1e6
"""Largest position, rad or m: a number that is larger is a mistake in the file."""


def _duration() -> Any:
    return setting(60.0, "s", 1e-3, 1e7, "length of the run")


@dataclass(frozen=True)
class Hold:
    """Stay at one position."""

    position: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "position to hold")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (self.position,)


@dataclass(frozen=True)
class ConstantSpeed:
    """Turn at one speed."""

    velocity: float = setting(1.745e-3, "rad/s", -1e3, 1e3, "speed")
    start: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "position at time 0")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (self.velocity, self.start)


@dataclass(frozen=True)
class Sinusoid:
    """center + amplitude sin(2 pi t / period + phase). At phase -pi/2 it starts at rest."""

    amplitude: float = setting(0.01, "rad", 0.0, _ANGLE, "amplitude")
    period: float = setting(20.0, "s", 1e-3, 1e7, "period")
    phase: float = setting(-0.5 * math.pi, "rad", -1e3, 1e3, "phase at time 0")
    center: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "middle of the motion")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (self.amplitude, 2.0 * math.pi / self.period, self.phase, self.center)


@dataclass(frozen=True)
class Multisine:
    """Harmonics of equal speed amplitude, spaced evenly, with Schroeder's phases for a low crest factor."""

    velocity_amplitude: float = setting(1e-3, "rad/s", 0.0, 1e3, "speed amplitude of each component")
    lowest_frequency: float = setting(0.1, "Hz", 1e-6, 1e4, "frequency of the first component")
    frequency_step: float = setting(0.1, "Hz", 1e-6, 1e4, "distance between components")
    components: int = setting(20, "", 1, 10000, "number of components")
    center: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "middle of the motion")
    speed: float = setting(
        0.0, "rad/s", -1e3, 1e3, "mean speed; more than the sines' together, and friction does not reverse"
    )
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (
            self.velocity_amplitude,
            2.0 * math.pi * self.lowest_frequency,
            2.0 * math.pi * self.frequency_step,
            float(self.components),
            self.center,
            self.speed,
        )


@dataclass(frozen=True)
class SweptSine:
    """A sine of constant speed amplitude; its frequency rises exponentially, then stays at the last one."""

    velocity_amplitude: float = setting(1e-3, "rad/s", 0.0, 1e3, "speed amplitude")
    lowest_frequency: float = setting(0.1, "Hz", 1e-6, 1e4, "frequency at the start")
    highest_frequency: float = setting(50.0, "Hz", 1e-6, 1e4, "frequency at the end of the sweep")
    sweep: float = setting(60.0, "s", 1e-3, 1e7, "length of the sweep")
    center: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "middle of the motion")
    speed: float = setting(
        0.0, "rad/s", -1e3, 1e3, "mean speed; more than the sines' together, and friction does not reverse"
    )
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        lowest = 2.0 * math.pi * self.lowest_frequency
        rate = math.log(self.highest_frequency / self.lowest_frequency) / self.sweep
        return (self.velocity_amplitude, lowest, rate, self.sweep, self.center, self.speed)


@dataclass(frozen=True)
class Steps:
    """A staircase up and down again, for ever; speed and acceleration are given as 0."""

    start: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "lowest position")
    height: float = setting(1e-3, "rad", -_ANGLE, _ANGLE, "height of one step")
    dwell: float = setting(5.0, "s", 1e-3, 1e6, "time at each level")
    count: int = setting(1, "", 1, 1000, "steps up before going down")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (self.start, self.height, self.dwell, float(self.count))


@dataclass(frozen=True)
class Legs:
    """Legs of constant speed between smooth reversals, to and fro; starts amid a reversal, at rest.

    Through a reversal the acceleration is a raised cosine up to `acceleration`; lasts 4 speed / acceleration.
    """

    speed: float = setting(1.745e-3, "rad/s", 1e-12, 1e3, "speed of the legs")
    leg: float = setting(10.0, "s", 0.0, 1e6, "time at constant speed between two reversals")
    acceleration: float = setting(5e-3, "rad/s^2", 1e-12, 1e6, "largest acceleration in a reversal")
    start: float = setting(0.0, "rad", -_ANGLE, _ANGLE, "position at time 0")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        return (self.speed, self.leg, 4.0 * self.speed / self.acceleration, self.acceleration, self.start)


@dataclass(frozen=True)
class SatellitePass:
    """A satellite on a circular orbit passes over a station on a sphere that stands still.

    The azimuth grows through the pass and is `azimuth` at culmination.
    """

    axis: str = choice("azimuth", ("azimuth", "elevation"), "which axis of the mount")
    altitude: float = setting(5e5, "m", 1e5, 1e8, "height of the orbit above the ground")
    maximum_elevation: float = setting(1.0, "rad", 0.01, 1.57, "elevation at culmination")
    culmination: float = setting(200.0, "s", -1e6, 1e6, "time of culmination")
    azimuth: float = setting(0.0, "rad", -10.0, 10.0, "azimuth at culmination")
    duration: float = setting(400.0, "s", 1e-3, 1e7, "length of the run")

    def packed(self) -> tuple[float, ...]:
        radius = kernels.EARTH_RADIUS + self.altitude
        rate = math.sqrt(kernels.EARTH_GRAVITY / radius**3)
        sight = math.asin(kernels.EARTH_RADIUS * math.cos(self.maximum_elevation) / radius)
        central = 0.5 * math.pi - self.maximum_elevation - sight
        which = 0.0 if self.axis == "azimuth" else 1.0
        return (which, radius, rate, central, self.culmination, self.azimuth)


@dataclass(frozen=True)
class SiderealTrack:
    """A star: azimuth (from north through east, no jumps) or elevation, from hour angle and declination."""

    axis: str = choice("azimuth", ("azimuth", "elevation"), "which axis of the mount")
    hour_angle: float = setting(-0.5, "rad", -10.0, 10.0, "hour angle at time 0")
    declination: float = setting(0.3, "rad", -1.57, 1.57, "declination of the star")
    latitude: float = setting(0.75, "rad", -1.57, 1.57, "latitude of the station")
    duration: float = _duration()

    def packed(self) -> tuple[float, ...]:
        which = 0.0 if self.axis == "azimuth" else 1.0
        return (which, self.hour_angle, self.declination, self.latitude)


ReferenceConfig = (
    Hold | ConstantSpeed | Sinusoid | Multisine | SweptSine | Steps | Legs | SatellitePass | SiderealTrack
)
KINDS: Mapping[str, type[ReferenceConfig]] = MappingProxyType(
    {
        "hold": Hold,
        "constant_speed": ConstantSpeed,
        "sinusoid": Sinusoid,
        "multisine": Multisine,
        "swept_sine": SweptSine,
        "steps": Steps,
        "legs": Legs,
        "satellite_pass": SatellitePass,
        "sidereal_track": SiderealTrack,
    }
)
_CODES = {kind: code for code, kind in enumerate(KINDS.values())}


def validate_reference(config: ReferenceConfig, where: str = "reference") -> None:
    """Raises InputError for any value out of its range and for values that do not go together."""
    validate(config, where)
    if isinstance(config, SweptSine) and config.highest_frequency < config.lowest_frequency:
        raise InputError(
            where,
            f"highest_frequency is {config.highest_frequency:g}",
            f"at least lowest_frequency ({config.lowest_frequency:g} Hz)",
        )
    if isinstance(config, SiderealTrack) and abs(config.declination - config.latitude) < 1e-3:
        raise InputError(
            where,
            f"declination {config.declination:g} leads through the zenith at latitude {config.latitude:g}",
            "them to differ by 0.001 rad or more",
        )


UNSHAPED = Shaper(NONE)


class Reference:
    """A reference that can be evaluated, shaped or as it is. Raises InputError if a configuration is bad."""

    def __init__(self, config: ReferenceConfig, shaper: Shaper = UNSHAPED) -> None:
        validate_reference(config)
        validate(shaper, "shaper")
        self.config, self.shaper = config, shaper
        self._code = _CODES[type(config)]
        self._parameters = np.array(config.packed(), dtype=np.float64)
        self._impulses = shaper.impulses()

    @property
    def duration(self) -> float:
        """Length of the run (s); a shaped reference is late within it."""
        return self.config.duration

    def shaped_unless(self, shaper: Shaper) -> Reference:
        """This reference if it has a shaper, or else with this one."""
        return self if self.shaper.kind != NONE else Reference(self.config, shaper)

    def at(self, t: float) -> tuple[float, float, float]:
        """Position (rad), speed (rad/s) and acceleration (rad/s^2) at time t (s)."""
        sample: tuple[float, float, float] = kernels.shaped(self._code, self._parameters, self._impulses, t)
        return sample

    def over(self, times: ArrayLike) -> NDArray[np.float64]:
        """Shape (n, 3): position, speed, acceleration at each of n times (s)."""
        instants = np.ascontiguousarray(times, dtype=np.float64)
        samples: NDArray[np.float64] = kernels.shaped_all(self._code, self._parameters, self._impulses, instants)
        return samples


def reference_from_mapping(mapping: Mapping[str, object], where: str) -> Reference:
    """A reference from `{kind: sinusoid, amplitude: ...}`.

    Raises InputError for a missing or unknown kind, an unknown key (naming the nearest) and any bad value.
    """
    values = dict(mapping)
    kind = values.pop("kind", None)
    if kind is None:
        raise InputError(where, "kind is missing", "one of " + ", ".join(KINDS))
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(where, f"unknown kind {kind!r}", nearest(str(kind), list(KINDS)))
    config: ReferenceConfig = from_mapping(KINDS[str(kind)], values, where)
    validate_reference(config, where)
    return Reference(config)


def load_reference(path: Path) -> Reference:
    """A reference from a YAML file `reference: {kind: ..., ...}`, with `shaper: {kind: zvd, ...}` beside it for a shaped one.

    Raises InputError naming file and key.
    """
    document = load_yaml(path, "a reference file")
    if not isinstance(document.get("reference"), dict):
        raise InputError(str(path), "no mapping named reference", "reference: {kind: ...}")
    for key in document:
        if key not in ("reference", "shaper"):
            raise InputError(str(path), f"unknown key {key!r}", "reference or shaper")
    shaper = from_mapping(Shaper, document.get("shaper", {}), f"{path} shaper")
    return reference_from_mapping(document["reference"], f"{path} reference").shaped_unless(shaper)
