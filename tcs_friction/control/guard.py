"""The guard of a compensation: what is believed of an axis acts only if measured tracking is better for it.

A model may be wrong in size, sign or phase, and then its compensation hurts. Sets of its effects are tried on the axis, and an
effect stays only where the measured error is smaller with it than without it, beyond the uncertainty of both.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.tracking import Improvement, improvement
from tcs_friction.errors import InputError

Array = NDArray[np.float64]

WINDOW = 1.0  # s, over which errors are averaged: longer than a loop's answer, so that windows are nearly independent


def windowed(t: Array, error: Array, settle: float, window: float = WINDOW) -> Array:
    """Rms (w,) of a tracking error (n,) in each whole window (s) of a run after the first `settle` seconds.

    Raises InputError for a run that is shorter than that.
    """
    count = int((t[-1] - t[0] - settle) / window)
    if count < 1:
        raise InputError("run", f"{t[-1] - t[0]:g} s", f"more than {settle + window:g} s, to be judged")
    place = np.floor((t - t[0] - settle) / window).astype(int)
    inside = (place >= 0) & (place < count)
    power = np.bincount(place[inside], error[inside] ** 2, count) / np.bincount(place[inside], minlength=count)
    return np.asarray(np.sqrt(power))


@dataclass(frozen=True)
class Gain:
    """What an effect's cancellation was worth: rms error without and with it, and what became of the error in every window."""

    without: float
    cancelled: float
    improvement: Improvement

    @classmethod
    def of(cls, without: Array, cancelled: Array) -> Gain:
        """From the errors (w,) of two sets that differ by the effect."""
        return cls(_rms(without), _rms(cancelled), improvement(without, cancelled))

    @property
    def proven(self) -> bool:
        """The error is smaller with it, with a probability of 95 %."""
        return self.improvement.proven


@dataclass(frozen=True)
class Chosen:
    """Which effects are cancelled after all, and what was measured.

    effects: None where nothing was better than what was before. gains: of each effect that was judged, from the best set
    without it to the one with it. errors: (w,) of the set that is chosen.
    """

    effects: tuple[str, ...] | None
    gains: Mapping[str, Gain]
    errors: Array


Trials = Generator[tuple[str, ...], Array | None, Chosen]
"""Yields sets of effects to be tried; is sent errors (w,) in the same windows of the same runs, None where a set is refused."""


def choose(effects: Sequence[str], before: Array) -> Trials:
    """Find the effects that are worth being cancelled, beginning with all of them.

    before: errors (w,) without any. If all together are better, each is left out once, and stays out unless it is needed.
    Otherwise each is tried alone, and they are added one by one, the best first.
    """
    every = tuple(effects)
    gains: dict[str, Gain] = {}
    errors = yield every
    if errors is None or not improvement(before, errors).proven:
        return (yield from _added(every, before, gains))
    best = every
    for name in every:
        fewer = tuple(other for other in best if other != name)
        without = yield fewer
        if without is not None:
            gains[name] = Gain.of(without, errors)
            if not gains[name].proven:
                best, errors = fewer, without
    if improvement(before, errors).proven:
        return Chosen(best, gains, errors)
    return Chosen(None, gains, before)


def _added(every: tuple[str, ...], before: Array, gains: dict[str, Gain]) -> Trials:
    """One effect after the other, in the order of what each is worth alone."""
    alone: dict[str, Array] = {}
    for name in every if len(every) > 1 else ():
        errors = yield (name,)
        if errors is not None:
            alone[name] = errors
            gains[name] = Gain.of(before, errors)
    best: tuple[str, ...] = ()
    least = before
    for name in sorted(alone, key=lambda name: gains[name].improvement.ratio):
        errors = alone[name]
        if best:
            errors = yield tuple(other for other in every if other in (*best, name))
        if errors is not None:
            gains[name] = Gain.of(least, errors)
            if gains[name].proven:
                best, least = (*best, name), errors
    return Chosen(tuple(name for name in every if name in best) or None, gains, least)


def judged(trials: Trials, measure: Callable[[tuple[str, ...]], Array | None]) -> Chosen:
    """Run trials whose measurement is an ordinary function."""
    try:
        wanted = next(trials)
        while True:
            wanted = trials.send(measure(wanted))
    except StopIteration as end:
        chosen: Chosen = end.value
        return chosen


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
