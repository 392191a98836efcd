"""The period of the controller behind a recording: its torque is new once a period, however often it was logged."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tcs_friction.recording.recording import Recording

HELD = 1.5  # times between samples: a torque whose every value lasts longer is held, and not logged as often as it is made
CLOCK = 1e-3  # relative: clocks of computers agree better, so what is nearer to a round number is that
DIGITS = 2  # of a round number, at most
FEWEST = 16  # changes of the torque, from which their usual distance is told


def controller_period(recordings: Sequence[Recording]) -> tuple[float, str]:
    """Seconds, and what they follow from."""
    steps = np.concatenate([np.diff(one.t[part]) for one in recordings for part in one.segments])
    logged = float(np.median(steps))
    fresh = np.concatenate([_between_changes(one, part) for one in recordings for part in one.segments])
    # chance repeats a value now and then, and a short interval would be a change between: all but a few are as long
    if len(fresh) >= FEWEST and np.quantile(fresh, 0.05) > HELD * logged:
        held = fresh[fresh < HELD * np.median(fresh)]  # one more or one less sample of the log: the mean lies between
        return rounded(float(np.mean(held)), _unsure(held)), "every so long the recorded torque is new"
    return rounded(logged, _unsure(steps)), "between the samples of the log"


def _unsure(intervals: np.ndarray) -> float:
    """Three standard errors of the median of intervals (k,), relative, by their quartiles (McGill, Tukey & Larsen 1978)."""
    low, middle, high = np.quantile(intervals, [0.25, 0.5, 0.75])
    return float(3.0 * 0.93 * (high - low) / math.sqrt(len(intervals)) / middle)


def _between_changes(recording: Recording, part: slice) -> np.ndarray:
    """(k,) s between changes of the torque of one stretch."""
    changed = np.flatnonzero(np.diff(recording.torque[part])) + 1
    return np.diff(recording.t[part][changed])


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


