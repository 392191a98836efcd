"""The result for machines: schema tcs_friction/fleet/1."""

from __future__ import annotations

import math
from typing import Any

from tcs_friction.trends.changes import Change, Trend
from tcs_friction.trends.events import Event
from tcs_friction.trends.fleet import AxisTrend, FleetTrend
from tcs_friction.trends.presence import Presence
from tcs_friction.trends.words import date

SCHEMA = "tcs_friction/fleet/1"


def to_mapping(fleet: FleetTrend) -> dict[str, Any]:
    """Everything that was found, as JSON has it; numbers that are not known are null, dates are of UTC."""
    return {
        "schema": SCHEMA,
        "needs_person": [axis.name for axis in fleet.needing],
        "since": None if fleet.since is None else date(fleet.since),
        "reference_temperature": fleet.reference_temperature,
        "axes": [_axis(axis) for axis in fleet.axes],
        "differences": [
            {
                "axes": [one.first, one.second],
                "parameter": one.parameter,
                "unit": one.unit,
                "value": _number(one.value),
                "std": _number(one.std),
                "relative": _number(one.relative),
                "p_value": _number(one.p_value),
            }
            for one in fleet.differences
        ],
    }


def _axis(axis: AxisTrend) -> dict[str, Any]:
    rows = axis.rows
    return {
        "axis": axis.name,
        "law": rows.law or None,
        "recordings": len(rows),
        "failed": int((~rows.done).sum()),
        "first": date(rows.day[0]) if len(rows) else None,
        "last": date(rows.day[-1]) if len(rows) else None,
        "needs_person": bool(axis.reasons),
        "reasons": list(axis.reasons),
        "events": [_event(event) for event in axis.events],
        "parameters": {name: _trend(trend) for name, trend in axis.trends.items()},
        "against_fleet": [
            {
                "parameter": one.parameter,
                "unit": one.unit,
                **{
                    name: _number(getattr(one, name))
                    for name in ("value", "std", "expected", "lower", "upper", "spread", "p_value")
                },
            }
            for one in axis.standings
        ],
        "notes": list(rows.left_out),
    }


def _event(event: Event) -> dict[str, Any]:
    return {
        "kind": event.kind,
        "date": date(event.day),
        "earliest": date(event.earliest),
        "latest": date(event.latest),
        "statement": event.statement,
        "cause": event.cause,
        "ruled_out": list(event.ruled_out),
        "open": list(event.open),
        "weight": _number(event.weight),
        "needs_person": event.needs_person,
        "changes": [_change(change) for change in event.changes],
        "effects": [_presence(one) for one in event.presences],
    }


def _change(change: Change) -> dict[str, Any]:
    return {
        "parameter": change.parameter,
        "kind": change.kind,
        "date": date(change.day),
        "earliest": date(change.earliest),
        "latest": date(change.latest),
        "size": _number(change.size),
        "std": _number(change.std),
        "unit": change.unit,
        "level_before": _number(change.level),
        "p_value": _number(change.p_value),
    }


def _presence(one: Presence) -> dict[str, Any]:
    parameters = one.example.parameters.items()
    return {
        "effect": one.effect,
        "equivalent": list(one.equivalent),
        "appears": one.appears,
        "date": date(one.day),
        "earliest": date(one.earliest),
        "latest": date(one.latest),
        "share_before": one.before,
        "share_after": one.after,
        "torque_rms": _number(one.torque_rms),
        "p_value": _number(one.p_value),
        "parameters": {
            name: {"value": _number(value), "std": _number(std), "unit": unit}
            for name, (value, std, unit) in parameters
        },
    }


def _trend(trend: Trend) -> dict[str, Any]:
    normal = {}
    for name in trend.fit.design.names[: len(trend.fit.design.names) - len(trend.changes)]:
        value, std = trend.fit.value(name)
        normal[name] = {"value": _number(value), "std": _number(std)}
    return {
        "unit": trend.series.unit,
        "now": {"value": _number(trend.now[0]), "std": _number(trend.now[1])},
        "normal": normal,
        "scatter": _number(trend.noise.scatter),
        "correlation_of_neighbours": _number(trend.noise.alike),
        "recordings": int(trend.series.count.sum()),
        "nights": len(trend.series),
        "searched": trend.searched,
        "left_out": dict(trend.series.left_out),
        "outlying": [date(day) for day in trend.series.outlying],
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
