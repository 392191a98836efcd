"""A whole fleet: each axis' course, the axes beside each other, and which of them need a person."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.physics.parameters import Feature, Role
from tcs_friction.physics.registry import effects as known_effects
from tcs_friction.trends.changes import Trend, trend_of
from tcs_friction.trends.compare import Difference, Standing, differences, standings
from tcs_friction.trends.events import MATTERS, Event, events_of
from tcs_friction.trends.presence import FEWEST, Presence, effects_named, presences
from tcs_friction.trends.rows import Array, AxisRows
from tcs_friction.trends.series import Series, series_of
from tcs_friction.trends.words import date, feature_of, spoken

FALSE_RATE = 1e-3
"""Chance that anything at all is found on an axis on which nothing changed, for all its parameters and effects together."""

LIKELY = 0.05  # chance of an effect that appears or vanishes, where a parameter is known to have changed then
STRANGE = 1e-3  # chance below which an axis differs from its fleet, for all its parameters together
FAILING = 5  # recordings in a row that could not be identified


@dataclass(frozen=True)
class AxisTrend:
    """What became of an axis. reasons: why somebody should look at it, the most important first; none: nobody need.

    weight: of its heaviest event that needs a person. standings: against the other axes.
    """

    rows: AxisRows
    trends: Mapping[str, Trend]
    presences: tuple[Presence, ...]
    events: tuple[Event, ...]
    reasons: tuple[str, ...]
    weight: float
    standings: tuple[Standing, ...] = ()

    @property
    def name(self) -> str:
        return self.rows.axis


@dataclass(frozen=True)
class FleetTrend:
    """All axes, those that need a person first. reference_temperature: degC, at which levels hold; since: day since 1970 from
    which on changes call for a person, None: all do.
    """

    axes: tuple[AxisTrend, ...]
    differences: tuple[Difference, ...]
    reference_temperature: float
    since: float | None = None

    @property
    def needing(self) -> tuple[AxisTrend, ...]:
        """The axes that need a person."""
        return tuple(axis for axis in self.axes if axis.reasons)


def fleet_trend(axes: Iterable[AxisRows], since: float | None = None) -> FleetTrend:
    """What changed in a fleet. `since`: day since 1970; older events are listed and call nobody."""
    rows = list(axes)
    reference = _reference_temperature(rows)
    found = [axis_trend(one, reference, since) for one in rows]
    beside, different = _compared(found)
    ordered = sorted(
        (_with_standings(axis, beside.get(axis.name, [])) for axis in found),
        key=lambda axis: (not axis.reasons, -axis.weight, axis.name),
    )
    return FleetTrend(tuple(ordered), tuple(different), reference, since)


def axis_trend(rows: AxisRows, reference_temperature: float, since: float | None = None) -> AxisTrend:
    """What became of one axis, levels at a reference temperature (degC)."""
    series = all_series(rows)
    tests = max(len(series) + len(effects_named(rows)), 1)
    trends: dict[str, Trend] = {}
    for one in series:
        trend = trend_of(one, reference_temperature, FALSE_RATE / tests)
        if trend is not None:
            trends[one.name] = trend
    shown = _shown(rows, trends, FALSE_RATE / tests)
    events = events_of(rows, trends, shown, dry_level(rows, trends))
    if since is not None:
        events = [
            replace(e, needs_person=e.needs_person and (e.kind == "drift" or e.latest >= since))
            for e in events
        ]
    calling = [event for event in events if event.needs_person]
    reasons = (*(event.statement for event in calling), *_failing(rows))
    return AxisTrend(
        rows, trends, tuple(shown), tuple(events), reasons, max((e.weight for e in calling), default=0.0)
    )


def _shown(rows: AxisRows, trends: Mapping[str, Trend], false_rate: float) -> list[Presence]:
    """Effects that appeared or vanished for certain, and those that likely did just when a parameter stepped: they explain it."""
    steps = [change for trend in trends.values() for change in trend.changes if change.kind == "step"]

    def at_a_step(one: Presence) -> bool:
        return any(step.earliest <= one.latest and step.latest >= one.earliest for step in steps)

    return [one for one in presences(rows, LIKELY) if one.p_value < false_rate or at_a_step(one)]


def all_series(rows: AxisRows) -> list[Series]:
    """The law's parameters, inertia, offset, and the parameters of effects that enough recordings name."""
    still = rows.columns["reversals"] == 0
    found = [
        series_of(rows, name, one.unit, one.value, one.std, still if name != "inertia" else None)
        for name, one in rows.estimates.items()
    ]
    for name in effects_named(rows):
        found += _effect_series(rows, name)
    return [one for one in found if len(one)]


