"""A reference that was recorded: samples of a position, from which speed and acceleration follow.

Each sample is replaced by the value of a cubic fitted to its neighbours (Savitzky and Golay 1964, Anal. Chem. 36, 1627), whose
derivatives are speed and acceleration. How many neighbours, generalised cross-validation decides (Craven and Wahba 1979, Numer.
Math. 31, 377): exact samples are followed as they are, rounded and held ones are smoothed. Between two samples the position is
the cubic that has their positions and speeds. A step is kept, with speed and acceleration 0 on either side of it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.signal import savgol_coeffs, savgol_filter

from tcs_friction.errors import InputError

Array = NDArray[np.float64]

CUBIC = 3
LEAST = CUBIC + 2  # samples of a fit that is no interpolation
WIDER = 1.5  # from one number of neighbours that is tried to the next
ROUNDING = 1e-6  # of a sample's step, by which the last instant may differ from the last sample's
SETTLED = 5.0  # time constants, after which a loop has settled to 1 %


@dataclass(frozen=True, eq=False)
class _Part:
    """A stretch without a step: position, speed and acceleration at even times."""

    begin: float
    t: Array
    samples: Array  # (n, 3)

    def over(self, times: Array) -> Array:
        """(m, 3), held beyond the ends."""
        inside = np.clip(times, self.t[0], self.t[-1])
        position, speed, acceleration = self.samples.T
        course = CubicHermiteSpline(self.t, position, speed)
        found = np.column_stack([course(inside), course(inside, 1), np.interp(inside, self.t, acceleration)])
        found[np.abs(inside - times) > ROUNDING * (self.t[1] - self.t[0]), 1:] = 0.0
        return found


class RecordedReference:
    """The course of recorded positions (n,) over times (n,), s; it begins at time 0.

    rest: s that a reference has to rest before and after a jump for that to be a step. A jump between shorter rests is a motion
    in counts of a coarse resolution.

    Raises InputError for fewer than two samples.
    """

    def __init__(self, t: ArrayLike, position: ArrayLike, rest: float = math.inf, source: str = "reference") -> None:
        times, positions = np.asarray(t, dtype=np.float64), np.asarray(position, dtype=np.float64)
        if len(times) < 2:
            raise InputError(source, f"{len(times)} samples of a reference", "at least 2")
        times = times - times[0]
        self.duration = float(times[-1])
        """Length of the run, s."""
        bounds = [0, *_steps(times, positions, rest), len(times)]
        self._parts = [_part(times[a:b], positions[a:b]) for a, b in itertools.pairwise(bounds)]

    def over(self, times: ArrayLike) -> Array:
        """Shape (n, 3): position, speed, acceleration at each of n times (s)."""
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        found = np.empty((len(instants), 3))
        which = np.searchsorted([part.begin for part in self._parts[1:]], instants, side="right")
        for number, part in enumerate(self._parts):
            found[which == number] = part.over(instants[which == number])
        return found


def rest_of(position_proportional: float) -> float:
    """The least rest (s) around a step, for a position loop of this gain (1/s): until it has settled."""
    return SETTLED / position_proportional if position_proportional > 0.0 else math.inf


def _steps(t: Array, position: Array, rest: float) -> list[int]:
    """Samples at which a step has come."""
    changes = np.flatnonzero(np.diff(position) != 0.0) + 1
    bounds = np.array([0, *changes, len(t)])
    lasting = np.append(t, t[-1])[bounds[1:]] - t[bounds[:-1]]
    long = lasting >= rest
    return [int(at) for at, before, after in zip(changes, long[:-1], long[1:], strict=True) if before and after]


def _part(t: Array, position: Array) -> _Part:
    begin = float(t[0])
    if len(t) < LEAST or not np.any(np.diff(position)):
        still = np.zeros((2, 3))
        still[:, 0] = position[[0, -1]]
        return _Part(begin, np.array([begin, max(float(t[-1]), begin + 1e-9)]), still)
    step = float(np.median(np.diff(t)))
    count = max(round((float(t[-1]) - begin) / step), LEAST) + 1
    even = np.linspace(begin, float(t[-1]), count)
    values = CubicSpline(t, position)(even)
    width = _width(values, _repeated(position))
    rows = [savgol_filter(values, width, CUBIC, deriv=order, delta=float(even[1] - even[0])) for order in range(3)]
    return _Part(begin, even, np.column_stack(rows))


def _repeated(position: Array) -> int:
    """How many samples in a row usually have one value: 1 unless a reference is held, or counted more coarsely than it moves."""
    changes = np.flatnonzero(np.diff(position)) + 1
    return int(np.median(np.diff([0, *changes, len(position)])))


def _width(values: Array, repeated: int) -> int:
    """How many samples (odd) a cubic is fitted to, by generalised cross-validation.

    There are as many different ones among them as it has numbers, and one more: it cannot follow a single tread of stairs.
    """
    least, width = math.inf, float(LEAST * repeated)
    best = min(2 * (int(width) // 2) + 1, len(values) - 1 + len(values) % 2)
    while width <= max(len(values) // 2, LEAST):
        odd = 2 * (int(width) // 2) + 1
        if odd > len(values):
            break
        own = float(savgol_coeffs(odd, CUBIC)[odd // 2])  # weight of the sample itself
        error = float(np.mean((values - savgol_filter(values, odd, CUBIC)) ** 2)) / (1.0 - own) ** 2
        if error < least:
            best, least = odd, error
        elif error > 4.0 * least:  # the fit no longer follows the motion
            break
        width *= WIDER
    return best
