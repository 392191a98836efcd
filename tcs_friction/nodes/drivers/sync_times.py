"""Which SYNC a PDO answers. A PDO that was on the bus before a SYNC answers an earlier one, however late its message is read.

Adapters give each message the time at which it came, on a clock of their own. The smallest difference between that clock and the
steady one, among the last messages, is that of messages that were read at once; it takes one to the other.
"""

from __future__ import annotations

from collections import deque

KEPT = 16
"""SYNCs that an answer may belong to."""
COMPARED = 100
"""Messages whose times are compared: clocks drift by some 10 us in the time that these take."""


class SyncTimes:
    """The last SYNCs, by number, with stamp (ns) and steady time (s). Two threads may use it: one sends, one hears."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, int, float]] = deque([(0, 0, float("-inf"))], maxlen=KEPT)
        self._lags: deque[float] = deque(maxlen=COMPARED)

    def sent(self, stamp: int, now: float) -> None:
        """Another SYNC is about to be sent."""
        self._sent.append((self._sent[-1][0] + 1, stamp, now))

    def answered(self, timestamp: float, now: float) -> tuple[int, int]:
        """Number and stamp of the SYNC that a PDO answers; number 0 stands for one before the oldest that is kept.

        timestamp: the adapter's, s, 0 for none. now: steady time at which it is read, s.
        """
        came = now
        if timestamp > 0.0:
            self._lags.append(now - timestamp)
            came = timestamp + min(self._lags)
        for number, stamp, time in reversed(tuple(self._sent)):
            if time <= came:
                return number, stamp
        return 0, 0
