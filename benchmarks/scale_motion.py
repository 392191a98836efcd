"""What people command an axis to find its friction: references and open-loop torques for `scale_worlds`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.scale_physics import Array

MOTIONS = ("chirp", "multisine", "steps", "slow_tracking", "pick_and_place", "free_decay")


@dataclass(frozen=True)
class Extent:
    """How far a motion goes.

    Attributes
    ----------
    top_speed : float
        Largest speed of the reference [rad/s or m/s].
    stribeck_velocity : float
        The speed around which the slow parts are.
    ramp : float
        Time in which the top speed is reached [s].
    coast : float
        Time in which the axis comes to rest by itself from the top speed [s].
    """

    top_speed: float
    stribeck_velocity: float
    ramp: float
    coast: float


def reference(
    motion: str, times: Array, extent: Extent, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Velocity over `times`, and where the drive is on."""
    powered = np.ones(times.size, dtype=bool)
    if motion == "chirp":
        return extent.top_speed * wave(motion, times, extent, rng), powered
    if motion == "multisine":
        return extent.top_speed * wave(motion, times, extent, rng), powered
    if motion == "one_way":  # a spindle that never turns back
        turning = np.clip(times / (4.0 * extent.ramp), 0.0, 1.0)
        return extent.top_speed * turning * (0.6 + 0.4 * wave("multisine", times, extent, rng)), powered
    if motion == "steps":
        return _steps(times, extent, rng), powered
    if motion == "slow_tracking":
        return _slow_tracking(times, extent, rng), powered
    if motion == "pick_and_place":
        return _pick_and_place(times, extent, rng), powered
    return _free_decay(times, extent, rng)


def wave(motion: str, times: Array, extent: Extent, rng: np.random.Generator, torque: bool = False) -> Array:
    """A chirp or a multisine between -1 and 1, in passages of different strength.

    As a `torque` it has no slow and no weak parts: an axis that friction holds shows nothing, and a slow torque that frees it
    makes it very fast.
    """
    # Hz: a sine of the top speed then needs the acceleration of the ramp.
    highest = 1.0 / (2.0 * np.pi * extent.ramp)
    length = times[-1] - times[0]
    if motion == "chirp":
        passages = int(rng.integers(2, 5))
        phase_of = (times - times[0]) / length * passages
        there = 1.0 - np.abs(2.0 * (phase_of % 1.0) - 1.0)  # up and down again
        frequency = highest * (3.0 if torque else 10.0) ** (there - 1.0)
        signal = np.sin(2.0 * np.pi * np.concatenate([[0.0], np.cumsum(frequency[:-1] * np.diff(times))]))
        strength = np.where(phase_of.astype(int) % 2 == 0, 1.0, rng.uniform(0.15, 0.5) + 0.5 * torque)
        return signal * smooth(strength, times, extent.ramp)
    count = int(rng.integers(6, 14))
    frequencies = highest * np.geomspace(0.4 if torque else 0.05, 1.0, count) * rng.uniform(0.95, 1.05, count)
    signal = np.zeros(times.size)
    for frequency, phase in zip(frequencies, rng.uniform(0.0, 2.0 * np.pi, count), strict=True):
        signal += np.sin(2.0 * np.pi * frequency * times + phase)
    depth = 0.1 if torque else 0.4
    strength = 1.0 + depth * (np.cos(2.0 * np.pi * times / length * float(rng.integers(1, 4))) - 1.0)
    signal *= strength * np.clip((times - times[0]) / (4.0 * extent.ramp), 0.0, 1.0)
    return np.asarray(signal / np.abs(signal).max())


def smooth(signal: Array, times: Array, length: float) -> Array:
    """A moving average over `length` seconds, of the instants (regular or nearly so)."""
    width = max(1, round(length * (times.size - 1) / (times[-1] - times[0])))
    padded = np.concatenate(
        [np.full(width // 2, signal[0]), signal, np.full(width - 1 - width // 2, signal[-1])]
    )
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return np.asarray((total[width:] - total[:-width]) / width)


def _steps(times: Array, extent: Extent, rng: np.random.Generator) -> Array:
    """Smoothed steps of position (minimum jerk), small and large, there and back in turn, with dwells."""
    velocity = np.zeros(times.size)
    now, place = times[0] + 2.0 * extent.ramp, 0.0
    largest = extent.top_speed * 6.0 * extent.ramp
    while now < times[-1]:
        share = float(rng.uniform(0.03, 1.0))
        peak = extent.top_speed * share
        length = 6.0 * extent.ramp * share**0.5
        distance = peak * length / 1.875
        sign = 1.0 if largest * rng.uniform(-1.0, 1.0) > place else -1.0
        s = np.clip((times - now) / length, 0.0, 1.0)
        velocity += sign * peak * 16.0 * (s * (1.0 - s)) ** 2
        place += sign * distance
        now += length + extent.ramp * float(rng.uniform(0.5, 3.0))
    return velocity


def _slow_tracking(times: Array, extent: Extent, rng: np.random.Generator) -> Array:
    """Constant speeds from below the Stribeck velocity up, each there and back."""
    velocity = np.zeros(times.size)
    now = times[0] + extent.ramp
    slowest = 0.3 * extent.stribeck_velocity
    while now < times[-1]:
        speed = slowest * (extent.top_speed / slowest) ** float(rng.uniform())
        length = extent.ramp * float(rng.uniform(3.0, 8.0))
        for sign in (1.0, -1.0):
            velocity[(times >= now) & (times < now + length)] = sign * speed
            now += length
        now += extent.ramp * float(rng.uniform(0.0, 2.0))
    return smooth(velocity, times, extent.ramp)


def _pick_and_place(times: Array, extent: Extent, rng: np.random.Generator) -> Array:
    """Trapezoids between a few stations, with pauses."""
    stations = (
        np.cumsum(rng.uniform(0.5, 1.0, int(rng.integers(2, 5)))) * extent.top_speed * 2.0 * extent.ramp
    )
    acceleration = extent.top_speed / extent.ramp
    velocity = np.zeros(times.size)
    now, at = times[0] + extent.ramp, 0
    while now < times[-1]:
        to = int((at + rng.integers(1, stations.size)) % stations.size)
        distance = abs(stations[to] - stations[at])
        speed = min(
            extent.top_speed * float(rng.choice([1.0, 1.0, 1.0, 0.3])),
            float(np.sqrt(distance * acceleration)),
        )
        length = distance / speed + speed / acceleration
        rising = np.minimum(times - now, now + length - times) * acceleration
        velocity += np.sign(stations[to] - stations[at]) * np.clip(rising, 0.0, speed)
        now += length + extent.ramp * float(rng.uniform(0.5, 3.0))
        at = to
    return velocity


def _free_decay(times: Array, extent: Extent, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """Spun up, then left alone until it stands."""
    velocity, powered = np.zeros(times.size), np.zeros(times.size, dtype=bool)
    now, sign = times[0] + extent.ramp, 1.0
    while now < times[-1]:
        share = float(rng.uniform(0.3, 1.0))
        on = extent.ramp * float(rng.uniform(3.0, 4.0))
        driven = (times >= now) & (times < now + on)
        ramp = np.minimum((times[driven] - now) / (2.0 * extent.ramp), 1.0)
        velocity[driven] = sign * share * extent.top_speed * ramp
        powered |= driven
        now += on + 1.3 * share * extent.coast + extent.ramp * float(rng.uniform(0.5, 1.5))
        sign = -sign
    return velocity, powered
