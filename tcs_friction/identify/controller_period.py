"""The period of the controller behind a recording: its torque is new once a period, however often it was logged.

Whether a torque is held, and how long, is told by `recording.freshness`, as for every signal; here it becomes a round number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tcs_friction.recording.freshness import fresh_samples
from tcs_friction.recording.recording import Recording

CLOCK = 1e-3  # relative: clocks of computers agree better, so what is nearer to a round number is that
DIGITS = 2  # of a round number, at most


def controller_period(recordings: Sequence[Recording]) -> tuple[float, str]:
    """Seconds, and what they follow from."""
    steps = np.concatenate([np.diff(one.t[part]) for one in recordings for part in one.segments])
    stretches = [(one.t[part], one.torque[part]) for one in recordings for part in one.segments]
    t, torque = max(stretches, key=lambda stretch: len(stretch[0]))
    period, share = fresh_samples(t, torque)
    if share < 1.0:  # a change is seen at the next sample: each interval is off by one of the log at most
        off = 3.0 * float(np.median(steps)) / period / math.sqrt(max(1.0, (t[-1] - t[0]) / period))
        return rounded(period, off), "every so long the recorded torque is new"
    return rounded(float(np.median(steps)), _unsure(steps)), "between the samples of the log"


def _unsure(intervals: np.ndarray) -> float:
    """Three standard errors of the median of intervals (k,), relative, by their quartiles (McGill, Tukey & Larsen 1978)."""
    low, middle, high = np.quantile(intervals, [0.25, 0.5, 0.75])
    return float(3.0 * 0.93 * (high - low) / math.sqrt(len(intervals)) / middle)


def rounded(period: float, unsure: float = 0.0) -> float:
    """The roundest period (s) or rate within what clocks differ by, or what is unsure, both relative.

    >>> rounded(0.0039998), rounded(1.0 / 119.99), rounded(0.00229597)
    (0.004, 0.008333333333333333, 0.00229597)
    """
    for digits in range(1, DIGITS + 1):
        found = min(_to_digits(period, digits), 1.0 / _to_digits(1.0 / period, digits), key=lambda one: abs(one - period))
        if abs(found - period) < max(CLOCK, unsure) * period:
            return found
    return period


def _to_digits(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")


