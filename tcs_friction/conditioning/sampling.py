"""Series on an even time base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def jitter(t: Array, rate: float) -> Array:
    """(n - 1,) By how much each step of t (n,), s, differs from 1/rate, relative to that."""
    return np.abs(np.diff(t) * rate - 1.0)


def resampled(t: Array, series: Array, rate: float) -> tuple[Array, Array]:
    """Even times (m,), s, from t[0] to t[-1] at so many samples/s, and series (k, n) interpolated linearly there (k, m).

    A line is enough where the steps jitter: between samples a signal of frequency f misses it by (f/rate)^2 pi^2/2 of its
    amplitude, and what is compared later lies at low frequencies.
    """
    even = t[0] + np.arange(int((t[-1] - t[0]) * rate) + 1) / rate
    return even, np.array([np.interp(even, t, values) for values in series])
