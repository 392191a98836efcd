"""The crudest balance of torques, by least squares and without any guess: where a fit of a friction law begins."""

from __future__ import annotations

import math

import numpy as np

from tcs_friction.conditioning.motion import Motion

FEWEST = 8.0  # independent samples at least
SIGNIFICANT = 3.0  # standard errors
FAR = 10.0  # times: a believed inertia that is off by more starts no search


def linear_balance(motion: Motion, gravity: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """Least squares of torque = J a + c sign(v) + b v + o, with gravity + g sin(q) + h cos(q), where the axis moves.

    Returns values and standard errors, (4,) or (6,), and Bayes' information criterion.
    """
    moving = np.abs(motion.velocity) > motion.resolution
    v, a, q = motion.velocity[moving], motion.acceleration[moving], motion.position[moving]
    columns = np.column_stack([a, np.sign(v), v, np.ones(len(v)), *([np.sin(q), np.cos(q)] if gravity else [])])
    size = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    torque = motion.torque[moving]
    values, *_ = np.linalg.lstsq(columns / size, torque, rcond=None)
    residual = torque - columns / size @ values
    gram = np.linalg.pinv((columns / size).T @ (columns / size))
    slow = 2.0 * motion.bandwidth / motion.rate if motion.bandwidth else 1.0
    independent = max(len(torque) * min(slow, 1.0), FEWEST)
    power = max(float(np.mean(residual**2)), 1e-300)
    spread = np.sqrt(np.diag(gram) * power * len(torque) / independent)
    criterion = independent * math.log(power) + len(values) * math.log(independent)
    return values / size, np.asarray(spread / size), criterion


def likely_inertia(believed: float, motion: Motion) -> float:
    """The believed inertia, or that of the balance where it is sure of another order of magnitude; kg m^2."""
    values, spread, _ = linear_balance(motion)
    found = float(values[0])
    far = not believed / FAR < found < believed * FAR
    return found if found > SIGNIFICANT * spread[0] and far else believed
