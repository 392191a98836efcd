"""Min-max decimation: for every column and every span of time the least and the largest value, so that no peak is lost.

Bins lie at multiples of their width, whatever is shown of them. One that is full never changes, so a page gets each once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.live.history import Rows, Stamps

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Extremes:
    """Bins that are not empty: their numbers (n,), ascending, and the least and largest values in them, (n, columns).

    Bin k holds stamps from k * width to (k + 1) * width. NaN: the column has no number in the bin.
    """

    number: Numbers
    low: Rows
    high: Rows


def extremes(stamps: Stamps, values: Rows, width: int) -> Extremes:
    """Samples in bins of `width` ns; stamps (n,) must not descend, values (n, columns). NaN counts for nothing."""
    if not len(stamps):
        empty = np.empty((0, values.shape[1]))
        return Extremes(np.empty(0, dtype=np.int64), empty, empty)
    number = stamps // width
    starts = np.concatenate(([0], np.flatnonzero(np.diff(number)) + 1))
    return Extremes(number[starts], np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts))


def thinned(stamps: Stamps, values: Rows, most: int) -> tuple[int, Extremes]:
    """At most `most` + 1 bins over all the samples, and their width in ns."""
    span = int(stamps[-1] - stamps[0]) + 1 if len(stamps) else 1
    width = max(1, -(-span // most))
    return width, extremes(stamps, values, width)


class Bins:
    """The newest `count` bins of one width (ns), filled as samples come."""

    def __init__(self, width: int, columns: int, count: int) -> None:
        self.width = width
        self._count = count
        self._number = np.full(count, -1, dtype=np.int64)
        self._low = np.full((count, columns), np.nan)
        self._high = np.full((count, columns), np.nan)
        self.newest = -1

    def clear(self) -> None:
        """Forget everything."""
        self._number[:] = -1
        self.newest = -1

    def add(self, stamps: Stamps, values: Rows) -> None:
        """Add samples that are not older than those before: stamps (n,), values (n, columns)."""
        new = extremes(stamps, values, self.width)
        if not len(new.number):
            return
        self.newest = int(new.number[-1])
        kept = new.number > self.newest - self._count
        number, low, high = new.number[kept], new.low[kept], new.high[kept]
        places = number % self._count
        if self._number[places[0]] == number[0]:  # begun before
            low[0] = np.fmin(low[0], self._low[places[0]])
            high[0] = np.fmax(high[0], self._high[places[0]])
        self._number[places], self._low[places], self._high[places] = number, low, high

    def since(self, first: int) -> Extremes:
        """The bins from number `first` on."""
        first = max(first, self.newest - self._count + 1)
        places = np.flatnonzero((self._number >= first) & (self._number >= 0))
        places = places[np.argsort(self._number[places])]
        return Extremes(self._number[places], self._low[places], self._high[places])
