"""How the axes of the MuJoCo worlds are moved: an experiment, or an ordinary night or shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.concealed_motion import reference_velocity


@dataclass(frozen=True)
class Motion:
    """What is asked of the axis at each sample, (n,): position (rad), speed (rad/s), acceleration (rad/s^2)."""

    period: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @property
    def t(self) -> np.ndarray:
        return np.arange(len(self.position)) * self.period


def from_velocity(velocity: np.ndarray, period: float, start: float) -> Motion:
    """The motion that has this speed (n,)."""
    position = start + np.concatenate([[0.0], np.cumsum(velocity)[:-1]]) * period
    return Motion(period, position, velocity, np.gradient(velocity, period))


def telescope_experiment(rng: np.random.Generator, period: float) -> Motion:
    """Slow to fast, both directions, a turn, a multisine: about 130 s. The period has to be that of the concealed worlds."""
    velocity = reference_velocity(rng, rng.uniform(0.3, 0.4))
    return from_velocity(velocity, period, _centred(velocity, period))


def telescope_night(rng: np.random.Generator, period: float) -> Motion:
    """Three targets tracked at sidereal rates, slews between them: about 150 s, two reversals or three."""
    parts = []
    for _ in range(3):
        parts.append(
            np.full(int(rng.uniform(25.0, 40.0) / period), rng.choice((-1.0, 1.0)) * rng.uniform(4e-5, 4e-4))
        )
        parts.append(
            np.full(int(rng.uniform(6.0, 15.0) / period), rng.choice((-1.0, 1.0)) * rng.uniform(0.02, 0.08))
        )
    velocity = _smooth(np.concatenate(parts), period, 0.5)
    return from_velocity(velocity, period, _centred(velocity, period))


def robot_experiment(rng: np.random.Generator, period: float) -> Motion:
    """Slow sinusoid, legs at five speeds, moves from point to point, a multisine: about 80 s within some 2 rad."""
    slow = rng.uniform(6.0, 9.0)
    parts = [np.zeros(int(0.5 / period))]
    parts.append(
        rng.uniform(0.02, 0.05) * np.sin(2.0 * math.pi * np.arange(int(2.0 * slow / period)) * period / slow)
    )
    for speed in np.geomspace(rng.uniform(0.01, 0.02), rng.uniform(0.9, 1.4), 5):
        leg = int(min(4.0, rng.uniform(1.2, 1.8) / speed) / period)
        parts += [np.full(leg, speed), np.full(leg, -speed)]
    for _ in range(6):
        move, stay = int(rng.uniform(0.5, 1.2) / period), int(rng.uniform(0.2, 0.8) / period)
        speed = rng.uniform(0.4, 1.5)
        parts += [np.full(move, speed), np.zeros(stay), np.full(move, -speed), np.zeros(stay)]
    steady = _smooth(np.concatenate(parts), period, 3.0)
    velocity = np.concatenate(
        [steady, _multisine(rng, period, 20.0, 0.3, rng.uniform(4.0, 12.0), rng.uniform(0.1, 0.25))]
    )
    return from_velocity(velocity, period, _centred(velocity, period))


def robot_shift(rng: np.random.Generator, period: float) -> Motion:
    """The same three moves again and again, as in production: about 80 s."""
    cycle = []
    for speed in rng.uniform(0.3, 1.2, 3):
        move = int(rng.uniform(0.6, 1.2) / period)
        cycle += [np.full(move, speed), np.zeros(int(0.4 / period))]
    back = sum(float(part.sum()) for part in cycle) * period
    cycle += [np.full(int(back / 0.9 / period), -0.9), np.zeros(int(0.8 / period))]
    once = np.concatenate(cycle)
    velocity = _smooth(np.tile(once, max(1, int(80.0 / period) // len(once))), period, 3.0)
    return from_velocity(velocity, period, _centred(velocity, period))


def _centred(velocity: np.ndarray, period: float) -> float:
    """The start for which the travel's middle is at zero."""
    path = np.cumsum(velocity) * period
    return -0.5 * float(path.max() + path.min())


def _smooth(velocity: np.ndarray, period: float, corner: float) -> np.ndarray:
    """Twice through a first-order filter with that corner, Hz."""
    decay = math.exp(-2.0 * math.pi * corner * period)
    for _ in range(2):
        velocity = lfilter([1.0 - decay], [1.0, -decay], velocity)
    return np.asarray(velocity)


def _multisine(
    rng: np.random.Generator, period: float, duration: float, low: float, high: float, rms: float
) -> np.ndarray:
    t = np.arange(int(duration / period)) * period
    frequencies, phases = rng.uniform(low, high, 12), rng.uniform(0.0, 2.0 * math.pi, 12)
    wave = np.sin(2.0 * math.pi * np.outer(frequencies, t) + phases[:, None]).sum(axis=0)
    fade = np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)
    return np.asarray(rms * fade * wave / wave.std())
