"""How well an axis tracks: the numbers of the paper's Table 3."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tcs_friction.errors import InputError

Array = NDArray[np.float64]

ARCSEC = np.pi / 648000.0
"""One arcsecond in rad."""
TINY = 1e-300
"""Instead of an error of exactly 0, so that its logarithm exists."""


@dataclass(frozen=True)
class TrackingErrors:
    """Average peaks at reversals to positive and to negative motion, RMS over the run; units of the error.

    A peak is the largest magnitude of the error around one reversal, whatever its sign, so that an error that
    compensation has turned over counts as well. `peak_negative` is given with a minus sign, as in the paper.
    """

    peak_positive: float
    peak_negative: float
    rms: float
    reversals: int


def reversals(t: Array, reference_velocity: Array) -> Array:
    """Times (s) at which the reference speed changes sign, and the new sign: shape (k, 2)."""
    moving = np.flatnonzero(reference_velocity != 0.0)
    signs = np.sign(reference_velocity[moving])
    at = np.flatnonzero(signs[1:] != signs[:-1]) + 1
    return np.column_stack([t[moving[at]], signs[at]])


@dataclass(frozen=True)
class Improvement:
    """What became of the tracking error from one run to another of the same reference.

    ratio: RMS error after over before, the geometric mean over the reversals. lowest, highest: its 90 % interval, from the
    scatter between the reversals; infinitely wide where there are fewer than two.
    """

    ratio: float
    lowest: float
    highest: float

    @property
    def proven(self) -> bool:
        """The error has become smaller, with a probability of 95 %."""
        return self.highest < 1.0


def improvement(before: Array, after: Array) -> Improvement:
    """From the RMS errors around each reversal, (k,), of two runs of the same reference.

    Reversals are compared one by one, since each is different, and by ratios, since those are alike.
    """
    count = min(len(before), len(after))
    if count < 2:
        return Improvement(float("nan"), 0.0, float("inf"))
    shares = np.log(np.maximum(after[:count], TINY) / np.maximum(before[:count], TINY))
    mean, spread = float(shares.mean()), float(shares.std(ddof=1)) / np.sqrt(count)
    reach = float(stdtrit(count - 1, 0.95)) * spread
    with np.errstate(over="ignore"):
        return Improvement(float(np.exp(mean)), float(np.exp(mean - reach)), float(np.exp(mean + reach)))


def errors_by_reversal(t: Array, reference_velocity: Array, error: Array, settle: float = 0.0) -> Array:
    """RMS error around each reversal after the first `settle` seconds, half-way to the reversals beside it; (k,)."""
    crossings = reversals(t, reference_velocity)[:, 0]
    crossings = crossings[crossings > t[0] + settle]
    middles = 0.5 * (crossings[1:] + crossings[:-1])
    limits = np.concatenate([[t[0] + settle], middles, [np.inf]])
    parts = [error[(t >= begin) & (t < end)] for begin, end in itertools.pairwise(limits)]
    return np.array([np.sqrt(np.mean(part**2)) for part in parts[: len(crossings)]])


def tracking_errors(t: Array, reference_velocity: Array, error: Array, settle: float = 0.0) -> TrackingErrors:
    """The numbers of Table 3 over a run, leaving out its first `settle` seconds. Arrays (n,).

    Around each reversal the peak is sought up to a quarter of the way to the reversals beside it.

    Raises InputError if the run is over before `settle` or never reverses after it.
    """
    keep = t >= t[0] + settle
    crossings = reversals(t, reference_velocity)
    crossings = crossings[crossings[:, 0] > t[0] + settle]
    if not np.any(keep) or len(crossings) == 0:
        raise InputError("tracking run", "no reversal of the reference", "a run that crosses zero speed")
    gaps = np.diff(crossings[:, 0], prepend=t[0] + settle, append=t[-1])
    peaks: dict[float, list[float]] = {1.0: [], -1.0: []}
    for i, (time, sign) in enumerate(crossings):
        after = gaps[i + 1]
        before = gaps[i] if i > 0 else after
        around = (t >= time - 0.25 * before) & (t <= time + 0.25 * after) & keep
        peaks[sign].append(float(np.max(np.abs(error[around]))))
    return TrackingErrors(
        float(np.mean(peaks[1.0])) if peaks[1.0] else float("nan"),
        -float(np.mean(peaks[-1.0])) if peaks[-1.0] else float("nan"),
        float(np.sqrt(np.mean(error[keep] ** 2))),
        len(crossings),
    )
