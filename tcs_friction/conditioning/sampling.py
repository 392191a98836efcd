"""Series on an even time base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AWRY = 0.1  # of a step: at a tenth of the sampling rate, the highest band of an identification, a phase of 0.06 rad


def jitter(t: Array, rate: float) -> Array:
    """(n - 1,) By how much each step of t (n,), s, differs from 1/rate, relative to that."""
    return np.abs(np.diff(t) * rate - 1.0)


def even(t: Array, rate: float) -> bool:
    """Whether times t (n,), s, keep to steps of 1/rate: none is lost, and none is farther off than AWRY of a step."""
    return bool(np.max(np.abs((t - t[0]) * rate - np.arange(len(t)))) < AWRY)


def resampled(t: Array, series: Array, rate: float) -> tuple[Array, Array]:
    """Even times (m,), s, from t[0] to t[-1] at so many samples/s, and series (k, n) interpolated linearly there (k, m).

    A line is enough where the steps jitter: between samples a signal of frequency f misses it by (f/rate)^2 pi^2/2 of its
    amplitude, and what is compared later lies at low frequencies.
    """
    even = t[0] + np.arange(int((t[-1] - t[0]) * rate) + 1) / rate
    return even, np.array([np.interp(even, t, values) for values in series])
