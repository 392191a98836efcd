"""The report of a diagnosis: the sentence, where the mismatch lives, before and after, the effect isolated.

`write_report` takes the content of diagnosis.json and the `Evidence`, the arrays behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import RegularGridInterpolator

from tcs_friction.diagnose.outcome.plot_data import CoordinateCurve, Evidence, Isolated, Map
from tcs_friction.numerics.runs import runs
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    RETUNED,
    Picture,
    drawn,
    label,
    legend,
    line,
    panels,
    picture_of,
    thin,
)
from tcs_friction.report.html import (
    Cell,
    Html,
    Number,
    key_numbers,
    page,
    picture,
    section,
    table,
    write_page,
)
from tcs_friction.report.numbers import interval, unbroken, with_error

SIGNIFICANT = 0.01
"""p-value below which the atlas calls a coordinate one where the residual lives."""

DWARFED = 3.0
"""Times all others, from which the believed residual is drawn at a scale of its own."""

WORDS = {
    "match": "the model matches",
    "parameters": "wrong parameters, no missing physics",
    "missing_physics": "physics is missing",
    "unexplained": "something outside the vocabulary remains",
}


def write_report(
    directory: Path,
    diagnosis: Mapping[str, Any],
    evidence: Evidence,
    axis: str = "axis",
    next_experiment: str | None = None,
) -> Path:
    """Write DIR/report.html and its pictures; returns the path. `next_experiment` is shown as it is."""
    where = draw_atlas(evidence)
    series = draw_series(evidence, float(diagnosis["fit"]["noise_floor"]))
    effects = [draw_isolated(item, i, evidence) for i, item in enumerate(evidence.isolated)]
    parts = [
        key_numbers(_numbers(diagnosis, evidence)),
        section("Where the mismatch lives", picture(where), _atlas_table(diagnosis)),
        section("Before and after", picture(series), _fit_table(diagnosis, evidence)),
    ]
    if diagnosis["effects"]:
        parts.append(section("What was left out", _effects_table(diagnosis["effects"], evidence), *map(picture, effects)))
    if diagnosis["described"]:
        parts.append(
            section(
                "What predicts, but is not established",
                "These predict torque. They do not come back with the same size, or are no larger than what remains: "
                "they may be parts of something that is not in the vocabulary.",
                _effects_table(diagnosis["described"], evidence),
                *map(picture, effects if not diagnosis["effects"] else ()),
            )
        )
    if evidence.learned is not None:
        remains = draw_map(evidence.learned, evidence.torque_unit)
        effects.append(remains)
        parts.append(section("What nothing in the vocabulary explains", picture(remains)))
    if evidence.runners_up:
        rows = [[r.effect, f"{r.score:.3g}", r.reason] for r in evidence.runners_up]
        head = ["hypothesis", "gain (chi-squared)", "why it lost"]
        parts.append(section("What else was considered", table(head, rows)))
    parts.append(section("What to record next", next_experiment or "Nothing: this recording is enough."))
    if evidence.notes:
        parts.append(section("Notes", *evidence.notes))
    remark = f"Verdict: {WORDS[diagnosis['verdict']]}."
    document = page(f"Diagnosis of {axis}", diagnosis["statement"], *parts, remark=remark)
    return write_page(directory / "report.html", document, [where, series, *effects])


@drawn(
    "where",
    "Mean residual of the retuned model over each coordinate, with its 95 % band. Orange: it lives there; "
    "the share is that of the residual's power which the coordinate explains.",
)
def draw_atlas(evidence: Evidence) -> Figure:
    """Small multiples, most telling coordinate first, all at one torque scale."""
    curves = sorted(evidence.atlas, key=lambda curve: -_telling(curve.coordinate, curve.share))[:9]
    if not curves:
        figure, (axes,) = panels(height=1.5)
        _empty(axes, "no coordinate to look at")
        return figure
    columns = min(3, len(curves))
    figure, grid = panels(-(-len(curves) // columns), columns, height=2.1, width=9.4, sharey=True)
    for axes, curve in zip(grid, curves, strict=False):
        _draw_curve(axes, curve, evidence.torque_unit)
    for axes in grid[len(curves) :]:
        axes.set_axis_off()
    for axes in grid[::columns]:
        axes.set_ylabel(f"residual ({evidence.torque_unit})")
    return figure


def _telling(coordinate: str, share: float) -> float:
    """What a coordinate says with its share of the power: all that is no noise lives at some frequencies."""
    return 0.5 * share if coordinate == "frequency" else share


def _draw_curve(axes: Axes, curve: CoordinateCurve, torque_unit: str) -> None:
    here = curve.p_value < SIGNIFICANT
    color = BELIEVED if here else MUTED
    axes.axhline(0.0, color=MEASURED, lw=0.7)
    if curve.coordinate == "direction":
        axes.errorbar(curve.x, curve.mean, curve.band, fmt="o", color=color, capsize=4)
        axes.set_xlim(-2, 2)
        axes.set_xticks([-1, 1], ["negative", "positive"])
    else:
        axes.fill_between(curve.x, curve.mean - curve.band, curve.mean + curve.band, color=color, alpha=0.25, lw=0)
        axes.plot(curve.x, curve.mean, color=color)
    name = _plain(curve.coordinate)
    height = f"; height in {torque_unit}/√Hz" if name == "frequency" else ""
    axes.set_xlabel(_labelled(curve.coordinate, curve.unit) + height)
    axes.set_title(f"{name}: {_percent(curve.share)}" if here else f"{name}: chance", color=color)


def _percent(share: float) -> str:
    return "under 1 %" if share < 0.01 else f"{100.0 * share:.0f} %"


def _empty(axes: Axes, words: str) -> None:
    axes.set_axis_off()
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes)


@drawn(
    "before_after",
    "Torque residual over time: the model as believed, retuned, and with the physics found. "
    "Grey background: held out, never seen by a fit or a choice. Dashed: twice the noise floor.",
)
def draw_series(evidence: Evidence, noise_floor: float) -> Figure:
    """Three panels at one scale, so that the eye compares; a belief so wrong that no other would be seen has its own."""
    figure, grid = panels(3, height=1.5, width=9.0, sharex=True)
    models = (
        ("believed", evidence.believed, BELIEVED),
        ("retuned", evidence.retuned, RETUNED),
        ("improved", evidence.improved, IMPROVED),
    )
    believed, *others = (1.3 * float(np.percentile(np.abs(values), 99.8)) for _, values, _ in models)
    own = believed > DWARFED * max(others)
    scale = max(others) if own else max(believed, *others)
    for axes, (name, values, color) in zip(grid, models, strict=True):
        _shade(axes, evidence)
        line(axes, evidence.t, values, color, lw=0.8)
        for sign in (-2.0, 2.0):
            axes.axhline(sign * noise_floor, color=MEASURED, lw=0.8, ls="--")
        apart = own and axes is grid[0]
        rms = float(np.sqrt(np.mean(np.square(values))))
        title = f"{name}: {rms:.3g} {evidence.torque_unit} rms"
        axes.set_title(f"{title}, at a scale of its own" if apart else title, color=color)
        axes.set_ylim(*((believed if apart else scale) * np.array([-1.0, 1.0])))
    grid[1].set_ylabel(f"residual ({evidence.torque_unit})")
    grid[-1].set_xlabel("time (s)")
    return figure


def _shade(axes: Axes, evidence: Evidence) -> None:
    for start, stop in runs(np.asarray(evidence.held_out, dtype=bool)):
        axes.axvspan(evidence.t[start], evidence.t[stop - 1], color="#eceff2", lw=0)


def draw_isolated(item: Isolated, index: int, evidence: Evidence) -> Picture:
    """What is left over the effect's own coordinate when the rest is taken away, and the fit."""

    def draw() -> Figure:
        figure, (axes,) = panels(height=3.0)
        few = thin(len(item.x), 6000)
        axes.plot(
            item.x[few], item.residual[few], ".", ms=2, color=MUTED, label="left when the rest is taken away"
        )
        order = np.argsort(item.x, kind="stable")
        line(axes, item.x[order], item.fitted[order], IMPROVED, f"{item.title}, fitted", lw=1.8)
        spread = 1.4 * np.percentile(np.abs(item.residual), 99.5)
        axes.set_ylim(-spread, spread)
        label(axes, _labelled(item.coordinate, item.unit), f"torque ({evidence.torque_unit})")
        legend(axes)
        return figure

    return picture_of(f"effect_{index + 1}_{item.effect}", f"{item.title}, by itself.", draw)


