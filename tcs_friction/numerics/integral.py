"""The way that a velocity makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def travelled(t: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) Way since the first sample, by the trapezoidal rule; t (n,) s, velocity (n,) per s."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(t))])
