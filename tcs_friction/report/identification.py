"""The report of an identification: what was found and how surely, measured beside modelled, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tcs_friction.identify.comparison import Comparison
from tcs_friction.identify.conclusions import BELIEVED as BELIEVED_LAW
from tcs_friction.identify.conclusions import IDENTIFIED
from tcs_friction.identify.minimum import NO_MINIMUM
from tcs_friction.identify.result import RISING, Estimate, Identification
from tcs_friction.identify.searches import Searches
from tcs_friction.recording.recording import Recording
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    Picture,
    drawn,
    label,
    legend,
    panels,
)
from tcs_friction.report.friction_speed import Shown, draw_friction_by_speed
from tcs_friction.report.html import (
    Cell,
    Html,
    Number,
    key_numbers,
    note,
    page,
    picture,
    section,
    table,
    write_page,
)
from tcs_friction.report.numbers import with_error
from tcs_friction.report.plot import Curve, Panel, Plot, Rule, Scale, Spacing, main_range
from tcs_friction.report.plot_picture import drawn_plot
from tcs_friction.report.profiles import draw_profiles, profile_table
from tcs_friction.report.searches import draw_searches, search_table


def write_report(
    directory: Path,
    found: Identification,
    recordings: Sequence[Recording] = (),
    comparison: Comparison | None = None,
    searches: Searches | None = None,
) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    time, speed, costs = draw_torque(found), draw_friction(found), draw_costs(found)
    pictures = [time, costs, *([speed] if speed else [])]
    parts: list[Html] = [
        *([picture(speed)] if speed else []),
        key_numbers(_numbers(found)),
        section("Measured and modelled", picture(time)),
        section("Parameters", parameter_table(found), _undetermined_note(found), *_directions(found)),
    ]
    if comparison is not None:
        laws = draw_laws(comparison, found.offset.unit)
        pictures.append(laws)
        parts.append(
            section("Friction laws compared", picture(laws), law_table(comparison, found.offset.unit))
        )
    if searches is not None:
        beside = draw_searches(searches)
        pictures.append(beside)
        parts.append(section("PSO-GA beside PSO", picture(beside), search_table(searches)))
    if found.profiles:
        profiles = draw_profiles(found)
        pictures.append(profiles)
        parts.append(section("Profile likelihood", picture(profiles), profile_table(found.profiles)))
    if len(found.correlation[0]) > 1:
        correlation = draw_correlation(found)
        pictures.append(correlation)
        parts.append(section("Correlation of the estimates", picture(correlation)))
    parts.append(section("The search", picture(costs), note(_search_words(found))))
    lines = [*found.notes, *(line for recording in recordings for line in recording.notes)]
    if lines:
        parts.append(section("Notes", *lines))
    sources = ", ".join(recording.source for recording in recordings)
    document = page(f"Identification: {found.law}", sentence(found), *parts, remark=sources)
    return write_page(directory / "report.html", document, pictures)


def sentence(found: Identification) -> str:
    """What a control engineer would say of the result."""
    every = found.every
    sure = [f"{_words(name)} {e.value:.4g} {e.unit}".rstrip() for name, e in every.items() if e.determined]
    lost = [_words(name) for name, e in every.items() if not e.determined]
    law = _words(found.law).replace("lugre", "LuGre")
    words = f"The {law} law explains {100.0 * _explained(found):.1f} % of the torque"
    words += f": {', '.join(sure)}." if sure else ", but the recording determines none of its parameters."
    if lost and sure:
        words += f" The recording cannot determine {_joined(lost)}."
    if any(line.startswith(RISING) for line in found.notes):
        words += f" {RISING.capitalize()}."
    if not found.minimum:
        words += f" No value has an interval: {NO_MINIMUM}."
    return words


def _words(name: str) -> str:
    return name.replace("_", " ")


def _explained(found: Identification) -> float:
    """Share of the measured torque's power."""
    power = float(np.var(found.fit.measured))
    return 1.0 - float(np.var(found.fit.residual)) / power if power > 0.0 else 0.0


