"""Samples of two topics that answer the same state: those with equal stamps."""

from __future__ import annotations

import numpy as np

from tcs_friction.live.history import Rows, Stamps

LONGEST_WAIT = 4000
"""Samples of one topic that are kept for the other's to come."""


class Join:
    """Pairs of samples with equal stamps, each once, as both topics come. A sample without a partner is left out."""

    def __init__(self, left: int, right: int) -> None:
        self._columns = (left, right)
        self.clear()

    def clear(self) -> None:
        """Forget what waits for its partner."""
        self._stamps = [np.empty(0, dtype=np.int64) for _ in self._columns]
        self._rows = [np.empty((0, columns)) for columns in self._columns]

    def add(self, left: tuple[Stamps, Rows], right: tuple[Stamps, Rows]) -> tuple[Stamps, Rows, Rows]:
        """New samples of both, with ascending stamps: the stamps of the pairs (n,), and the rows of both (n, columns)."""
        for side, (stamps, rows) in enumerate((left, right)):
            self._stamps[side] = np.concatenate([self._stamps[side], stamps])[-LONGEST_WAIT:]
            self._rows[side] = np.concatenate([self._rows[side], rows])[-LONGEST_WAIT:]
        common, first, second = np.intersect1d(self._stamps[0], self._stamps[1], assume_unique=True, return_indices=True)
        found = common, self._rows[0][first], self._rows[1][second]
        if len(common):
            for side in range(2):
                after = np.searchsorted(self._stamps[side], common[-1], side="right")
                self._stamps[side], self._rows[side] = self._stamps[side][after:], self._rows[side][after:]
        return found
