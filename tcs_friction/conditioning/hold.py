"""Torque between the samples of a log: what the hold of a drive makes of it, and when it acts.

A drive holds a torque from one tick to the next. Which of the two a log's stamp belongs to differs between drives, and clocks
differ too, so a recording has one number for all of that:

    acts        s after its stamp at which a logged value begins to act, until the next begins to; negative: before its stamp

A command that is logged when it is given has acts = 0 (`from_stamp`); a torque that is logged when its tick is over has minus
one period (`up_to_stamp`). A momentary value of a torque that changes more often than it is logged is no hold: between samples it
is nearest to a line (`Between.LINE`), which passes through the logged value in the middle of the period that a hold would have.

The mean of a held torque over any span follows from its integral, which is exact for any stamps, any `acts` and any clock:

    I(t) = integral of u,        L(t) = integral of I

The first moves the velocity over a span, both move the position.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tcs_friction.conditioning.filters import low_pass

Array = NDArray[np.float64]

MOSTLY = 0.95  # of the steps between changes, that must be whole multiples of a number of samples for values to be stale between
MOST_LOST = 3  # values in a row, between which a line says more than the last one
FEWEST_CHANGES = 20  # of a torque, before anything is said about how often it is fresh
FINER = 4  # times the rate, at which a torque's integral is taken: the images of a hold stay out of what is compared


class Between(Enum):
    """What a torque does between logged values."""

    HELD = "held"
    LINE = "line"


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """Torque of one stretch as it was logged: stamps t (m,), s, strictly increasing; values (m,), N m; period: usual step, s.

    Before the first value acts the torque is taken to have been that value, and after the last to have stayed.
    """

    t: Array
    values: Array
    period: float
    between: Between = Between.HELD

    @cached_property
    def _knots(self) -> tuple[Array, Array, Array, Array]:
        """Value and slope of each piece (m,), I and L where each begins."""
        steps = np.diff(self.t)
        slopes = np.zeros(len(self.t))
        if self.between is Between.LINE:
            slopes[:-1] = np.diff(self.values) / steps
        u, r = self.values[:-1], slopes[:-1]
        impulse = np.concatenate([[0.0], np.cumsum(u * steps + 0.5 * r * steps**2)])
        lever = np.cumsum(impulse[:-1] * steps + 0.5 * u * steps**2 + r * steps**3 / 6.0)
        return self.values, slopes, impulse, np.concatenate([[0.0], lever])

    def integrals(self, at: Array, acts: float) -> tuple[Array, Array]:
        """I and L (k,) at times (k,), s, in N m s and N m s^2."""
        values, slopes, impulse, lever = self._knots
        late = acts + 0.5 * self.period if self.between is Between.LINE else acts
        piece = np.maximum(np.searchsorted(self.t, at - late, side="right") - 1, 0)
        x = at - late - self.t[piece]
        u, r = values[piece], np.where(x > 0.0, slopes[piece], 0.0)
        first = impulse[piece] + x * (u + 0.5 * r * x)
        return first, lever[piece] + x * (impulse[piece] + x * (0.5 * u + r * x / 6.0))

    def pushes(self, edges: Array, acts: float) -> tuple[Array, Array]:
        """Torque over the spans between edges (k + 1,), s: its mean (k,), and the constant one (k,) that moves as far."""
        first, second = self.integrals(edges, acts)
        steps = np.diff(edges)
        return np.diff(first) / steps, 2.0 * (np.diff(second) - first[:-1] * steps) / steps**2

    def low_passed(self, t: Array, dt: float, cutoff: float, acts: float) -> Array:
        """(n,) the torque at even times t (n,), s, `dt` apart, behind a zero-phase low pass at `cutoff`, Hz.

        It is the derivative of the low-passed integral, which is that of what the hold makes of the torque.
        """
        fine = t[0] + np.arange(FINER * (len(t) - 1) + 1) * (dt / FINER)
        impulse = self.integrals(fine, acts)[0]
        return np.ascontiguousarray(low_pass(impulse, dt / FINER, cutoff, 1)[1][::FINER])

    def values_at(self, at: Array) -> Array:
        """(k,) the last value logged at or before each time, s."""
        return np.asarray(self.values[np.maximum(np.searchsorted(self.t, at + 1e-9, side="right") - 1, 0)])

    def drawn(self, between: Between) -> LoggedTorque:
        """The same with another idea of what is between; a line passes through fresh values only."""
        if between is self.between:
            return self
        if between is Between.HELD:
            return replace(self, between=between)
        kept = fresh(self.t, self.values)
        period = self.period if len(kept) == len(self.t) else float(np.median(np.diff(self.t[kept])))
        return LoggedTorque(self.t[kept], self.values[kept], period, between)


def logged(t: Array, values: Array) -> LoggedTorque:
    """A log with its lost values put back on a line between those beside them: a drive goes on where a message is lost."""
    steps = np.diff(t)
    period = float(np.median(steps))
    lost = np.maximum(np.rint(steps / period).astype(np.int64) - 1, 0)
    lost[lost > MOST_LOST] = 0
    if not lost.any():
        return LoggedTorque(t, values, period)
    share = np.concatenate([np.arange(count + 1) / (count + 1.0) for count in lost] + [np.zeros(1)])
    first = np.append(np.repeat(np.arange(len(steps)), lost + 1), len(steps))
    after = np.minimum(first + 1, len(steps))
    full = t[first] + share * (t[after] - t[first])
    return LoggedTorque(full, values[first] + share * (values[after] - values[first]), period)


def stale_stride(values: Array) -> int:
    """Of how many samples each value is repeated, because whoever logs is quicker than the torque is renewed; 1: none is."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if len(changes) < FEWEST_CHANGES:
        return 1
    apart = np.diff(changes)
    stride = int(np.bincount(apart).argmax())
    return stride if stride > 1 and np.mean(apart % stride == 0) >= MOSTLY else 1


def fresh(t: Array, values: Array) -> NDArray[np.intp]:
    """Samples at which a value is new: all, unless values are repeated by a rule; where they rest, one for each such time."""
    stride = stale_stride(values)
    if stride == 1:
        return np.arange(len(t))
    changes = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1, [len(t)]])
    kept = [np.arange(a, b, stride) for a, b in itertools.pairwise(changes)]
    return np.concatenate(kept)
