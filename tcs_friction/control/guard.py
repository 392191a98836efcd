"""The guard of a compensation: what is believed of an axis acts only if measured tracking is better for it.

A model may be wrong in size, sign or phase, and then its compensation hurts. Each candidate is tried on the axis, several runs
each, and takes the place of the best so far only where the measured error is smaller beyond its uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.tracking import Improvement, improvement
from tcs_friction.errors import InputError

Array = NDArray[np.float64]
Candidate = TypeVar("Candidate", bound=Hashable)

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


def verified(
    start: Candidate, candidates: Sequence[Candidate], measure: Callable[[Candidate], Array]
) -> tuple[Candidate, dict[Candidate, Improvement]]:
    """The best of what was tried, and what each candidate gained over the best before it.

    measure: errors (w,) in the same windows of the same runs for every candidate (`windowed`).
    """
    best, errors = start, measure(start)
    gains: dict[Candidate, Improvement] = {}
    for candidate in candidates:
        if candidate == best or candidate in gains:
            continue
        tried = measure(candidate)
        gains[candidate] = improvement(errors, tried)
        if gains[candidate].proven:
            best, errors = candidate, tried
    return best, gains


def subsets(effects: Sequence[str]) -> list[tuple[str, ...]]:
    """Which effects to try: all, each alone, all but one; in an order in which the likely best comes first."""
    every = tuple(effects)
    alone = [(name,) for name in every]
    fewer = [tuple(other for other in every if other != name) for name in every]
    return list(dict.fromkeys([every, *alone, *fewer]))
