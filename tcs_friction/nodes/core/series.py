"""Numbers collected tick by tick. No ROS here."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray


class Series:
    """Stamps (ns) and a fixed number of columns; the newest `limit` samples, each stamp once, none from before the newest.

    A stamp that is older than the last one starts the series anew: the clock went back, it is another run.
    """

    def __init__(self, columns: int, limit: int = 10_000_000) -> None:
        self.limit = limit
        self._columns = columns
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.stamps = array("q")
        self._values = [array("d") for _ in range(self._columns)]

    def __len__(self) -> int:
        return len(self.stamps)

    def append(self, stamp: int, *values: float) -> bool:
        """Add a sample; False when it is a repetition of the last one."""
        if self.stamps:
            last = self.stamps[-1]
            if stamp == last:
                return False
            if stamp < last:
                self.clear()
            elif len(self.stamps) >= 2 * self.limit:
                self._forget(len(self.stamps) - self.limit)
        self.stamps.append(stamp)
        for column, value in zip(self._values, values, strict=True):
            column.append(value)
        return True

    def _forget(self, count: int) -> None:
        del self.stamps[:count]
        for column in self._values:
            del column[:count]

    def newest(self) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
        """Stamps in ns and the columns, each (n,), n at most `limit`."""
        first = max(0, len(self.stamps) - self.limit)
        return np.array(self.stamps[first:], dtype=np.int64), [np.array(column[first:]) for column in self._values]

    def arrays(self) -> list[NDArray[np.float64]]:
        """Time in s and the columns, each (n,), n at most `limit`."""
        stamps, columns = self.newest()
        return [stamps.astype(np.float64) * 1e-9, *columns]
