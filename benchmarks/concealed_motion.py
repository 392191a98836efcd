"""What happens around a concealed axis: the reference that moves it, weather, temperature, the other axis."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from benchmarks.concealed_physics import PERIOD, Environment

RATE = 1.0 / PERIOD


def reference_velocity(rng: np.random.Generator, stretch: float) -> np.ndarray:
    """Speed wanted, (n,) in rad/s: slow sinusoid, creeping to fast steps, a full turn, noise, fast sinusoid.

    `stretch` scales the time of every part; 1 gives about 340 s.
    """
    steady = [np.zeros(int(0.5 * RATE))]
    period = rng.uniform(28.0, 38.0) * stretch
    steady.append(rng.uniform(1.2e-3, 1.75e-3) * np.sin(_phase(2.0 * period, period)))
    for speed in np.geomspace(rng.uniform(1.2e-4, 2.5e-4), rng.uniform(3.5e-3, 4.5e-3), 4):
        steady.append(_there_and_back(speed, 5.0 * stretch))
    steady.append(_there_and_back(rng.uniform(0.04, 0.065), 40.0 * stretch))
    turn = rng.uniform(5.8, 6.9)
    steady.append(_there_and_back(turn / (40.0 * stretch), 40.0 * stretch))
    steady.append(_there_and_back(0.0175, 11.0 * stretch))
    steady.append(np.zeros(int(2.0 * RATE)))
    smooth = np.concatenate(steady)
    for _ in range(2):
        decay = math.exp(-2.0 * math.pi * 0.5 * PERIOD)
        smooth = lfilter([1.0 - decay], [1.0, -decay], smooth)
    noise = _multisine(rng, 30.0 * stretch, 0.3, 3.0, 2.6e-3)
    period = rng.uniform(9.0, 12.0)
    final = rng.uniform(5e-3, 8e-3) * np.sin(_phase(2.5 * period, period))
    return np.concatenate([smooth, noise, final])


def _phase(duration: float, period: float) -> np.ndarray:
    return 2.0 * math.pi * np.arange(int(duration * RATE)) * PERIOD / period


def _there_and_back(speed: float, duration: float) -> np.ndarray:
    count = int(duration * RATE)
    return np.concatenate([np.full(count, speed), np.full(count, -speed)])


def _multisine(rng: np.random.Generator, duration: float, low: float, high: float, rms: float) -> np.ndarray:
    t = np.arange(int(duration * RATE)) * PERIOD
    frequencies = rng.uniform(low, high, 12)
    phases = rng.uniform(0.0, 2.0 * math.pi, 12)
    wave = np.sin(2.0 * math.pi * np.outer(frequencies, t) + phases[:, None]).sum(axis=0)
    fade = np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)
    return np.asarray(rms * fade * wave / wave.std())


def _coloured(rng: np.random.Generator, count: int, corner: float) -> np.ndarray:
    """First-order noise of unit variance, (count,), corner in Hz."""
    decay = math.exp(-2.0 * math.pi * corner * PERIOD)
    white = rng.standard_normal(count) * math.sqrt(1.0 - decay * decay)
    white[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -decay], white))


def _chaos(rng: np.random.Generator, count: int) -> np.ndarray:
    """A chaotic map's orbit, a new value every 0.3 s, straight between them, without its mean, which would be a torque bias."""
    nodes = np.empty(int(count * PERIOD / 0.3) + 2)
    nodes[0] = rng.uniform(0.1, 0.9)
    for i in range(1, len(nodes)):
        nodes[i] = 3.97 * nodes[i - 1] * (1.0 - nodes[i - 1])
    orbit = np.interp(np.arange(count) * PERIOD, 0.3 * np.arange(len(nodes)), 2.0 * nodes - 1.0)
    return np.asarray(orbit - orbit.mean())


def draw_environment(rng: np.random.Generator, stretch: float) -> Environment:
    """One run's surroundings, from the generator's state alone."""
    velocity = reference_velocity(rng, stretch)
    count = len(velocity)
    t = np.arange(count) * PERIOD
    start, rise = rng.uniform(13.0, 16.0), rng.uniform(4.0, 6.5)
    wave = 0.3 * np.sin(2.0 * math.pi * t / rng.uniform(60.0, 80.0) + rng.uniform(0.0, 6.28))
    elevation = _multisine(rng, count * PERIOD + 1.0, 0.06, 0.65, 0.013)[:count]
    return Environment(
        reference=rng.uniform(-0.5, 0.5) + np.concatenate([[0.0], np.cumsum(velocity)[:-1]]) * PERIOD,
        reference_velocity=velocity,
        temperature=start + rise * (1.0 - np.exp(-t / (100.0 * stretch))) + wave,
        wind=rng.uniform(5.0, 6.5) + 2.6 * _coloured(rng, count, 1.0 / (2.0 * math.pi * 6.0)),
        elevation_velocity=elevation,
        elevation_acceleration=np.gradient(elevation, PERIOD),
        torque_noise=_coloured(rng, count, 10.0),
        encoder_noise=rng.standard_normal(count) * math.radians(0.01 / 3600.0),
        chaos=_chaos(rng, count),
    )
