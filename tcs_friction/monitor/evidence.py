"""Sequential tests of blocks against a baseline: e-values, with a bound on false alarms over all tests together.

At every look a test has the standardised deviation z of its mean from the learned one, less a margin m for what is uncertain
there. For a change of size d (standard deviations of one look)

    e = exp(d z' - d^2 / 2),  z' = +-(z) - m,

has an expectation of at most 1 as long as the mean has not moved beyond the margin and z is no wider than normal: it is an
e-value. M = max(M, 1) e is an e-detector (Shin, Ramdas, Rinaldo 2022), and so is any mean of them with weights that sum to 1,
such as the one here over all coordinates, tests, signs and sizes. The mean time between false alarms at M >= A is at least A
looks, whatever the dependence between the tests. For a line of the spectrum, whose power p over its level is exponentially
distributed, e = exp(p c / (1 + c)) / (1 + c).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.monitor.bank import (
    LINEAR,
    LINES,
    LOOK,
    Spectrum,
    Sums,
    add,
    empty_spectrum,
    empty_sums,
    judged,
    transform,
)
from tcs_friction.monitor.baseline import LEAST_WEIGHT, PRIOR, Baseline
from tcs_friction.monitor.residual import END, PARTS, PLACE, RESIDUAL

Array = NDArray[np.float64]

SIZES = np.array([0.35, 0.7, 1.4, 2.8])  # of changes, in standard deviations of a look
RISES = np.array([0.5, 1.5, 5.0])  # of the power of a line, over its level
MARGIN = 3.0  # standard deviations of what was learned that are no change
MOST = 5.0  # of z' at one look: no single look is an alarm
MOST_POWER = 12.0

# Slots of Evidence.status
LOOKS, JUDGED, OTHER, LATEST, LEFT = range(5)
"""Looks; blocks judged and others; time of the last block (s); what was left of its residual (N m), NaN of one not judged."""


class Evidence(NamedTuple):
    """The state of all tests. Arrays are live. Linear tests (j,), signs (2), sizes (d); lines (f,), rises (c)."""

    sums: Sums
    spectrum: Spectrum
    power: Array  # (f,)
    grown: Array  # (j, 2, d) log M
    since: Array  # (j, 2, d) s, when M was 1 last
    moved: Array  # (j, 2, d, 2) since then: sum of the deviations of g r, and of g^2
    line_grown: Array  # (f, c)
    line_since: Array  # (f, c)
    logs: Array  # (LINEAR + 1,) natural logarithm of the evidence of each coordinate
    status: Array  # (5,)


def fresh(base: Baseline, begin: float = 0.0) -> Evidence:
    """No evidence of anything at `begin` (s)."""
    tests, sizes = int(base.known.ends[-1]), len(SIZES)
    return Evidence(
        empty_sums(base.known, len(PRIOR)),
        empty_spectrum(),
        np.zeros(LINES),
        np.zeros((tests, 2, sizes)),
        np.full((tests, 2, sizes), begin),
        np.zeros((tests, 2, sizes, 2)),
        np.zeros((LINES, len(RISES))),
        np.full((LINES, len(RISES)), begin),
        np.zeros(LINEAR + 1),
        np.array([0.0, 0.0, 0.0, 0.0, math.nan]),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _left(base: Any, row: Any) -> float:
    """Residual (N m) of a block less what was learned."""
    r = row[RESIDUAL]
    parts = row[PARTS]
    for p in range(len(parts)):
        r -= base.shares[p] * parts[p]
    for w in range(len(base.waves)):
        phase = base.waves[w, 0] * row[PLACE]
        r -= base.waves[w, 1] * math.cos(phase) + base.waves[w, 2] * math.sin(phase)
    return float(r)


@njit(cache=True, error_model="numpy", inline="always")
def _margin(base: Any, sums: Any, j: int) -> float:
    """By how much (N m) the mean of a test may be off without a change."""
    parts, variance = sums.parts[j], base.variance[j]
    share = 0.0
    for p in range(len(parts)):
        for q in range(len(parts)):
            share += parts[p] * base.covariance[p, q] * parts[q]
    return float(MARGIN * math.sqrt(max(variance + share / sums.weight[j] ** 2, 0.0)))


@njit(cache=True, error_model="numpy")
def _update(base: Any, e: Any, j: int, now: float) -> None:
    """A look at one test."""
    weight = e.sums.weight[j]
    deviation = e.sums.residual[j] - base.mean[j] * weight
    scale = base.noise * base.scatter[j] * math.sqrt(weight)
    margin = _margin(base, e.sums, j) * weight
    for sign in range(2):
        z = min(((deviation if sign == 0 else -deviation) - margin) / scale, MOST)
        for d in range(len(SIZES)):
            grown = e.grown[j, sign, d] + SIZES[d] * z - 0.5 * SIZES[d] ** 2
            if grown <= 0.0:
                e.grown[j, sign, d], e.since[j, sign, d] = 0.0, now
                e.moved[j, sign, d, 0] = e.moved[j, sign, d, 1] = 0.0
                continue
            e.grown[j, sign, d] = grown
            e.moved[j, sign, d, 0] += deviation
            e.moved[j, sign, d, 1] += weight
    e.sums.residual[j] = e.sums.weight[j] = 0.0
    e.sums.parts[j] = 0.0


@njit(cache=True, error_model="numpy")
def _update_lines(base: Any, e: Any, now: float) -> None:
    """A window of the spectrum has ended."""
    for f in range(len(e.power)):
        power = min(e.power[f] / base.level[f], MOST_POWER)
        for c in range(len(RISES)):
            grown = e.line_grown[f, c] + power * RISES[c] / (1.0 + RISES[c]) - math.log1p(RISES[c])
            e.line_grown[f, c] = max(grown, 0.0)
            if grown <= 0.0:
                e.line_since[f, c] = now


@njit(cache=True, error_model="numpy", inline="always")
def _log_mean(grown: Any) -> float:
    """Logarithm of the mean of M over all entries of log M."""
    top = grown.max()
    total = 0.0
    for x in grown.flat:
        total += math.exp(x - top) if x > top - 40.0 else 0.0
    return float(top + math.log(total / grown.size))


@njit(cache=True, error_model="numpy")
def _look(base: Any, e: Any, now: float) -> None:
    """Update the tests that have seen enough, and the evidence of each coordinate."""
    first = 0
    for coordinate in range(len(base.known.ends)):
        last = base.known.ends[coordinate]
        for j in range(first, last):
            if base.active[j] and e.sums.weight[j] >= LEAST_WEIGHT:
                _update(base, e, j, now)
        e.logs[coordinate] = _log_mean(e.grown[first:last])
        first = last
    e.logs[len(base.known.ends)] = _log_mean(e.line_grown)
    e.status[LOOKS] += 1.0


@njit(cache=True, error_model="numpy")
def judge(base: Any, e: Any, row: Any) -> bool:
    """One block (COLUMNS,) more; whether it ended with a look."""
    now = e.status[LATEST] = row[END]
    counts = judged(row, base.known)
    r = _left(base, row) if counts else 0.0
    if transform(e.spectrum, r, counts, e.power):
        _update_lines(base, e, now)
    e.status[LEFT] = r if counts else math.nan
    if not counts:
        e.status[OTHER] += 1.0
        return False
    add(e.sums, base.known, row, r)
    e.status[JUDGED] += 1.0
    if e.status[JUDGED] % LOOK != 0.0:
        return False
    _look(base, e, now)
    return True


@njit(cache=True, error_model="numpy")
def judge_all(base: Any, e: Any, rows: Any, limit: float, highest: Any) -> int:
    """Blocks (n, COLUMNS) until the evidence (natural logarithm) reaches `limit`; the index of that block, -1 where none does.

    `highest` (1,) keeps the largest logarithm of the evidence.
    """
    for i in range(len(rows)):
        if judge(base, e, rows[i]):
            total = combined(e.logs)
            highest[0] = max(highest[0], total)
            if total >= limit:
                return i
    return -1


@njit(cache=True, error_model="numpy")
def combined(logs: Any) -> float:
    """Logarithm of the mean evidence of all coordinates."""
    return _log_mean(logs)