@drawn(
    "learned_map",
    "Opposing torque that the data ask for and no physics here explains: a table, with which the simulation predicts better; "
    "empty where nothing was recorded. Look for what changes with these coordinates.",
)
def draw_map(learned: Map, torque_unit: str) -> Figure:
    """A curve over one coordinate, colours over two."""
    figure, (axes,) = panels(height=3.2)
    names = list(map(_labelled, learned.coordinates, learned.units))
    ranges = list(zip(learned.lower, learned.upper, strict=True))
    nodes = [np.linspace(*ends, count) for ends, count in zip(ranges, learned.values.shape, strict=True)]
    cells = [np.linspace(*ends, count + 1) for ends, count in zip(ranges, learned.visited.shape, strict=True)]
    middles = np.stack(np.meshgrid(*(0.5 * (x[1:] + x[:-1]) for x in cells), indexing="ij"), axis=-1)
    values = np.where(learned.visited, RegularGridInterpolator(nodes, learned.values)(middles), np.nan)
    if len(nodes) == 1:
        line(axes, middles[:, 0], values, IMPROVED, lw=1.8)
        axes.axhline(0.0, color=MEASURED, lw=0.7)
        label(axes, names[0], f"opposing torque ({torque_unit})")
        return figure
    most = float(np.nanmax(np.abs(values)))
    colours = axes.pcolormesh(*cells, values.T, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True)
    across, along = (np.flatnonzero(learned.visited.any(axis=other)) for other in (1, 0))
    axes.set(xlim=cells[0][[across[0], across[-1] + 1]], ylim=cells[1][[along[0], along[-1] + 1]])
    label(axes, *names)
    figure.colorbar(colours, label=f"opposing torque ({torque_unit})")
    return figure


