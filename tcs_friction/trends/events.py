"""Changes that belong together as one event, what it was, and what it was not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import mannwhitneyu

from tcs_friction.physics.parameters import Feature
from tcs_friction.trends.changes import Change, Shape, Trend, statistics
from tcs_friction.trends.normal import YEAR, Design, least_squares, noise_of
from tcs_friction.trends.presence import Presence
from tcs_friction.trends.rows import PROGRAMME, AxisRows
from tcs_friction.trends.series import Series
from tcs_friction.trends.words import amount, cause, feature_of, spoken, when

MATTERS = 0.02  # of the friction level; less is listed and calls nobody
MOST_NAMED = 4  # changes in a sentence
SHIFTED = 1e-4  # chance below which the way of recording counts as changed
SUDDEN = 45.0  # days: a season is not so quick
SURE = 4.0  # standard deviations that a change has to have beside the way of recording
STAYS = 0.5  # share of a change that stays when the way of recording is taken into account


@dataclass(frozen=True)
class Event:
    """What happened to an axis at one time. weight: torque that changed over the level of the dry friction (1: as large as it).

    ruled_out: what it was not, with the reason; open: what it may also be, since the recordings do not tell.
    needs_person: whether somebody should look at the axis.
    """

    kind: str
    day: float
    earliest: float
    latest: float
    changes: tuple[Change, ...]
    presences: tuple[Presence, ...]
    statement: str
    cause: str
    ruled_out: tuple[str, ...]
    open: tuple[str, ...]
    weight: float
    needs_person: bool


def events_of(
    rows: AxisRows, trends: Mapping[str, Trend], presences: Sequence[Presence], level: float
) -> list[Event]:
    """The events of an axis, the one with most torque first. level: of its dry friction, N m (N); NaN where unknown."""
    changes = [change for trend in trends.values() for change in trend.changes]
    drifts = [change for change in changes if change.kind == "drift"]
    found = [_event("drift", rows, trends, drifts, [], level)] if drifts else []
    left: list[Change | Presence] = [*presences, *(change for change in changes if change.kind == "step")]
    left.sort(key=lambda one: (one.latest - one.earliest, one.earliest))
    while left:
        together, left = _together(left)
        steps = [one for one in together if isinstance(one, Change)]
        shown = [one for one in together if isinstance(one, Presence)]
        found.append(_event("step", rows, trends, steps, shown, level))
    return sorted(found, key=lambda event: (-event.needs_person, -event.weight, event.day))


def _together(ones: list[Change | Presence]) -> tuple[list[Change | Presence], list[Change | Presence]]:
    """The best dated one with all whose dates agree with it and with each other, and the rest."""
    first, last = ones[0].earliest, ones[0].latest
    together, rest = [ones[0]], []
    for one in ones[1:]:
        if one.earliest <= last and one.latest >= first:
            first, last = max(first, one.earliest), min(last, one.latest)
            together.append(one)
        else:
            rest.append(one)
    return together, rest


def _event(
    kind: str,
    rows: AxisRows,
    trends: Mapping[str, Trend],
    changes: list[Change],
    presences: list[Presence],
    level: float,
) -> Event:
    ordered = sorted(changes, key=lambda one: -abs(one.size) / one.std)
    ordered.sort(
        key=lambda one: (feature_of(rows.law, one.parameter) is not Feature.DRY, -_weight(one, rows, level))
    )
    dated: list[Change | Presence] = [*ordered, *presences]
    earliest, latest = max(one.earliest for one in dated), min(one.latest for one in dated)
    if kind == "drift" or earliest > latest:
        earliest, latest = min(one.earliest for one in dated), max(one.latest for one in dated)
    ruled_out, left_open = _other_reasons(kind, rows, trends, ordered, earliest, latest)
    if presences and any("." not in one.parameter for one in ordered):
        left_open += (
            "the law's parameters: identified without the effect, they may have changed by its share only",
        )
    what = cause(rows.law, ordered, presences)
    weight = max(
        [*(_weight(one, rows, level) for one in ordered), *(one.torque_rms / level for one in presences), 0.0]
    )
    weight = weight if np.isfinite(weight) else 1.0
    made = any("way of recording" in reason or "software" in reason for reason in left_open)
    day = 0.5 * (earliest + latest) if kind == "step" else min(one.day for one in dated)
    return Event(
        kind, day, earliest, latest, tuple(ordered), tuple(presences),
        _statement(kind, rows, ordered, presences, (day, earliest, latest), what, made), what, ruled_out, left_open, weight,
        weight >= MATTERS and not made,
    )  # fmt: skip


def _weight(change: Change, rows: AxisRows, level: float) -> float:
    """Torque that a change makes on usual motion, over the level; of parameters that are no torque, the relative change."""
    speed = float(np.nanmedian(rows.columns["speed_rms"])) if len(rows) else np.nan
    if change.unit in ("N m", "N") and level > 0.0:
        return abs(change.size) / level
    if (
        change.unit in ("N m s/rad", "N s/m")
        and level > 0.0
        and "." not in change.parameter
        and np.isfinite(speed)
    ):
        return min(abs(change.size) * speed / level, abs(change.relative))
    return min(abs(change.relative), 1.0) if np.isfinite(change.relative) else 0.0


def _statement(
    kind: str,
    rows: AxisRows,
    changes: Sequence[Change],
    presences: Sequence[Presence],
    dates: tuple[float, float, float],
    what: str,
    made: bool,
) -> str:
    parts = [_presence_words(one) for one in presences]
    named = {one.effect for one in presences}
    own = [one for one in changes if one.parameter.partition(".")[0] not in named]
    parts += [f"{spoken(one.parameter, rows.law)} {amount(one)}" for one in own]
    if len(parts) > MOST_NAMED:
        parts = [*parts[: MOST_NAMED - 1], f"{len(parts) - MOST_NAMED + 1} other parameters"]
    words = f"{_joined(parts)} {'in a slow drift since' if kind == 'drift' else 'since'} {when(*dates)}"
    places = [one.example for one in presences if one.example.coordinate == "position"]
    if (
        not places
        and any(feature_of(rows.law, one.parameter) is not None for one in own)
        and rows.diagnosed.any()
    ):
        words += ", over all positions"
    if any(np.isfinite(rows.columns["temperature"])):
        words += ", not temperature"
    if made:
        return f"{words}: the recordings were made or evaluated in another way since then, which may be all"
    return f"{words}: {what}"


def _presence_words(one: Presence) -> str:
    values = [
        f"{name.replace('_', ' ')} {value:.3g} {unit}".rstrip()
        for name, (value, _, unit) in one.example.parameters.items()
    ]
    other = f" or {' or '.join(name.replace('_', ' ') for name in one.equivalent)}" if one.equivalent else ""
    verb = "appeared" if one.appears else "vanished"
    return f"{one.effect.replace('_', ' ')}{other} {verb} ({', '.join(values[:2])})"


def _joined(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _other_reasons(
    kind: str,
    rows: AxisRows,
    trends: Mapping[str, Trend],
    changes: Sequence[Change],
    earliest: float,
    latest: float,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What is ruled out and what is left open, one line each."""
    ruled, left = [], []
    temperature = rows.columns["temperature"]
    before, after = rows.day <= earliest, rows.day >= latest
    if np.isfinite(temperature).any():
        warmer = _mean(temperature[after]) - _mean(temperature[before]) if kind == "step" else 0.0
        ruled.append(f"temperature: it is in the model ({warmer:+.1f} degC after the change)" if kind == "step"
                     else "temperature: it is in the model")  # fmt: skip
    else:
        left.append("temperature: it was not recorded")
    span = (rows.day[-1] - rows.day[0]) / YEAR
    if kind == "step" and latest - earliest < SUDDEN:
        ruled.append(f"season: it came within {max(latest - earliest, 1.0):.0f} days")
    elif span >= 1.9:
        ruled.append("season: a yearly course is in the model")
    else:
        left.append("season beyond temperature: less than two years were recorded")
    if kind == "step":
        if set(_at(rows.version, before)).isdisjoint(_at(rows.version, after)):
            left.append("software or axis file: another version since the same time")
        for name in PROGRAMME:
            if _shifted(rows.columns[name][before & rows.done], rows.columns[name][after & rows.done]):
                stays = all(
                    _stays(trends[one.parameter], one, name) for one in changes if one.parameter in trends
                )
                words = f"way of recording: {name.replace('_', ' ')} changed at the same time"
                (ruled if stays and changes else left).append(
                    words + (", which does not explain it" if stays and changes else "")
                )
        if not any("way of recording" in line for line in (*ruled, *left)):
            ruled.append("way of recording: range, speeds and length are the same before and after")
    return tuple(ruled), tuple(left)


