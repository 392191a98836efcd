"""Steps and slow drifts of one parameter: found, tested against nothing but normal scatter, and sized.

Candidates are a step at every place and a drift that begins at one of several places and goes on to the end. The best one is kept
when its t-statistic, under correlated errors, is beyond chance for all candidates together (Bonferroni: the chance of a false one
is at most `false_rate`, however alike the candidates are). Then the search goes on beside it, until nothing is found; at the end
each change is placed anew beside the others. A change that normal terms can nearly stand for (a step between a warm and a cold
half of the year) has a large error and is not found: that is how a temperature's course does not become a drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from tcs_friction.trends.normal import (
    YEAR,
    Design,
    Fit,
    Noise,
    first_scatter,
    independent,
    least_squares,
    noise_of,
    normal_design,
)
from tcs_friction.trends.rows import Array
from tcs_friction.trends.series import Series

FEWEST = 10  # values for a search
SIDE = 3  # values on each side of a step
DRIFT_SIDE = 8  # values that a drift goes through
PLACES = 80  # steps that are tried; the best one is then placed exactly
BEGINNINGS = 6  # of drifts
MOST = 6  # changes of one parameter
ROUNDS = 3  # of noise and place in turn
CONFIDENCE = 0.95  # of dates
LATER = 10.0  # gain of the log-likelihood ratio for which a drift begins later than the recordings do
STANDS_FOR = 0.02  # share of a candidate that the normal terms must leave


@dataclass(frozen=True)
class Shape:
    """A step before value `place` of a series, or a drift that begins at it."""

    kind: str
    place: int

    def column(self, day: Array) -> Array:
        """(n,) 0 and 1 of a step; years since it began of a drift."""
        if self.kind == "step":
            return (np.arange(len(day)) >= self.place).astype(np.float64)
        return np.maximum(day - day[self.place], 0.0) / YEAR


@dataclass(frozen=True)
class Change:
    """A change of a parameter. size, std: in its unit, of a drift until the last recording. day, earliest, latest: days since
    1970, of a step when it was, of a drift when it began. p_value: chance of such a candidate where nothing changed.
    """

    parameter: str
    unit: str
    kind: str
    day: float
    earliest: float
    latest: float
    size: float
    std: float
    level: float
    p_value: float
    place: int

    @property
    def relative(self) -> float:
        """Size over the level before."""
        return self.size / abs(self.level) if self.level else math.inf


@dataclass(frozen=True)
class Trend:
    """What became of a parameter. fit: of its normal terms and changes; now: value and standard deviation at the end, at the
    reference temperature. searched: whether there was enough to search for changes.
    """

    series: Series
    fit: Fit
    noise: Noise
    changes: tuple[Change, ...]
    now: tuple[float, float]
    searched: bool


def trend_of(series: Series, reference_temperature: float, false_rate: float) -> Trend | None:
    """The parameter's normal course and its changes; None where no recording says anything."""
    if not len(series):
        return None
    base = normal_design(series, reference_temperature)
    shapes: list[Shape] = []
    chances: list[float] = []
    searched = len(series) >= max(FEWEST, base.columns.shape[1] + 2 * SIDE)
    while searched and len(shapes) < MOST:
        found = _search(series, _with(base, series, shapes), len(shapes))
        if found is None or not found[1] < false_rate:
            break
        shapes, chances = _placed(series, base, [*shapes, found[0]]), [*chances, found[1]]
    design = _with(base, series, shapes)
    noise = noise_of(design, series, len(shapes))
    fit = least_squares(design, series.value, noise)
    changes = tuple(
        _change(series, base, shapes, k, fit, noise, chances[k])
        for k in sorted(range(len(shapes)), key=lambda k: shapes[k].place)
    )
    return Trend(series, fit, noise, changes, _now(fit, base), searched)


def _with(base: Design, series: Series, shapes: list[Shape]) -> Design:
    if not shapes:
        return base
    names = tuple(f"{shape.kind} {shape.place}" for shape in shapes)
    return base.with_columns(names, np.column_stack([shape.column(series.day) for shape in shapes]))


def _search(series: Series, design: Design, already: int) -> tuple[Shape, float] | None:
    """The best further change and the chance of it where there is none. Its place and the noise are found in turn."""
    candidates = shapes_of(len(series), PLACES)
    noise = independent(series, first_scatter(series))
    best: Shape | None = None
    for _ in range(ROUNDS):
        scores = statistics(series, design, candidates, noise)
        before, best = best, candidates[int(np.argmax(scores))] if np.max(scores) > 0.0 else None
        if best is None:
            return None
        noise = noise_of(_with(design, series, [best]), series, already + 1)
        if best == before:
            break
    assert best is not None
    scores = statistics(series, design, candidates, noise)
    best = _earliest_beginning(candidates, scores, candidates[int(np.argmax(scores))])
    degrees = len(series) - design.columns.shape[1] - 1
    chance = 2.0 * float(student.sf(math.sqrt(float(np.max(scores))), max(degrees, 1)))
    return best, min(chance * np.count_nonzero(scores), 1.0)


def _earliest_beginning(candidates: list[Shape], scores: Array, best: Shape) -> Shape:
    """Of drifts that explain nearly the same, the one since the first recording."""
    whole = Shape("drift", 0)
    if best.kind != "drift" or whole not in candidates:
        return best
    return whole if scores[candidates.index(best)] - scores[candidates.index(whole)] < LATER else best


