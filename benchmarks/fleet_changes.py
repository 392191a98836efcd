"""What the trends make of the changes that were planted in the bags of a fleet (benchmarks/fleet_bags.py)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.fleet_bags import BEGIN, YEAR, Change, Truth
from tcs_friction.trends.fleet import AxisTrend, fleet_trend
from tcs_friction.trends.read import read_axes

FIRST_DAY = BEGIN.timestamp() / 86400.0
WITHIN = 3.0  # standard deviations, that a size may be off


def score(out: Path, truth: Truth) -> list[dict[str, Any]]:
    """Rows of a result: planted changes found, their sizes and dates, events where nothing was planted."""
    trends = {trend.name: trend for trend in fleet_trend(read_axes(str(out))).axes}
    planted = [change for change in truth.changes if change.axis in trends]
    found = [change for change in planted if _shown(trends[change.axis], change) is not None]
    sized = [change for change in found if _right(trends[change.axis], change)]
    unchanged = [name for name in trends if all(change.axis != name for change in truth.changes)]
    false = sum(len(trends[name].events) for name in unchanged)
    return [
        _row("planted changes found", len(found), len(planted), _names(planted, found)),
        _row("of them, size or date within its error", len(sized), len(found), _names(found, sized)),
        {"name": f"events of the {len(unchanged)} axes that did not change", "value": false, "unit": ""},
    ]


def _names(every: Sequence[Change], some: Sequence[Change]) -> str:
    """What of all is not among some, in words."""
    missing = [f"{one.axis} {one.effect or one.parameter}" for one in every if one not in some]
    return f" (not: {', '.join(missing)})" if missing else ""


def _row(name: str, value: int, of: int, remark: str) -> dict[str, Any]:
    return {"name": name + remark, "value": value, "unit": "", "beside": of, "ratio": value / of if of else None}


def _shown(trend: AxisTrend, change: Change) -> Any:
    """The change, or the effect that appears, that a trend shows for a planted one; None where it shows none."""
    for event in trend.events:
        for one in event.presences:
            if change.effect and one.appears and change.effect in (one.effect, *one.equivalent):
                return one
        for other in event.changes:
            if not change.effect and (other.parameter, other.kind) == (change.parameter, change.kind):
                return other
    return None


def _right(trend: AxisTrend, change: Change) -> bool:
    """Whether a drift's size is right within its error, and the date of what happens at once."""
    one = _shown(trend, change)
    if change.kind == "drift":
        day = trend.trends[change.parameter].series.day
        grown = (change.after - change.before) * float(day[-1] - day[0]) / YEAR
        return bool(abs(one.size - grown) < WITHIN * one.std)
    return bool(one.earliest <= FIRST_DAY + change.day <= one.latest)