def _at(words: Sequence[str], which: np.ndarray) -> list[str]:
    return [word for word, taken in zip(words, which, strict=True) if taken]


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _shifted(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether a column has other values after than before: by rank, and by more than a fifth of its size."""
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if min(len(before), len(after)) < 3:
        return False
    difference = abs(float(np.median(after) - np.median(before)))
    size = max(float(np.median(np.abs(before))), float(np.std(before)))
    return bool(difference > 0.2 * size and mannwhitneyu(before, after).pvalue < SHIFTED)


def _stays(trend: Trend, change: Change, name: str) -> bool:
    """Whether a change remains, and can be told at all, when the column is among the terms that are normal."""
    series: Series = trend.series
    column = series.columns[name]
    if not np.isfinite(column).all() or np.std(column) == 0.0:
        return True
    own = f"{change.kind} {change.place}"
    known = trend.fit.design
    beside = [k for k, term in enumerate(known.names) if term != own]
    others = Design(tuple(known.names[k] for k in beside), known.columns[:, beside].copy())
    others = others.with_columns((name,), (column - column.mean())[:, None] / np.std(column))
    shape = Shape(change.kind, change.place)
    design = others.with_columns((own,), shape.column(series.day)[:, None])
    noise = noise_of(design, series, len(trend.changes))
    if statistics(series, others, [shape], noise)[0] < SURE**2:
        return False
    return bool(least_squares(design, series.value, noise).value(own)[0] / change.size > STAYS)