def shapes_of(count: int, places: int) -> list[Shape]:
    """Candidates for a series of `count` values: steps at so many places, or at all if there are no more, and drifts."""
    steps = np.arange(SIDE, count - SIDE + 1)
    if len(steps) > places:
        steps = np.unique(np.linspace(SIDE, count - SIDE, places).astype(int))
    starts = np.unique(np.linspace(0, max(count - DRIFT_SIDE, 0), BEGINNINGS).astype(int))
    drifts = [Shape("drift", int(k)) for k in starts] if count >= DRIFT_SIDE else []
    return [*(Shape("step", int(k)) for k in steps), *drifts]


def statistics(series: Series, design: Design, shapes: list[Shape], noise: Noise) -> Array:
    """(k,) squared t-statistic of each shape beside the design; 0 where the design can nearly stand for it."""
    columns = noise.whiten(np.column_stack([shape.column(series.day) for shape in shapes]))
    base, target = noise.whiten(design.columns), noise.whiten(series.value)
    basis = np.linalg.qr(base / np.linalg.norm(base, axis=0))[0]
    rest = target - basis @ (basis.T @ target)
    left = columns - basis @ (basis.T @ columns)
    size, own = np.linalg.norm(left, axis=0), np.linalg.norm(columns, axis=0)
    told = size**2 > STANDS_FOR * own**2
    gained = np.zeros(len(shapes))
    gained[told] = (left.T @ rest)[told] ** 2 / size[told] ** 2
    degrees = max(len(series) - design.columns.shape[1] - 1, 1)
    remaining = np.maximum(float(rest @ rest) - gained, 1e-12 * max(float(rest @ rest), 1e-300))
    return degrees * gained / remaining


def _placed(series: Series, base: Design, shapes: list[Shape]) -> list[Shape]:
    """Each change where it fits best beside the others, the steps at every place."""
    placed = list(shapes)
    for _ in range(ROUNDS):
        before = list(placed)
        for k, shape in enumerate(placed):
            others = placed[:k] + placed[k + 1 :]
            noise = noise_of(_with(base, series, placed), series, len(placed))
            options = [s for s in shapes_of(len(series), len(series)) if s not in others]
            scores = statistics(series, _with(base, series, others), options, noise)
            best = _earliest_beginning(options, scores, options[int(np.argmax(scores))])
            if np.max(scores) > 0.0 and (
                best.kind == shape.kind or len(placed) == 1 or _clearly(options, scores, best, shape)
            ):
                placed[k] = best
        if placed == before:
            break
    return placed


def _clearly(options: list[Shape], scores: Array, best: Shape, shape: Shape) -> bool:
    """Whether another kind of change explains clearly more than the one that was found."""
    known = scores[options.index(shape)] if shape in options else 0.0
    return bool(scores[options.index(best)] - known > LATER)


def _change(
    series: Series, base: Design, shapes: list[Shape], k: int, fit: Fit, noise: Noise, chance: float
) -> Change:
    shape = shapes[k]
    size, std = fit.value(f"{shape.kind} {shape.place}")
    span = 1.0 if shape.kind == "step" else (series.day[-1] - series.day[shape.place]) / YEAR
    earliest, latest = _dates(series, base, shapes, k, noise)
    day = float(series.day[shape.place])
    if shape.kind == "step":
        day = 0.5 * (day + float(series.day[shape.place - 1]))
    level = _level_before(fit, series, shapes, shape)
    return Change(
        series.name,
        series.unit,
        shape.kind,
        day,
        earliest,
        latest,
        size * span,
        std * span,
        level,
        chance,
        shape.place,
    )


def _dates(series: Series, base: Design, shapes: list[Shape], k: int, noise: Noise) -> tuple[float, float]:
    """Days between which the change was or began: places at which it explains nearly as much. What the likelihood ratio of a
    change's place reaches by chance is Yao's (Ann. Statist. 15, 1987, 1321): P(< x) = (1 - exp(-x/2))^2.
    """
    allowed = -2.0 * math.log(1.0 - math.sqrt(CONFIDENCE))
    others = _with(base, series, shapes[:k] + shapes[k + 1 :])
    count, kind = len(series), shapes[k].kind
    last = count - SIDE + 1 if kind == "step" else max(count - DRIFT_SIDE, 0) + 1
    options = [Shape(kind, place) for place in range(SIDE if kind == "step" else 0, last)]
    scores = statistics(series, others, options, noise)
    degrees = max(count - others.columns.shape[1] - 1, 1)
    ratio = degrees * np.log1p(scores / degrees)
    near = [
        option.place for option, value in zip(options, ratio, strict=True) if value >= ratio.max() - allowed
    ]
    near.append(shapes[k].place)
    first = min(near) - 1 if kind == "step" else min(near)
    return float(series.day[first]), float(series.day[max(near)])


def _level_before(fit: Fit, series: Series, shapes: list[Shape], shape: Shape) -> float:
    """Value at the reference temperature just before a change, with the changes before it."""
    level = fit.value("level")[0]
    at = max(shape.place - 1, 0)
    for other in shapes:
        if other.place < shape.place:
            level += fit.value(f"{other.kind} {other.place}")[0] * float(other.column(series.day)[at])
    return level


def _now(fit: Fit, base: Design) -> tuple[float, float]:
    """Value and standard deviation at the last recording's time, at the reference temperature and without season or warm-up."""
    weights = fit.design.columns[-1].copy()
    weights[1 : base.columns.shape[1]] = 0.0
    variance = float(weights @ fit.covariance @ weights)
    return float(weights @ fit.values), math.sqrt(max(variance, 0.0))