def _joined(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _numbers(found: Identification) -> list[Number]:
    unit = found.offset.unit
    return [
        Number("residual, held out", f"{found.rmse.held_out:.3g} {unit}", "rms, on data that no fit saw"),
        Number("residual, train", f"{found.rmse.train:.3g} {unit}", "rms"),
        Number("noise floor", f"{found.noise_floor:.3g} {unit}", "the recording's own"),
        Number("torque explained", f"{100.0 * _explained(found):.2f} %", "of its power"),
        Number("time", f"{found.seconds:.1f} s", f"{found.evaluations:,} evaluations"),
    ]


def draw_torque(found: Identification) -> Picture:
    """Torque on top, residual below."""
    fit, unit, time = found.fit, found.offset.unit, _joined_time(found)
    scale = Scale("time", "s")
    joints = tuple(Rule(float(time[start]), MUTED, across="x") for start in fit.bounds[1:-1])
    measured = Curve("measured", MEASURED, time, fit.measured, size=1.6)
    modelled = Curve(found.law, IMPROVED, time, fit.modelled, size=0.9)
    left = Curve("residual", BELIEVED, time, fit.residual, size=0.7)
    rows = (
        (Panel(scale, Scale("torque", unit), (measured, modelled), rules=joints),),
        (Panel(scale, Scale("residual", unit, limits=main_range(fit.residual)), (left,), rules=joints),),
    )
    caption = "Torque over time, measured and modelled, and the residual between them at its own scale."
    return drawn_plot(Plot("torque", caption, rows, heights=(2.7, 1.9), linked=True))


def _joined_time(found: Identification) -> np.ndarray:
    """Times of the stretches put one after the other, s."""
    t = found.fit.t.copy()
    for start in found.fit.bounds[1:-1]:
        if t[start] <= t[start - 1]:
            t[start:] += t[start - 1] - t[start]
    return t


def draw_friction(found: Identification) -> Picture | None:
    """Friction against speed and what the fit leaves of it; None of a recording without motion."""
    if found.by_speed is None:
        return None
    shown = {BELIEVED_LAW: Shown("believed", BELIEVED), IDENTIFIED: Shown(found.law, IMPROVED)}
    rotary = found.inertia.unit != "kg" and not found.inertia.unit.endswith("/m")
    return draw_friction_by_speed(found.by_speed, shown, IDENTIFIED, found.offset.unit, rotary)


def draw_costs(found: Identification) -> Picture:
    """Best cost (half sum of squares) per generation."""
    generations = np.arange(1.0, len(found.history) + 1.0)
    falls = bool(len(found.history) and found.history[0] > 10.0 * found.history[-1] > 0.0)
    cost = Scale("best cost", f"({found.offset.unit})²", Spacing.LOG if falls else Spacing.LINEAR)
    panel = Panel(Scale("generation"), cost, (Curve("best cost", IMPROVED, generations, found.history),))
    return drawn_plot(Plot("cost", "Best cost of each generation of the global search.", ((panel,),), heights=(2.4,)))


@drawn("correlation", "Correlation of the estimates: pairs near ±1 cannot be told apart by this data.")
def draw_correlation(found: Identification) -> Figure:
    """A square of correlations with their numbers."""
    names, matrix = found.correlation
    side = 1.2 + 0.62 * len(names)
    figure, (axes,) = panels(height=0.75 * side, width=1.5 * side)
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    words = [name.replace("_", " ") for name in names]
    axes.set_xticks(range(len(names)), words, rotation=30, ha="right")
    axes.set_yticks(range(len(names)), words)
    axes.grid(False)
    for i, row in enumerate(matrix):
        for j, value in enumerate(row):
            axes.text(
                j, i, f"{value:.2f}", ha="center", va="center", color="white" if abs(value) > 0.6 else "black"
            )
    figure.colorbar(image, ax=axes, shrink=0.9)
    return figure


@drawn("laws", "Residual of each friction law on samples that its fit has not seen.")
def draw_laws(comparison: Comparison, unit: str) -> Figure:
    """Bars, best law on top, with a tick at the training residual."""
    rows = comparison.rows[::-1]
    figure, (axes,) = panels(height=0.6 + 0.34 * len(rows))
    places = np.arange(len(rows))
    colors = [MUTED] * (len(rows) - 1) + [IMPROVED]
    axes.barh(places, [row.held_out for row in rows], color=colors, height=0.6, label="held out")
    axes.plot([row.train for row in rows], places, "|", ms=14, mew=2, color=MEASURED, label="train")
    axes.set_yticks(places, [row.law for row in rows])
    axes.grid(False, axis="y")
    label(axes, f"residual ({unit} rms)", "")
    legend(axes)
    return figure


def parameter_table(found: Identification) -> Html:
    """Every parameter with its standard error, the least possible one, and the reason where there is none."""
    rows: list[list[str | Cell]] = []
    for name, estimate in found.every.items():
        if estimate.determined:
            least = found.bound.get(name)
            bound = f"{least:.2g}" if least is not None and np.isfinite(least) else "–"
            rows.append([name, with_error(estimate.value, estimate.std), estimate.unit, bound, ""])
        else:
            rows.append([name, "–", estimate.unit, "–", estimate.reason or "undetermined"])
    head = ["parameter", "value", "unit", "least possible std", "why not"]
    return table(head, rows, "Value ± standard error (robust against coloured residuals)")


def _undetermined_note(found: Identification) -> Html:
    missing = any(not estimate.determined for estimate in found.parameters.values())
    words = (
        "A parameter without a value was held at the axis file's while the others were fitted."
        if missing
        else ""
    )
    return note(words)


def _directions(found: Identification) -> list[Html]:
    if len(found.directions) < 2:
        return []
    positive, negative = found.directions["positive"], found.directions["negative"]
    rows = [
        [name, _value(positive[name]), _value(negative[name]), positive[name].unit]
        for name in positive
        if name in negative
    ]
    return [table(["parameter", "positive", "negative", "unit"], rows, "Each direction of motion by itself")]


def _value(estimate: Estimate) -> str:
    return with_error(estimate.value, estimate.std) if estimate.determined else "–"


def law_table(comparison: Comparison, unit: str) -> Html:
    """Laws, best first."""
    rows = [
        [
            row.law,
            f"{row.held_out:.4g}",
            f"{row.train:.4g}",
            str(row.parameters),
            f"{row.bic:.0f}",
            f"{row.seconds:.1f}",
        ]
        for row in comparison.rows
    ]
    head = ["law", f"held out ({unit})", f"train ({unit})", "parameters", "BIC", "time (s)"]
    return table(head, rows)


def _search_words(found: Identification) -> str:
    return (
        f"Method {found.method}, seed {found.seed}: {found.outcome.value.replace('_', ' ')} after "
        f"{found.evaluations:,} evaluations in {found.seconds:.1f} s; cost {found.cost:.6g}."
    )
