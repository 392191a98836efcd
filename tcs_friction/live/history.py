"""The newest samples of a topic, in memory that is taken once.

One thread appends, another reads. Nothing waits: a reader copies and then looks whether the writer has overtaken it.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]
Rows = NDArray[np.float64]


class History:
    """The newest `capacity` samples: a stamp in ns and `columns` numbers each."""

    def __init__(self, columns: int, capacity: int = 1 << 17) -> None:
        self.capacity = capacity
        self.columns = columns
        self.count = 0
        """Samples appended since the beginning."""
        self._pack = struct.Struct(f"=q{columns}d")
        self._size = self._pack.size
        self._bytes = bytearray(b"\xff") * (capacity * self._size)  # written, so that it does not grow later
        self._stamps = np.frombuffer(self._bytes, np.int64).reshape(capacity, columns + 1)
        self._values = np.frombuffer(self._bytes, np.float64).reshape(capacity, columns + 1)

    def append(self, stamp: int, *values: float) -> None:
        """Add a sample; the oldest makes room."""
        count = self.count
        self._pack.pack_into(self._bytes, count % self.capacity * self._size, stamp, *values)
        self.count = count + 1

    def since(self, first: int) -> tuple[int, Stamps, Rows]:
        """The samples from number `first` on that are still there: number of the first, stamps (n,), values (n, columns)."""
        end = self.count
        first = max(first, end - self.capacity, 0)
        places = np.arange(first, end) % self.capacity
        stamps, values = self._stamps[places, 0], self._values[places, 1:]
        overtaken = max(0, self.count + 1 - self.capacity - first)  # the one that is being written counts, too
        return min(first + overtaken, end), stamps[overtaken:], values[overtaken:]

    def between(self, begin: int, end: int, most: int = 1 << 62) -> tuple[Stamps, Rows]:
        """Of the newest `most` samples those of the newest run with stamps (ns) from `begin` to `end`."""
        _, stamps, values = self.since(self.count - most)
        back = np.flatnonzero(np.diff(stamps) < 0)
        if len(back):
            stamps, values = stamps[back[-1] + 1 :], values[back[-1] + 1 :]
        low, high = np.searchsorted(stamps, [begin, end + 1])
        return stamps[low:high], values[low:high]

    def oldest(self) -> int:
        """The stamp (ns) of the oldest sample that is there, -1 for none."""
        return int(self._stamps[max(0, self.count - self.capacity) % self.capacity, 0]) if self.count else -1
