"""Which samples are fitted and which are held out.

In: which recording each stretch is from, and how many samples are compared in each. Out: masks. Finished models are compared on
held-out data, which nothing was fitted to and which the train data's filters do not reach.

Of several recordings the last ones are held out whole: another run shows more than another moment. A lone recording is cut into
blocks. Regular ones would always hold the same part of a motion that repeats, so block k is held out where the fractional part of
k (sqrt(5) - 1)/2 + 1/2 is small: multiples of the golden ratio never fall into step (Weyl's equidistribution).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

SHARE = 0.25  # of the data, held out
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
MOST_BLOCKS = 16  # four of them held out: more would cost more gaps and show little more
BLOCK_EDGES = 5.0  # a block is at least so many times as long as the gap that is left between two
MOST_UNKNOWN = 0.25  # of all data, that may be left out because friction remembers what was before: as much as is held out

Mask = NDArray[np.bool_]


def blocks(sizes: Sequence[int], edge: int) -> list[NDArray[np.int64]]:
    """Number of the block of every sample of each stretch with so many samples; blocks go on through stretches.

    edge: samples left out between train and held-out data.
    """
    total = sum(sizes)
    count = min(max(int(total / (BLOCK_EDGES * edge)), round(1.0 / SHARE)), MOST_BLOCKS)
    return np.split(np.arange(total) * count // total, np.cumsum(sizes)[:-1])


def held_out(sources: Sequence[Hashable], numbers: Sequence[NDArray[np.int64]]) -> list[Mask]:
    """What is held out of each stretch, masks (n,). sources: its recording; numbers (n,): blocks of its samples."""
    order = list(dict.fromkeys(sources))
    if len(order) > 1:
        last = set(order[-max(1, round(SHARE * len(order))) :])
        return [np.full(len(block), source in last) for block, source in zip(numbers, sources, strict=True)]
    return [(block * GOLDEN + 0.5) % 1.0 < SHARE for block in numbers]


def divided(mask: Mask, edge: int, unknown: int = 0) -> tuple[Mask, Mask]:
    """Train and held-out samples of a stretch, of which `mask` (n,) is to be held out.

    `edge` samples are in neither: at both ends, where a filter does not know what was beyond, and between the two. Neither are
    the first `unknown` ones.
    """
    usable = np.zeros(len(mask), bool)
    usable[max(edge, unknown) : -edge] = True
    gap = ndimage.binary_dilation(mask, iterations=edge) if mask.any() else mask
    return usable & ~gap, usable & mask


def unknown(positions: Sequence[np.ndarray], memory: float) -> list[int]:
    """Samples of each stretch until its positions (n,) have spread over `memory` (rad), or over less of it.

    What was before a stretch is not recorded, and friction remembers it until the axis has moved so far. A stretch that never
    moves so far is unknown as a whole. Where that would be too much of the data, half as far has to do, or half of that.
    """
    spreads = [np.maximum.accumulate(position) - np.minimum.accumulate(position) for position in positions]
    most = MOST_UNKNOWN * sum(map(len, positions))
    while True:
        counts = [int(np.searchsorted(spread, memory)) for spread in spreads]
        if sum(counts) < most or memory == 0.0:
            return counts
        memory *= 0.5
