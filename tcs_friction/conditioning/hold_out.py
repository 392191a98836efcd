"""Which samples are fitted, which are held out, and which nothing looks at before all is decided.

In: which recording each stretch is from, and how many samples are compared in each. Out: masks. Finished models are compared on
held-out data, which nothing was fitted to and which the train data's filters do not reach. What is chosen by that comparison is
judged too well by it, so one block more is untouched: from it alone an improvement is stated.

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

# The untouched block is one of MOST_BLOCKS. An rms of n independent samples is known to 1/sqrt(2 n) of itself: of five minutes
# up to 20 Hz one block in 16 has 750, hence 2.6 %, half of what a noise floor is known to. Fitted numbers are 4 % less sure,
# since 11 blocks are fitted and not 12; at the end it cuts no other one in two. A shorter recording, of fewer blocks, would lose
# more, and keeps none untouched.


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


def untouched(sources: Sequence[Hashable], numbers: Sequence[NDArray[np.int64]]) -> list[Mask]:
    """What nothing may look at of each stretch, masks (n,): the last block, which comes after all that was learned.

    Of recordings that are cut into fewer than MOST_BLOCKS it is nothing; nor is it of several whose last one is no longer than
    two blocks. Arguments as of `held_out`.
    """
    last = [block == MOST_BLOCKS - 1 for block in numbers]
    if len(set(sources)) > 1:
        held = held_out(sources, numbers)
        last = [one & mask for one, mask in zip(last, held, strict=True)]
        if 2 * sum(map(np.count_nonzero, last)) >= sum(map(np.count_nonzero, held)):
            return [np.zeros(len(block), bool) for block in numbers]
    return last


def divided(held: Mask, apart: Mask, edge: int, unknown: int = 0) -> tuple[Mask, Mask, Mask]:
    """Train, held-out and untouched samples of a stretch, of which `held` (n,) and `apart` (n,), which goes before, are to be so.

    `edge` samples are in none: at both ends, where a filter does not know what was beyond, and between any two. Neither are the
    first `unknown` ones.
    """
    usable = np.zeros(len(held), bool)
    usable[max(edge, unknown) : -edge] = True

    def near(mask: Mask) -> Mask:
        return ndimage.binary_dilation(mask, iterations=edge) if mask.any() else mask

    return usable & ~near(held | apart), usable & held & ~near(apart), usable & apart


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
