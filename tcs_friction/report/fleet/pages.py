"""The page of a fleet (which axes need a person, in order) and the page of each axis (every parameter over time)."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from tcs_friction.report.fleet.figures import largest_shift, over_temperature, over_time
from tcs_friction.report.html import (
    Html,
    Number,
    key_numbers,
    note,
    page,
    picture,
    section,
    table,
    text,
    write_page,
)
from tcs_friction.report.numbers import with_error
from tcs_friction.trends.events import Event
from tcs_friction.trends.fleet import AxisTrend, FleetTrend
from tcs_friction.trends.words import date, spoken

INDEX = "index.html"
_PAIR = "display:grid;grid-template-columns:repeat(auto-fit,minmax(min(22rem,100%),1fr));gap:0 1rem"


def page_name(axis: str) -> str:
    """The file of an axis' page; other axes have other files, whatever characters their names have."""
    return f"axis_{quote(axis, safe='')}.html"


def write_fleet(directory: Path, fleet: FleetTrend) -> Path:
    """Write the page of each axis, then that of the fleet, which links to them; returns the latter's path."""
    for axis in fleet.axes:
        write_page(directory / page_name(axis.name), axis_page(axis, fleet))
    return write_page(directory / INDEX, fleet_page(fleet))


def fleet_page(fleet: FleetTrend) -> str:
    """The whole fleet on one page."""
    parts: list[Html] = [key_numbers(_fleet_numbers(fleet))]
    if fleet.needing:
        parts.append(
            section(
                "To look at, the most urgent first",
                *(_card(k, axis) for k, axis in enumerate(fleet.needing, 1)),
            )
        )
    quiet = [axis for axis in fleet.axes if not axis.reasons]
    if quiet:
        parts.append(section("Nothing to do", _quiet(quiet)))
    compared = _levels(fleet)
    if compared:
        parts.append(
            section(f"The axes beside each other, now and at {fleet.reference_temperature:g} °C", *compared)
        )
    parts.append(note(_how(fleet)))
    return page("Fleet", fleet_sentence(fleet), *parts)


def fleet_sentence(fleet: FleetTrend) -> str:
    """How many axes need a person, and which is first."""
    count, needing = len(fleet.axes), fleet.needing
    if not needing:
        return f"None of {count} axes needs a person." if count != 1 else "The axis needs nobody."
    some = f"{len(needing)} of {count} axes {'needs' if len(needing) == 1 else 'need'} a person"
    return f"{some}: {', '.join(axis.name for axis in needing)}."


def axis_page(axis: AxisTrend, fleet: FleetTrend) -> str:
    """One axis: its events, then every parameter over time and against temperature."""
    rows = axis.rows
    parts: list[Html] = [key_numbers(_axis_numbers(axis))]
    if axis.events:
        parts.append(section("What happened", *(_event(event, rows.law) for event in axis.events)))
    ordered = sorted(axis.trends.values(), key=largest_shift, reverse=True)
    for trend in ordered:
        drawn = [over_time(trend, rows.law, fleet.reference_temperature), over_temperature(trend, rows.law)]
        pictures = "".join(picture(one) for one in drawn if one is not None)
        words = spoken(trend.series.name, rows.law)
        remarks = [f"{count} of the recordings {reason}" for reason, count in trend.series.left_out.items()]
        if not trend.searched:
            remarks.append("too few recordings to look for changes")
        small = note("; ".join(remarks) + ".") if remarks else Html("")
        parts.append(
            section(words[:1].upper() + words[1:], Html(f'<div style="{_PAIR}">{pictures}</div>'), small)
        )
    if axis.trends:
        parts.append(section("In numbers", _parameters(axis)))
    if any(np.isfinite(one.lower) for one in axis.standings):
        parts.append(section("Against the other axes", _standings(axis)))
    parts += [note(line) for line in rows.left_out]
    parts.append(Html(f'<p><a href="{INDEX}">The whole fleet</a></p>'))
    sentence = axis.reasons[0] if axis.reasons else "Nothing changed that needs a person."
    return page(f"Axis {axis.name}", sentence[:1].upper() + sentence[1:], *parts)


def _fleet_numbers(fleet: FleetTrend) -> list[Number]:
    recordings = sum(len(axis.rows) for axis in fleet.axes)
    failed = sum(int((~axis.rows.done).sum()) for axis in fleet.axes)
    days = [float(day) for axis in fleet.axes for day in axis.rows.day]
    span = f"{date(min(days))} to {date(max(days))}" if days else ""
    return [
        Number(
            "axes that need a person", str(len(fleet.needing)), f"of {len(fleet.axes)}", not fleet.needing
        ),
        Number("recordings", f"{recordings:,}", span),
        Number("not identified", f"{failed:,}", "recordings"),
    ]


def _axis_numbers(axis: AxisTrend) -> list[Number]:
    rows = axis.rows
    span = f"{date(rows.day[0])} to {date(rows.day[-1])}" if len(rows) else ""
    temperature = rows.columns["temperature"][np.isfinite(rows.columns["temperature"])]
    warm = f"{temperature.min():.0f} to {temperature.max():.0f} °C" if len(temperature) else "not recorded"
    return [
        Number("recordings", f"{len(rows):,}", span),
        Number("not identified", str(int((~rows.done).sum()))),
        Number("temperature", warm),
        Number("events", str(len(axis.events)), _calling(sum(event.needs_person for event in axis.events))),
    ]


def _calling(count: int) -> str:
    return f"{count} {'needs' if count == 1 else 'need'} a person"