def _effect_series(rows: AxisRows, name: str) -> list[Series]:
    largest = [
        max((item for item in found if item.name == name), key=lambda item: item.torque_rms, default=None)
        for found in rows.effects
    ]
    if sum(item is not None for item in largest) < FEWEST:
        return []
    term = known_effects().get(name)
    phases = {p.name for p in term.parameters if p.role in (Role.PHASE, Role.FIXED)} if term else set()
    units = {
        key: unit
        for item in largest
        if item
        for key, (_, _, unit) in item.parameters.items()
        if key not in phases
    }
    found = []
    for key, unit in units.items():
        nothing = (math.nan, math.nan, unit)
        pairs: Array = np.array(
            [(item.parameters.get(key, nothing) if item else nothing)[:2] for item in largest]
        )
        known = np.isfinite(pairs).all(axis=1) & (pairs[:, 1] > 0.0)
        value, std = np.where(known, pairs.T, np.nan)
        if np.count_nonzero(known) >= FEWEST:
            found.append(series_of(rows, f"{name}.{key}", unit, value, std))
    return found


def dry_level(rows: AxisRows, trends: Mapping[str, Trend]) -> float:
    """Level of the dry friction (N m), NaN where no recording tells it."""
    for name, trend in trends.items():
        if feature_of(rows.law, name) is Feature.DRY:
            return abs(trend.fit.value("level")[0])
    return math.nan


def _failing(rows: AxisRows) -> list[str]:
    if rows.unreadable:
        return [f"its results cannot be read: {rows.unreadable}"]
    last = rows.reasons[-FAILING:]
    if len(last) < FAILING or not all(last):
        return []
    first = len(rows) - next((k for k, ok in enumerate(rows.done[::-1]) if ok), len(rows))
    return [
        f"{len(rows) - first} recordings in a row could not be identified since {date(rows.day[first])}: {last[-1]}"
    ]


def _reference_temperature(rows: Sequence[AxisRows]) -> float:
    every = [one.columns["temperature"] for one in rows]
    known = np.concatenate([values[np.isfinite(values)] for values in every]) if every else np.zeros(0)
    return round(float(np.median(known))) if len(known) else 20.0


def _compared(axes: Sequence[AxisTrend]) -> tuple[dict[str, list[Standing]], list[Difference]]:
    """Standings by axis, and the differences of every pair, among axes of one law."""
    beside: dict[str, list[Standing]] = {}
    different: list[Difference] = []
    for law in sorted({axis.rows.law for axis in axes}):
        group = [axis for axis in axes if axis.rows.law == law]
        names = dict.fromkeys(name for axis in group for name in axis.trends if "." not in name)
        for name in names:
            levels = {axis.name: axis.trends[name].now for axis in group if name in axis.trends}
            levels = {axis: now for axis, now in levels.items() if now[1] > 0.0}
            unit = next(axis.trends[name].series.unit for axis in group if name in axis.trends)
            changed = {axis.name for axis in group if name in axis.trends and axis.trends[name].changes}
            for one in standings(name, unit, levels, changed):
                beside.setdefault(one.axis, []).append(one)
            different += differences(name, unit, levels)
    return beside, different


def _with_standings(axis: AxisTrend, beside: Sequence[Standing]) -> AxisTrend:
    said = {change.parameter for event in axis.events if event.weight >= MATTERS for change in event.changes}
    strange = [
        one for one in beside if one.p_value < STRANGE / max(len(beside), 1) and one.parameter not in said
    ]
    reasons = tuple(
        f"{spoken(one.parameter, axis.rows.law)} is {one.value:.4g} {one.unit}, while the other axes let "
        f"{one.lower:.4g} to {one.upper:.4g} be expected"
        for one in strange
    )
    return replace(axis, standings=tuple(beside), reasons=(*axis.reasons, *reasons))
