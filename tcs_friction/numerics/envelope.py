"""Fewer points of a long series, without losing its peaks."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

FINEST = 4000
"""Points of a line beyond which no picture shows more."""


def envelope(y: NDArray[np.float64], most: int = FINEST) -> NDArray[np.intp]:
    """Indices, in order, of about `most` samples of y (n,): least and greatest of every stretch, and both ends.

    Of a stretch without a finite value the first, so that a gap stays one.
    """
    if len(y) <= most:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), most // 2 + 1).astype(int)
    low, high = np.where(np.isfinite(y), y, np.inf), np.where(np.isfinite(y), y, -np.inf)
    kept = {0, len(y) - 1}
    for start, stop in itertools.pairwise(edges):
        kept.update((int(start + low[start:stop].argmin()), int(start + high[start:stop].argmax())))
    return np.array(sorted(kept))
