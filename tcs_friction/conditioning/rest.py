"""Where friction without a memory of motion is unknown: at rest, and while the direction of motion changes.

In: a low-passed motion (n,). Out: a mask. Friction without memory is whatever holds an axis that rests, up to its level
(Karnopp 1985): it bounds the torque and does not say it. An axis rests where it moves by no more than the noise of its position
within the time in which a torque that is compared can change, or where its speed does not stand out of its noise: friction then
has no direction. At a reversal such friction jumps by twice its level, and what a
low-passed torque is within the filter's length of the jump hangs on the exact time of it, and on how a real axis passes through
zero speed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

REST_PERIODS = 2.0  # of the cutoff: shorter halts are part of a reversal
NOISE_RANGE = (
    6.0  # standard deviations between the largest and the smallest of a few samples of noise, at most
)
AROUND_REVERSAL = (
    1.0  # periods of the cutoff on either side: half of the narrowing filter, which holds 99 % of its weight
)


def unknown_friction(
    position: np.ndarray, velocity: np.ndarray, dt: float, cutoff: float, noise: float, threshold: float
) -> NDArray[np.bool_]:
    """(n,) Where friction without memory is unknown.

    position (n,): rad, low-passed, at steps of `dt`, s. velocity (n,): rad/s. cutoff: up to which torques are compared, Hz.
    noise: rad rms that is left in the position. threshold: rad/s above which the direction of motion is known.
    """
    window = max(3, math.ceil(REST_PERIODS / (cutoff * dt)))
    spread = ndimage.maximum_filter1d(position, window) - ndimage.minimum_filter1d(position, window)
    still = _widened(spread <= NOISE_RANGE * noise, window // 2)
    turning = np.zeros(len(velocity), bool)
    turning[1:] = velocity[1:] * velocity[:-1] <= 0.0
    turning |= np.abs(velocity) < threshold
    return np.asarray(still | _widened(turning, math.ceil(AROUND_REVERSAL / (cutoff * dt))))


def _widened(mask: NDArray[np.bool_], samples: int) -> NDArray[np.bool_]:
    """A mask (n,) and so many samples on either side of each run."""
    return np.asarray(ndimage.binary_dilation(mask, iterations=samples)) if mask.any() else mask