def _card(place: int, axis: AxisTrend) -> Html:
    link = f'<a href="{quote(page_name(axis.name))}">{html.escape(axis.name)}</a>'
    reasons = "".join(f"<p>{text(_broken(reason))}</p>" for reason in axis.reasons)
    return Html(f'<div class="number" style="margin:.7rem 0"><b>{place}. {link}</b>{reasons}</div>')


def _broken(words: str) -> str:
    """A statement begins as a sentence does."""
    return words[:1].upper() + words[1:] + "."


def _quiet(axes: Sequence[AxisTrend]) -> Html:
    items = []
    for axis in axes:
        small = [event.statement for event in axis.events]
        words = html.escape(f": {'; '.join(small)}") if small else ""
        items.append(f'<li><a href="{quote(page_name(axis.name))}">{html.escape(axis.name)}</a>{words}</li>')
    return Html(f"<ul>{''.join(items)}</ul>")


def _event(event: Event, law: str) -> Html:
    lines = "".join(f"<li>Ruled out: {text(line)}</li>" for line in event.ruled_out)
    lines += "".join(f"<li>Not ruled out: {text(line)}</li>" for line in event.open)
    head = _broken(event.statement)
    rows = [
        [spoken(change.parameter, law), with_error(change.size, change.std), change.unit, f"{change.level:.4g}", date(change.day),
         _chance(change.p_value)]
        for change in event.changes
    ]  # fmt: skip
    rows += [
        [one.effect.replace("_", " "), f"{100 * one.before:.0f} to {100 * one.after:.0f}", "% of recordings", "", date(one.day),
         _chance(one.p_value)]
        for one in event.presences
    ]  # fmt: skip
    numbers = table(["what", "change", "unit", "before", "date", "by chance"], rows)
    calls = (
        ""
        if event.needs_person
        else '<p class="note">Too small to call anybody, or of the recordings themselves.</p>'
    )
    return Html(f"<p><b>{text(head)}</b></p>{calls}<ul>{lines}</ul>{numbers}")


def _chance(p_value: float) -> str:
    return "< 1e-9" if p_value < 1e-9 else re.sub(r"e-0?", "e-", f"{p_value:.1e}")


def _parameters(axis: AxisTrend) -> Html:
    rows = []
    for name, trend in axis.trends.items():
        level = trend.fit.value("level")[0]
        slope = "–"
        if "temperature" in trend.fit.design.names:
            slope = with_error(*trend.fit.value("temperature"))
        rows.append(
            [spoken(name, axis.rows.law), with_error(*trend.now), trend.series.unit, slope, f"{trend.noise.scatter:.2g}",
             f"{100.0 * trend.noise.scatter / abs(level):.2g}" if level else "–", str(int(trend.series.count.sum()))]
        )  # fmt: skip
    head = ["parameter", "now", "unit", "per °C", "scatter", "scatter (%)", "recordings"]
    return table(
        head,
        rows,
        "Now: at the end of the recordings, at the reference temperature. Scatter: between recordings.",
    )


def _standings(axis: AxisTrend) -> Html:
    rows = [
        [
            spoken(one.parameter, axis.rows.law),
            with_error(one.value, one.std),
            f"{one.lower:.4g} to {one.upper:.4g}",
            one.unit,
        ]
        for one in axis.standings
        if np.isfinite(one.lower)
    ]
    return table(
        ["parameter", "this axis", "expected (95 %)", "unit"],
        rows,
        "Where the other axes let one more be expected",
    )


def _levels(fleet: FleetTrend) -> list[Html]:
    """A table for each law: parameters down, axes across."""
    found = []
    for law in sorted({axis.rows.law for axis in fleet.axes}):
        group = sorted((axis for axis in fleet.axes if axis.rows.law == law), key=lambda axis: axis.name)
        names = dict.fromkeys(name for axis in group for name in axis.trends if "." not in name)
        if len(group) < 2 or not names:
            continue
        rows = [
            [
                spoken(name, law),
                *(_level(axis, name) for axis in group),
                _unit(group, name),
                _spread(fleet, name, group),
            ]
            for name in names
        ]
        found.append(
            table(
                ["parameter", *(axis.name for axis in group), "unit", "largest difference"],
                rows,
                f"Law {law}",
            )
        )
    return found


def _level(axis: AxisTrend, name: str) -> str:
    return with_error(*axis.trends[name].now) if name in axis.trends else "–"


def _unit(axes: Sequence[AxisTrend], name: str) -> str:
    return next((axis.trends[name].series.unit for axis in axes if name in axis.trends), "")


def _spread(fleet: FleetTrend, name: str, axes: Sequence[AxisTrend]) -> str:
    """The pair of these axes that differs most, where that is no chance."""
    names = {axis.name for axis in axes}
    pairs = [
        one for one in fleet.differences if one.parameter == name and one.first in names and one.p_value < 1e-3
    ]
    if not pairs:
        return "none"
    most = max(pairs, key=lambda one: abs(one.value))
    size = (
        f"{100.0 * abs(most.relative):.2g} %"
        if abs(most.relative) < 3.0
        else f"{abs(most.value):.3g} {most.unit}"
    )
    return f"{size}, {most.first} and {most.second}"


def _how(fleet: FleetTrend) -> str:
    words = (
        "Each parameter is modelled by a level, temperature, warm-up and season as far as the recordings reach, and a scatter "
        "between recordings; a change is what goes beyond that, with a chance below 1 in 1000 of one false change on an axis."
    )
    return words if fleet.since is None else f"{words} Steps before {date(fleet.since)} call nobody."
