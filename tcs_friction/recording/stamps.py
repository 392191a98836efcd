"""Which clock the messages of a topic are taken by, header stamps or log times, and how the two run beside each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording import clock
from tcs_friction.recording.columns import Mask, Nanoseconds, TopicColumns, counted
from tcs_friction.recording.mending import mended

LOOKED_AT = 3000
"""Messages from which the pace is told, so that it costs nothing; the median latency of a thousand is that of all."""
FEWEST = 30
"""Messages in which a pace can be seen: ten in each third."""
STEADY = 0.05
"""Share by which the pace of one third of a recording may differ from that of the whole; more, and one number does not say it."""
SAME_PACE = 5e-4
"""A clock that NTP disciplines runs 500 ppm off at most (RFC 5905, MAXFREQ); beyond, it is a simulator's, or none."""


@dataclass(frozen=True)
class Pace:
    """How a clock runs beside the log times: `time + rate * (log - log_time)`, ns.

    spread: of the messages about that, ns. steady: whether the whole recording has this rate. drifts: whether the rate moves
    a message by more than a period or the spread, so that a shift alone would be wrong.
    """

    log_time: int
    time: int
    rate: float
    spread: float
    steady: bool
    drifts: bool

    @property
    def shift(self) -> int:
        """Clock minus log time in the middle of the recording, ns."""
        return self.time - self.log_time

    def at(self, log_times: Nanoseconds) -> Nanoseconds:
        """The clock at log times."""
        if not self.drifts:
            return log_times + self.shift
        return self.time + np.rint((log_times - self.log_time) * self.rate).astype(np.int64)

    def log_of(self, times: Nanoseconds) -> Nanoseconds:
        """The log times at which the clock said these times."""
        if not self.drifts:
            return times - self.shift
        return self.log_time + np.rint((times - self.time) / self.rate).astype(np.int64)

    def __str__(self) -> str:
        return f"{self.rate:.4g} times as fast as the log times"


def pace(times: Nanoseconds, log_times: Nanoseconds) -> Pace:
    """How the times of (n,) messages, on one clock and without strays, run beside their log times."""
    if len(times) < FEWEST:
        at = int(log_times[len(times) // 2])
        return Pace(at, at + int(np.median(times - log_times)), 1.0, 0.0, True, False)
    every = max(1, len(times) // LOOKED_AT)
    start, log_start = int(times[0]), int(log_times[0])
    own, log = (times[::every] - start).astype(float), (log_times[::every] - log_start).astype(float)
    thirds = np.array_split(np.arange(len(own)), 3)
    first, _, last = ((np.median(own[part]), np.median(log[part])) for part in thirds)
    rate = float((last[0] - first[0]) / (last[1] - first[1])) if last[1] > first[1] else 1.0
    if not 0.0 < rate < np.inf:
        rate = 1.0
    left = own - rate * log
    offset = float(np.median(left))
    slopes = [_slope(own[part], log[part]) for part in thirds]
    spread = float(np.median([_spread(own[part] - slope * log[part]) for part, slope in zip(thirds, slopes, strict=True)]))
    wander = max(float(np.abs(np.median(left[part]) - offset)) for part in thirds)
    moved = abs(rate - 1.0) * float(np.ptp(log))
    limit = max(float(np.median(times[1::every] - times[:-1:every])), spread)
    drifts = moved > limit
    steady = wander <= limit or max(abs(slope - rate) for slope in slopes) <= STEADY * rate
    at = int(np.median(log))
    return Pace(log_start + at, start + int(rate * at + offset), rate, spread, steady, drifts)


def _spread(values: np.ndarray) -> float:
    """Three standard deviations, by the median."""
    return float(3.0 * 1.4826 * np.median(np.abs(values - np.median(values))))


def _slope(own: np.ndarray, log: np.ndarray) -> float:
    """The rate within a part, from the medians of its halves."""
    half = len(own) // 2
    passed = np.median(log[half:]) - np.median(log[:half])
    return float((np.median(own[half:]) - np.median(own[:half])) / passed) if passed > 0.0 else 1.0


def stamped(columns: TopicColumns, where: str, told: list[str]) -> Mask | None:
    """Which messages carry a header stamp to be used, None for all of them; none is true where the log times are to be used.

    A few stamps that were never set are strays. Where most were not, the log times serve, if those that were set agree with their
    pace. Raises InputError (about `where`) if they do not.
    """
    if columns.stamps is None or not len(columns):
        return np.zeros(len(columns), dtype=np.bool_)
    empty = clock.empty_stamps(columns.stamps)
    if not empty:
        return None
    good = columns.stamps > 0
    said = f"{columns.topic}: {empty} of {len(columns)} header stamps are empty"
    if 2 * empty < len(columns):
        told.append(mended(f"{said}, {counted(empty, 'message')} left out"))
        return good
    if np.count_nonzero(good) >= FEWEST:
        found = pace(columns.stamps[good], columns.log_times[good])
        if found.drifts and abs(found.rate - 1.0) > SAME_PACE:
            raise InputError(where, f"{said}, and the others run {found}", "stamps in every header, or log times at their pace")
    told.append(mended(f"{said}, log times used"))
    return np.zeros(len(columns), dtype=np.bool_)
