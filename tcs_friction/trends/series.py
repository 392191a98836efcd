"""One parameter of one axis over time: what of the recordings may speak about it, joined night by night."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import theilslopes

from tcs_friction.numerics.runs import runs
from tcs_friction.trends.rows import PROGRAMME, SURROUNDINGS, Array, AxisRows, Mask

NIGHT = 1.0  # day: recordings that are nearer than this are one: they share temperature, lubricant film and mounting
FINEST = (
    200  # so many times NIGHT has to fit into all the time; recordings of a single day are joined over less
)
OUTLYING = 6.0  # robust standard deviations from the neighbours; of Gaussian errors, 1 in 5e8 is farther off
NEIGHBOURS = 4  # on each side
FEWEST_NEIGHBOURS = 4
MAD = 1.4826  # of a Gaussian: standard deviation over median absolute deviation
SEVERAL = 3  # neighbours that stand out together do not stand out alone
WORTHLESS = (
    3.0  # a standard deviation so many times larger than the value, and than the usual one, says nothing
)
THEIL_POINTS = 400


@dataclass(frozen=True)
class Series:
    """A parameter at n times in order.

    day: (n,) days since 1970; value, std: (n,); temperature: (n,) degC, NaN where not recorded; columns: name -> (n,), how the
    recordings were made; count: (n,) recordings joined in each; version: (n,) of the software.
    left_out: reason -> number of recordings that say nothing about it. outlying: days of recordings that stand out alone.
    """

    name: str
    unit: str
    day: Array
    value: Array
    std: Array
    temperature: Array
    columns: Mapping[str, Array]
    count: Array
    version: tuple[str, ...]
    left_out: Mapping[str, int]
    outlying: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.day)


def series_of(
    rows: AxisRows, name: str, unit: str, value: Array, std: Array, silent: Mask | None = None
) -> Series:
    """The parameter's values and standard deviations (n,) of the recordings of `rows`, NaN where not determined, as a series.

    silent: recordings that cannot tell it whatever they claim.
    """
    left_out: dict[str, int] = {}
    kept = np.isfinite(value) & np.isfinite(std)
    _note(left_out, "do not determine it", rows.done & ~kept)
    if silent is not None:
        _note(left_out, "never reverse, so they cannot tell it", kept & silent)
        kept &= ~silent
    vague = kept & (std > WORTHLESS * np.fmax(np.abs(value), _size(value[kept])))
    _note(left_out, "determine it too vaguely", vague)
    kept &= ~vague
    temperature = rows.columns["temperature"]
    if 2 * np.count_nonzero(np.isfinite(temperature[kept])) > np.count_nonzero(kept):
        _note(left_out, "have no temperature", kept & ~np.isfinite(temperature))
        kept &= np.isfinite(temperature)
    else:
        temperature = np.full(len(rows), np.nan)
    where = np.flatnonzero(kept)
    alone = outliers(rows.day[where], value[where], std[where], temperature[where])
    _note(left_out, "stand out alone", alone)
    outlying = tuple(float(day) for day in rows.day[where[alone]])
    return _joined(rows, name, unit, value, std, temperature, where[~alone], left_out, outlying)


def _note(left_out: dict[str, int], reason: str, which: Mask) -> None:
    if which.any():
        left_out[reason] = int(which.sum())


def _size(values: Array) -> float:
    return float(np.median(np.abs(values))) if len(values) else 0.0


def outliers(day: Array, value: Array, std: Array, temperature: Array) -> Mask:
    """(n,) which values are far from their neighbours in time, whatever these are; steps and slow drifts are no outliers.

    A temperature (NaN: none) is taken into account by a slope that neither outliers nor a step bend much.
    """
    count = len(day)
    if count < 2 * FEWEST_NEIGHBOURS:
        return np.zeros(count, dtype=bool)
    level = value.copy()
    if np.isfinite(temperature).all() and np.ptp(temperature) > 0.0:
        few = np.unique(np.linspace(0, count - 1, min(count, THEIL_POINTS)).astype(int))
        level = value - theilslopes(value[few], temperature[few])[0] * temperature
    distance = np.empty(count)
    for k in range(count):
        start = max(0, k - NEIGHBOURS)
        before, after = level[start:k], level[k + 1 : k + 1 + NEIGHBOURS]
        nearest = [
            np.median(side)
            for side in (before, after, np.concatenate([before, after]))
            if len(side) >= FEWEST_NEIGHBOURS
        ]
        distance[k] = min(np.abs(level[k] - np.array(nearest)))
    scale = MAD * np.median(distance)
    return _alone(distance > OUTLYING * np.hypot(max(scale, 1e-12 * _size(value)), std))


def _alone(far: Mask) -> Mask:
    """Without the runs of SEVERAL or more: those may be a change that is only just beginning."""
    kept = far.copy()
    for start, stop in runs(far):
        if stop - start >= SEVERAL:
            kept[start:stop] = False
    return kept


def _joined(
    rows: AxisRows,
    name: str,
    unit: str,
    value: Array,
    std: Array,
    temperature: Array,
    where: np.ndarray,
    left_out: Mapping[str, int],
    outlying: tuple[float, ...],
) -> Series:
    """The recordings `where`, those of one night as their mean weighted by 1/std^2."""
    edges = _edges(rows.day[where])
    # a deviation far below the usual one is luck, and would make one recording speak for its whole night
    weight = 1.0 / np.maximum(std[where], 0.3 * _size(std[where])) ** 2
    total = np.add.reduceat(weight, edges) if len(edges) else np.zeros(0)

    def mean(column: Array) -> Array:
        return np.add.reduceat(weight * column[where], edges) / total if len(edges) else np.zeros(0)

    columns = {key: mean(rows.columns[key]) for key in (*SURROUNDINGS, *PROGRAMME)}
    count = np.diff([*edges, len(where)]).astype(np.float64)
    version = tuple(rows.version[where[k]] for k in edges)
    spread = (
        np.sqrt(np.add.reduceat((weight * std[where]) ** 2, edges)) / total if len(edges) else np.zeros(0)
    )
    return Series(
        name,
        unit,
        mean(rows.day),
        mean(value),
        spread,
        mean(temperature),
        columns,
        count,
        version,
        left_out,
        outlying,
    )


def _edges(day: Array) -> np.ndarray:
    """Where each night begins: recordings that are no farther from its first one than a night are one."""
    if not len(day):
        return np.zeros(0, dtype=int)
    width = min(NIGHT, (day[-1] - day[0]) / FINEST)
    edges = [0]
    for k in range(1, len(day)):
        if day[k] - day[edges[-1]] > width:
            edges.append(k)
    return np.array(edges)
