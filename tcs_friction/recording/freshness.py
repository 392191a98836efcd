"""How often a recorded signal really has a new value: drives and bridges repeat the last one until the next comes."""

from __future__ import annotations

import numpy as np

from tcs_friction.recording.recording import Column

FEWEST = 30
"""Pairs of changes that tell a period: with fewer, one in ten of them is chance."""
LEVELS = 20
"""Different values; a signal with fewer is a switch or a test of steps, whose values last as long as somebody wants."""
LONGEST = 100
"""Samples: a value that lasts longer was commanded to last."""
QUICK = 0.1
"""Share of the pairs that may be closer than the period: noise of a second source, messages sent twice."""


def fresh_samples(seconds: Column, values: Column) -> tuple[float, float]:
    """The usual time from one fresh value to the next, s, and the share of the samples that are fresh: 1 where all are.

    seconds: (n,) rising. values: (n,). A value that stays the same because the signal rests, or moves by less than its
    resolution, is not held: only pairs of successive changes count that are both larger than one step of the resolution, since a
    signal that changes so quickly would also have changed in between. Where there are too few of them, all samples are fresh.
    """
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    steps = np.abs(np.diff(values))
    places = np.flatnonzero(steps > 0.0)
    if len(places) <= FEWEST:
        return usual, 1.0
    sizes = steps[places]
    large = sizes > 1.5 * float(sizes.min())
    gaps = np.diff(places)
    pairs = np.flatnonzero(large[1:] & large[:-1])
    if len(pairs) < FEWEST or len(np.unique(values[places])) < LEVELS:
        return usual, 1.0
    shortest = float(np.quantile(gaps[pairs], QUICK))
    if not 1.5 < shortest <= LONGEST:
        return usual, 1.0
    single = pairs[gaps[pairs] <= 1.5 * shortest]
    passed = seconds[places[single + 1]] - seconds[places[single]]
    period = float(np.mean(passed))
    return period, min(1.0, usual / period)


def longest_unchanged(seconds: Column, values: Column) -> tuple[float, float]:
    """The longest time for which a signal says exactly the same, and when that begins, s."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [len(values)]))
    first, last = edges[:-1], edges[1:] - 1
    spans = seconds[last] - seconds[first]
    widest = int(np.argmax(spans))
    return float(spans[widest]), float(seconds[first[widest]])
