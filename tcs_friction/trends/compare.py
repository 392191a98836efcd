"""Axes beside each other: twins that differ, and an axis against its fleet."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student

from tcs_friction.trends.rows import Array

FEWEST = 3  # other axes for an interval in which the next one is expected
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Standing:
    """A parameter of an axis against the others of its law, all at one temperature.

    value, std: of the axis now. expected, lower, upper: where the others let it be expected (95 %), NaN of fewer than FEWEST.
    spread: standard deviation between the others. p_value: chance of being so far off, or farther, for one more axis like them.
    """

    axis: str
    parameter: str
    unit: str
    value: float
    std: float
    expected: float
    lower: float
    upper: float
    spread: float
    p_value: float


@dataclass(frozen=True)
class Difference:
    """Two axes of one law and what they differ by: second less first, and the chance of that in equal ones."""

    first: str
    second: str
    parameter: str
    unit: str
    value: float
    std: float
    relative: float
    p_value: float


def standings(
    parameter: str, unit: str, levels: Mapping[str, tuple[float, float]], changed: Collection[str] = ()
) -> list[Standing]:
    """Each axis against the others. levels: axis -> value and standard deviation now.

    changed: axes on which the parameter changed. The others are compared without them as long as FEWEST are left: what happened
    to one axis is no spread between axes.
    """
    found = []
    for axis, (value, std) in sorted(levels.items()):
        every = [name for name in sorted(levels) if name != axis]
        steady = [name for name in every if name not in changed]
        taken = steady if len(steady) >= FEWEST else every
        others = np.array([levels[name] for name in taken]).reshape(-1, 2)
        if len(others) < FEWEST:
            nan = math.nan
            found.append(Standing(axis, parameter, unit, value, std, nan, nan, nan, nan, nan))
            continue
        mean, error, spread = pooled(others[:, 0], others[:, 1])
        width = math.sqrt(spread**2 + error**2 + std**2)
        degrees = len(others) - 1
        reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, degrees)) * width
        chance = 2.0 * float(student.sf(abs(value - mean) / width, degrees)) if width > 0.0 else 1.0
        found.append(
            Standing(axis, parameter, unit, value, std, mean, mean - reach, mean + reach, spread, chance)
        )
    return found


def differences(parameter: str, unit: str, levels: Mapping[str, tuple[float, float]]) -> list[Difference]:
    """Every pair of axes."""
    names = sorted(levels)
    found = []
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            value = levels[second][0] - levels[first][0]
            std = math.hypot(levels[first][1], levels[second][1])
            chance = math.erfc(abs(value) / std / math.sqrt(2.0)) if std > 0.0 else 1.0
            size = abs(levels[first][0])
            found.append(
                Difference(
                    first, second, parameter, unit, value, std, value / size if size else math.inf, chance
                )
            )
    return found


def pooled(value: Array, std: Array) -> tuple[float, float, float]:
    """Mean of axes that differ, its standard deviation, and the standard deviation between axes (Paule and Mandel)."""
    degrees = len(value) - 1

    def mean_with(variance: float) -> tuple[float, Array]:
        weight = 1.0 / (std**2 + variance)
        return float(np.sum(weight * value) / np.sum(weight)), weight

    def excess(variance: float) -> float:
        mean, weight = mean_with(variance)
        return float(np.sum(weight * (value - mean) ** 2)) - degrees

    between = 0.0
    if np.all(std > 0.0) and excess(0.0) > 0.0:
        top = 10.0 * float(np.var(value)) + float(np.max(std)) ** 2
        between = float(brentq(excess, 0.0, top)) if excess(top) < 0.0 else top
    mean, weight = mean_with(between)
    return mean, float(1.0 / math.sqrt(np.sum(weight))), math.sqrt(between)