def _plain(coordinate: str) -> str:
    """A coordinate's name in words."""
    return coordinate.removeprefix("exogenous:").replace("_", " ")


def _labelled(coordinate: str, unit: str) -> str:
    """A coordinate's name in words, with its unit if it has one."""
    return f"{_plain(coordinate)} ({unit})" if unit else _plain(coordinate)


def _numbers(diagnosis: Mapping[str, Any], evidence: Evidence) -> list[Number]:
    fit, unit = diagnosis["fit"], evidence.torque_unit
    names = dict.fromkeys(e["effect"].replace("_", " ") for e in diagnosis["effects"])
    found = ", ".join(names) or ("something without a name" if diagnosis["verdict"] == "unexplained" else "nothing")
    improved, floor = fit["improved"]["held_out"], fit["noise_floor"]
    over = f"{improved / floor:.2f} times the noise floor" if floor else "noise floor unknown"
    return [
        Number("physics left out", found),
        Number("held-out residual, as believed", f"{fit['believed']['held_out']:.3g} {unit}"),
        Number("same physics, best parameters", f"{fit['retuned']['held_out']:.3g} {unit}"),
        Number(
            "with the physics found",
            f"{improved:.3g} {unit}",
            over,
            bool(floor and improved <= 1.1 * floor) or None,
        ),
    ]


def _atlas_table(diagnosis: Mapping[str, Any]) -> Html:
    rows: list[list[str | Cell]] = []
    for entry in sorted(diagnosis["atlas"], key=lambda e: -_telling(e["coordinate"], e["share"])):
        here = entry["p_value"] < SIGNIFICANT
        p_value = "< 0.001" if entry["p_value"] < 0.001 else f"{entry['p_value']:.3f}"
        rows.append([_plain(entry["coordinate"]), _percent(entry["share"]), p_value, _where(entry) if here else ""])
    return table(["coordinate", "share of residual power", "p-value", "where"], rows)


def _where(entry: Mapping[str, Any]) -> str:
    """The range or the period of an entry of the atlas."""
    unit, period, limits = entry["unit"], entry["period"], entry["range"]
    if period and entry["coordinate"] == "frequency":
        return f"{1.0 / period:.4g} {unit}"
    if period:
        return f"every {period:.4g} {unit}"
    return interval(limits[0], limits[1], unit) if limits else "everywhere"


def _fit_table(diagnosis: Mapping[str, Any], evidence: Evidence) -> Html:
    models = (
        ("believed", "as given"),
        ("retuned", "same physics, best parameters"),
        ("improved", "with the physics found"),
    )
    free = diagnosis.get("free_run") or {}
    position = free.get("position_rms") or {}
    rows = [
        [
            f"{name}: {words}",
            *(_digits(diagnosis["fit"][name][part]) for part in ("train", "held_out")),
            _digits(position.get(name)),
        ]
        for name, words in models
    ]
    unit = unbroken(evidence.torque_unit)
    horizon = free.get("horizon")
    after = f", rms over {horizon:g} s" if horizon else ""
    head = [
        "model",
        f"residual, train ({unit})",
        f"residual, held out ({unit})",
        f"free-run error{after} ({evidence.position_unit})",
    ]
    return table(head, rows, f"Noise floor {_digits(diagnosis['fit']['noise_floor'])} {unit}")


def _digits(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _effects_table(found: Sequence[Mapping[str, Any]], evidence: Evidence) -> Html:
    rows: list[Sequence[str | Cell]] = []
    for entry in found:
        values = "; ".join(
            unbroken(f"{name} {with_error(p['value'], p.get('std'))} {p.get('unit') or ''}".rstrip())
            for name, p in entry["parameters"].items()
        )
        rows.append(
            [
                entry["effect"],
                values,
                entry["subsystem"],
                f"{entry['torque_rms']:.3g}",
                f"{100.0 * entry['probability']:.0f} %",
                ", ".join(entry["equivalent"]) or "nothing else",
            ]
        )
    head = [
        "effect",
        "parameters",
        "look at",
        unbroken(f"rms, {evidence.torque_unit}"),
        "probability",
        "cannot be told from",
    ]
    return table(head, rows)
