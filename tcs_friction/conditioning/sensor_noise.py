"""White noise on a smooth signal, by what neighbouring samples at their own instants cannot have in common."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LOWEST, HIGHEST = 3, 8  # orders of the differences: a higher one sees less of the motion and has fewer independent values
BLOCK = 256  # samples: short beside a recording, so that few blocks hold a reversal, and enough for a variance within 15 %
MOST_BLOCKS = 200  # spread over the samples: the median of their variances is known to 1.5 %
ALIKE = 0.96  # times the variance by the order before: what falls by less has fallen by chance


def white_noise(t: Array, values: Array, step: float = 0.0) -> float:
    """Standard deviation of white noise on a smooth signal.

    A divided difference of order k of samples x_i at the instants t_i, sum of w_i x_i with w_i = 1 / prod (t_i - t_j), is nothing
    for a polynomial below order k, however uneven the steps. Of white noise it has the noise's variance times the sum of w_i^2.
    Its mean square is taken over blocks; their median passes over reversals and wild samples. What the signal adds falls from
    order to order, what noise adds does not: the first order after which nothing falls holds.

    Parameters
    ----------
    t, values: (n,) instants (s, strictly increasing) and samples.
    step: of which all samples are multiples. Rounding adds step^2/12 of its own, which is taken away (Sheppard 1898), as far
        as anything is left.

    Returns 0 for so few samples that they have no difference of the highest order.
    """
    if len(t) <= HIGHEST:
        return 0.0
    variance = _variance(t, values, LOWEST)
    for order in range(LOWEST + 1, HIGHEST + 1):
        before, variance = variance, min(variance, _variance(t, values, order))
        if variance >= ALIKE * before:
            break
    return math.sqrt(max(variance - step**2 / 12.0, 0.0))


def _variance(t: Array, values: Array, order: int) -> float:
    """Of the noise, by differences of one order."""
    starts = np.arange(0, max(len(t) - BLOCK, 0) + 1, BLOCK)
    spread = starts[:: -(-len(starts) // MOST_BLOCKS)]
    return float(np.median([_mean_square(t[k : k + BLOCK], values[k : k + BLOCK], order) for k in spread]))


def _mean_square(t: Array, values: Array, order: int) -> float:
    """Of normalised divided differences of one block (m,)."""
    instants = np.lib.stride_tricks.sliding_window_view(t - t[0], order + 1)
    samples = np.lib.stride_tricks.sliding_window_view(values - values[0], order + 1)
    apart = instants[:, :, None] - instants[:, None, :]
    apart /= np.ptp(instants, axis=1)[:, None, None]
    apart[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / np.prod(apart, axis=2)
    differences = np.sum(weights * samples, axis=1) / np.linalg.norm(weights, axis=1)
    return float(np.mean(differences**2))
