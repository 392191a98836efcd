"""Friction against speed as it is traced: of every short span the points of least and largest friction."""

from __future__ import annotations

import numpy as np

from tcs_friction.live.history import Rows, Stamps

WIDTH = 20_000_000  # ns


class Trail:
    """The newest `capacity` points (speed, torque), numbered from the beginning."""

    def __init__(self, capacity: int = 2000) -> None:
        self._points = np.full((capacity, 2), np.nan)
        self.count = 0

    def clear(self) -> None:
        """Forget the points; their numbers go on."""
        self._points[:] = np.nan

    def add(self, stamps: Stamps, speed: Rows, torque: Rows) -> None:
        """Samples (n,) of one stretch of time; those that are no numbers are left out."""
        known = np.isfinite(speed) & np.isfinite(torque)
        stamps, speed, torque = stamps[known], speed[known], torque[known]
        if not len(stamps):
            return
        ends = np.flatnonzero(np.diff(stamps // WIDTH)) + 1
        for part in np.split(np.arange(len(stamps)), ends):
            for k in sorted({int(part[np.argmin(torque[part])]), int(part[np.argmax(torque[part])])}):
                self._points[self.count % len(self._points)] = speed[k], torque[k]
                self.count += 1

    def since(self, first: int) -> Rows:
        """The points from number `first` on, (n, 2), oldest first."""
        first = max(first, self.count - len(self._points), 0)
        found: Rows = self._points[np.arange(first, self.count) % len(self._points)]
        return found[np.isfinite(found[:, 0])]
