"""The electronics around an axis of `scale_worlds`: control ticks and stamps, noise, controller, and how torque is logged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.scale_axis import Axis
from benchmarks.scale_motion import Extent, reference, smooth, wave
from benchmarks.scale_physics import Array, Control, simulate

_JITTER = 0.2  # of the period, to either side


def clocks(
    axis: Axis, logging: str, per_sample: int, jittered: bool, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Control ticks with the end, and the stamps of the log.

    Where the controller logs its own ticks, they are what jitters; a log that looks by itself (`point`) does so on its own in the
    middle of a tick, and jitters alone.
    """
    period = 1.0 / axis.rate
    count = axis.samples * per_sample
    ticks = np.arange(count + 1) * period / per_sample
    jitter = rng.uniform(-_JITTER, _JITTER, axis.samples) * period if jittered else np.zeros(axis.samples)
    jitter[0] = 0.0
    if logging == "point":
        return ticks, ticks[:-1:per_sample] + 0.5 * period / per_sample + np.abs(jitter)
    ticks[:-1] += jitter
    return ticks, ticks[:-1].copy()


def drive_noise(ticks: Array, level: float, kind: str, rng: np.random.Generator) -> tuple[Array, float]:
    """Torque noise over equal parts of each tick, and its corner [rad/s], 0 where it is new at each tick."""
    count = ticks.size - 1
    if kind == "white":
        return level * rng.standard_normal((count, 1)), 0.0
    split = 4 if count <= 60000 else 2
    rate = 2.0 * np.pi * 10.0 ** rng.uniform(np.log10(0.03), np.log10(0.3)) * count / (ticks[-1] - ticks[0])
    keep = np.exp(-rate * np.repeat(np.diff(ticks), split) / split)
    shocks = level * np.sqrt(1.0 - keep**2) * rng.standard_normal(count * split)
    noise = np.empty(count * split)
    now = level * float(rng.standard_normal())
    for i in range(noise.size):
        now = keep[i] * now + shocks[i]
        noise[i] = now
    return noise.reshape(count, split), float(rate)


def drive(motion: str, ticks: Array, axis: Axis, rng: np.random.Generator) -> Control:
    """The controller with its reference, or a torque in open loop for motions that begin with `open_`."""
    times = ticks[:-1]
    if motion.startswith("open_"):
        extent = Extent(axis.top_speed, axis.parameters[2], axis.ramp, axis.coast)
        return _open_loop(np.tanh(3.0 * wave(motion[5:], times, extent, rng, torque=True)), ticks, axis, rng)
    top = axis.parameters[2] * rng.uniform(1.5, 3.0) if motion == "never_fast" else axis.top_speed
    extent = Extent(float(top), axis.parameters[2], axis.ramp, axis.coast)
    shape = "slow_tracking" if motion == "never_fast" else motion
    velocity, powered = reference(shape, times, extent, rng)
    velocity = smooth(velocity, times, 0.2 * axis.ramp)
    position = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(times))])
    feedforward = axis.believed["inertia"] * np.gradient(velocity, times)
    bandwidth = axis.velocity_bandwidth((times.size - 1) / (times[-1] - times[0]))
    gain = axis.believed["inertia"] * bandwidth
    follow = 0.0 if motion == "free_decay" else 0.25 * bandwidth
    return Control(
        position, velocity, feedforward, powered, follow, gain, 0.2 * gain * bandwidth, 5.0 * bandwidth
    )


def _open_loop(shape: Array, ticks: Array, axis: Axis, rng: np.random.Generator) -> Control:
    """A torque of this shape, as strong as needed for about the top speed; tried out as one would, without noise."""
    zeros = np.zeros(shape.size)
    wanted = axis.top_speed * float(rng.uniform(0.6, 1.0))
    p = axis.parameters
    low, high = p[1], p[1] + 8.0 * (p[6] * axis.top_speed / axis.ramp + p[5] * axis.top_speed)
    for _ in range(12):
        strength = float(np.sqrt(low * high))
        control = Control(zeros, zeros, strength * shape, zeros == 0.0, 0.0, 0.0, 0.0, 1.0)
        states = simulate(ticks, zeros[:, None], ticks[:-1:5], p, axis.scales, control, zeros, 0.0, 1e-4)[1]
        peak = float(np.abs(states[:, 1]).max())
        if abs(peak / wanted - 1.0) < 0.15:
            break
        low, high = (strength, high) if peak < wanted else (low, strength)
    return control


def log_torque(
    logging: str, torque: Array, samples: int, per_sample: int, every: int
) -> tuple[Array, NDArray[np.int64]]:
    """The logged value at each sample, and the tick it is from; -1 before the first."""
    tick = np.arange(samples) * per_sample
    if logging == "held_up_to_stamp":
        tick = tick - 1
    elif logging == "stale":
        tick = tick // every * every
    return np.where(tick >= 0, torque[tick], 0.0), tick


def worth_keeping(stratum: dict[str, Any], axis: Axis, states: Array, torque: Array) -> bool:
    """Whether a person would keep the recording: the axis moves as wanted, turns back ten times, and the loop is quiet."""
    motion, speed = stratum["motion"], states[:, 1]
    slip = axis.parameters[2]
    top = float(np.abs(speed).max())
    if not 0.4 * axis.top_speed < top < 1.8 * axis.top_speed and motion != "never_fast":
        return False
    clear = np.sign(speed[np.abs(speed) > 0.3 * slip])
    if np.count_nonzero(np.diff(clear)) < 20 and motion not in ("one_way", "free_decay"):
        return False
    if np.mean(np.abs(speed) > 0.1 * slip) < 0.2:
        return False
    if stratum["kind"] == "linear" and np.ptp(states[:, 0]) > 60.0 * axis.top_speed * axis.ramp:
        return False
    return bool(np.std(np.diff(torque)) < 0.5 * axis.parameters[0] + 0.2 * np.std(torque))
