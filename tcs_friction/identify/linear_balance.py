"""The crudest balance of torques, by least squares and without any guess: where a fit of a friction law begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcs_friction.conditioning.motion import Motion, coarse
from tcs_friction.errors import InputError
from tcs_friction.identify.uncertainty import independent_samples, sandwich

FEWEST = 8.0  # independent samples at least
SIGNIFICANT = 3.0  # standard errors
SAMPLES_PER_CYCLE = 4.0  # of the bandwidth, beyond which a low pass leaves nothing to speak of
FAR = 10.0  # times: a believed inertia that is off by more starts no search


@dataclass(frozen=True, eq=False)
class Balance:
    """torque = J a + c sign(v) + b v + what the position does, where the axis moves.

    values, std (p,): J, c, b, then those of the position in the order asked for. residual: rms, N m. independent: as many samples
    as its correlated ones are worth. memory: s, that each of those lasts.
    """

    values: np.ndarray
    std: np.ndarray
    residual: float
    independent: float
    memory: float

    def gain(self, other: Balance) -> float:
        """By how much Bayes' information criterion prefers this to another balance of the same samples."""
        more = len(self.values) - len(other.values)
        return self.independent * 2.0 * math.log(other.residual / self.residual) - more * math.log(self.independent)


def linear_balance(motion: Motion, position: Sequence[str] = ("constant",)) -> Balance:
    """By least squares. position: of `constant` (1), `line` (q), `gravity` (sin q and cos q) and, in its place, `drift` (t).

    Raises InputError where the axis hardly moves.
    """
    if motion.bandwidth > 0.0:  # as many samples as carry information
        _, motion = coarse(motion, max(1, int(motion.rate / (SAMPLES_PER_CYCLE * motion.bandwidth))))
    moving = np.abs(motion.velocity) > motion.resolution
    if np.count_nonzero(moving) <= FEWEST:
        raise InputError("signal position", "nothing but noise in it", "a recording in which the axis moves")
    v, a, q = motion.velocity[moving], motion.acceleration[moving], motion.position[moving]
    parts = {"constant": [np.ones(len(q))], "line": [q], "gravity": [np.sin(q), np.cos(q)], "drift": [motion.t[moving]]}
    columns = np.column_stack([a, np.sign(v), v, *(column for name in position for column in parts[name])])
    size = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    torque = motion.torque[moving]
    values, *_ = np.linalg.lstsq(columns / size, torque, rcond=None)
    residual = torque - columns / size @ values
    covariance = sandwich(columns / size, residual, np.ones(len(torque)))
    independent = max(independent_samples(residual), FEWEST)
    power = max(float(np.mean(residual**2)), 1e-300)
    memory = max(len(torque) / independent, 1.0) / motion.rate
    return Balance(values / size, np.sqrt(np.diag(covariance)) / size, math.sqrt(power), independent, memory)


def likely_inertia(believed: float, motion: Motion) -> float:
    """The believed inertia, or that of the balance where it is sure of another order of magnitude; kg m^2."""
    balance = linear_balance(motion)
    found = float(balance.values[0])
    far = not believed / FAR < found < believed * FAR
    return found if found > SIGNIFICANT * balance.std[0] and far else believed
