"""Runs of a mask: where something holds without a break."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(k, 2) First and past-last index of each run of True in a mask (n,), in order."""
    framed = np.concatenate([[False], mask, [False]])
    return np.flatnonzero(framed[1:] != framed[:-1]).reshape(-1, 2)
