"""Torque between the samples of a log: what the hold of a drive makes of it, and when it acts.

A drive holds a torque from one tick to the next. Which of the two a log's stamp belongs to differs between drives, and clocks
differ too, so a recording has one number for all of that:

    acts        s after its stamp at which a logged value begins to act, until the next begins to; negative: before its stamp

A command that is logged when it is given has acts = 0 (`from_stamp`); a torque that is logged when its tick is over has minus
one period (`up_to_stamp`). Where stamps jitter, a value that is held up to its stamp begins at the stamp before, which is not one
usual period earlier (`Between.HELD_UP_TO`); it begins later than that by as much as `acts` is more than minus one period.

A momentary value of a torque that changes more often than it is logged is no hold: between samples it is nearest to a smooth line
(`Between.LINE`), which passes through the logged value in the middle of the period that a hold would have.

The mean of a held torque over any span follows from its integral, which is exact for any stamps, any `acts` and any clock:

    I(t) = integral of u,        L(t) = integral of I

The first moves the velocity over a span, both move the position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, PPoly
from scipy.ndimage import uniform_filter1d

from tcs_friction.conditioning.filters import low_pass
from tcs_friction.conditioning.sampling import even

Array = NDArray[np.float64]

MOSTLY = 0.95  # of the steps between changes, that must be whole multiples of a number of samples for values to be stale between
MOST_LOST = 3  # values in a row, between which a line says more than the last one
FEWEST_CHANGES = 20  # of a torque, before anything is said about how often it is fresh
AROUND = 5  # values on either side: of eleven squares, a mean is known to 43 % (chi squared), and what is nearer is alike
FINER = 4  # times the rate, at which a torque's integral is taken: the images of a hold stay out of what is compared


class Between(Enum):
    """What a torque does between logged values."""

    HELD = "held"
    HELD_UP_TO = "held_up_to_stamp"
    LINE = "line"


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """Torque of one stretch as it was logged: stamps t (m,), s, strictly increasing; values (m,), N m; period: usual step, s.

    lost (m,): 1 where a value was not logged and others stand for it, else 0.

    Before the first value acts the torque is taken to have been that value, and after the last to have stayed.
    """

    t: Array
    values: Array
    period: float
    between: Between = Between.HELD
    lost: Array | None = None

    @cached_property
    def _begins(self) -> Array:
        """(m,) s, when each value begins to act if `acts` is 0."""
        if self.between is Between.HELD:
            return self.t
        return np.append(self.t[0], self.t[:-1] + self.period)

    @property
    def even(self) -> bool:
        """Whether stamps are so even that it does not matter which of two a hold begins with."""
        return even(self.t, 1.0 / self.period)

    @cached_property
    def _held(self) -> tuple[Array, Array]:
        """I and L where each value begins to act (m,)."""
        steps = np.diff(self._begins)
        impulse = np.concatenate([[0.0], np.cumsum(self.values[:-1] * steps)])
        lever = np.cumsum(impulse[:-1] * steps + 0.5 * self.values[:-1] * steps**2)
        return impulse, np.concatenate([[0.0], lever])

    @cached_property
    def _curve(self) -> tuple[PPoly, PPoly]:
        """I and L of a cubic through the values that does not swing beside a step (Akima 1970)."""
        curve = Akima1DInterpolator(self.t, self.values)
        return curve.antiderivative(1), curve.antiderivative(2)

    def integrals(self, at: Array, acts: float) -> tuple[Array, Array]:
        """I and L (k,) at times (k,), s, in N m s and N m s^2."""
        if self.between is not Between.LINE:
            impulse, lever = self._held
            piece = np.maximum(np.searchsorted(self._begins, at - acts, side="right") - 1, 0)
            x, u = at - acts - self._begins[piece], self.values[piece]
            return impulse[piece] + x * u, lever[piece] + x * (impulse[piece] + x * 0.5 * u)
        late = at - acts - 0.5 * self.period
        inside = np.clip(late, self.t[0], self.t[-1])
        first, second = (curve(inside) for curve in self._curve)
        x, u = late - inside, np.where(late > self.t[0], self.values[-1], self.values[0])
        return first + x * u, second + x * (first + x * 0.5 * u)

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

    @cached_property
    def roughness(self) -> Array:
        """(m,) rms by which values about each lie off the line between their neighbours; of held ones, where they were lost."""
        off = np.convolve(np.pad(self.values, 1, mode="edge"), [-0.5, 1.0, -0.5], mode="valid")
        rough = np.sqrt(np.maximum(uniform_filter1d(off**2, 2 * AROUND + 1, mode="nearest"), 0.0))
        if self.between is Between.LINE:
            return np.asarray(rough)
        return np.zeros(len(rough)) if self.lost is None else rough * self.lost

    def drawn(self, between: Between) -> LoggedTorque:
        """The same with another idea of what is between; a line passes through fresh values only."""
        if between is self.between:
            return self
        if between is not Between.LINE:
            return replace(self, between=between)
        kept = fresh(self.t, self.values)
        period = self.period if len(kept) == len(self.t) else float(np.median(np.diff(self.t[kept])))
        return LoggedTorque(self.t[kept], self.values[kept], period, between)


def logged(t: Array, values: Array) -> LoggedTorque:
    """A log with its lost values put back: what is repeated beside them, else a line, since a drive goes on."""
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
    filled, recorded = values[first] + share * (values[after] - values[first]), share == 0.0
    at = np.arange(len(full))
    new = _new(_numbers(full), *_changes(_numbers(t), values))
    begins, ends = np.maximum.accumulate(np.where(new, at, 0)), np.append(_next(new, at)[1:], len(at))
    before, behind = np.maximum.accumulate(np.where(recorded, at, -1)), _next(recorded, at)
    same = np.where(before >= begins, before, np.where(behind < ends, behind, begins))
    return LoggedTorque(full, filled[same], period, lost=np.where(recorded[same], 0.0, 1.0))


def _next(mask: NDArray[np.bool_], at: NDArray[np.intp]) -> NDArray[np.intp]:
    """(n,) The first place at or after each where a mask holds; n where there is none."""
    return np.minimum.accumulate(np.where(mask, at, len(at))[::-1])[::-1]


def _numbers(t: Array) -> NDArray[np.int64]:
    """(n,) Number of each stamp on an even scale of the usual period."""
    steps = np.diff(t)
    if not len(steps):
        return np.zeros(len(t), dtype=np.int64)
    return np.concatenate([[0], np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1.0))]).astype(np.int64)


def _changes(number: NDArray[np.int64], values: Array) -> tuple[NDArray[np.int64], int]:
    """Numbers (k,) of samples that differ from the one a period before; of how many each value is repeated, 1 if of none."""
    changes = number[1:][(np.diff(values) != 0.0) & (np.diff(number) == 1)]
    if len(changes) < FEWEST_CHANGES:
        return changes, 1
    apart = np.diff(changes)
    lengths, counts = np.unique(apart, return_counts=True)
    stride = int(lengths[counts.argmax()])
    return changes, stride if stride > 1 and np.mean(apart % stride == 0) >= MOSTLY else 1


def _new(number: NDArray[np.int64], changes: NDArray[np.int64], stride: int) -> NDArray[np.bool_]:
    """(n,) Whether the sample of each number is due to be new, counted from the last change before it."""
    if stride == 1:
        return np.ones(len(number), dtype=bool)
    last = changes[np.maximum(np.searchsorted(changes, number, side="right") - 1, 0)]
    return np.asarray((number - last) % stride == 0)


def stale_stride(t: Array, values: Array) -> int:
    """Of how many samples each value is repeated, because whoever logs is quicker than the torque is renewed; 1: none is.

    It asks another question than `recording.freshness.fresh_samples`, which tells a mean period, also of values that are renewed
    every 4.17 samples: which of the samples are new. That is known only where the stride is a whole number, and
    a line through wrong samples would be a wrong torque, so that anything less certain counts as new. Samples that were lost
    tell nothing.
    """
    return _changes(_numbers(t), values)[1]


def fresh(t: Array, values: Array) -> NDArray[np.intp]:
    """Samples at which a value is new: all, unless values are repeated by a rule; where they rest, one for each such time."""
    number = _numbers(t)
    return np.flatnonzero(_new(number, *_changes(number, values)))
