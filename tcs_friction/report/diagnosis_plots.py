"""The pictures of a diagnosis: its message, where the mismatch lives, before and after, friction, each effect by itself."""

from __future__ import annotations

from collections.abc import Mapping
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
    line,
    panels,
    picture_of,
    thin,
)
from tcs_friction.report.friction_speed import Shown, draw_friction_by_speed
from tcs_friction.report.plot import Curve, Panel, Plot, Rule, Scale, main_range
from tcs_friction.report.plot_picture import drawn_plot

SIGNIFICANT = 0.01
"""p-value below which the atlas calls a coordinate one where the residual lives."""

DWARFED = 3.0
"""Times all others, from which the believed residual is drawn at a scale of its own."""

FAR_APART = 30.0
"""Ratio of residuals, from which their bars are drawn by decades."""

MOST_CURVES = 9
MOST_IN_MESSAGE = 2  # effects
SHOWN = 1500  # samples of an effect by itself: a page with many effects stays small
COLORS = {"believed": BELIEVED, "retuned": RETUNED, "improved": IMPROVED}
WORDS = {"believed": "as believed", "retuned": "same physics, retuned", "improved": "with the physics found"}


def stated(errors: Mapping[str, Any]) -> float:
    """What a reader is told that a model leaves: of untouched data, or of held-out ones where there are none."""
    return float(errors["held_out"] if errors["untouched"] is None else errors["untouched"])


def ranked(evidence: Evidence) -> list[CoordinateCurve]:
    """Curves of the atlas, most telling coordinate first."""
    return sorted(evidence.atlas, key=lambda curve: -telling(curve.coordinate, curve.share))[:MOST_CURVES]


@drawn("message", "Left: what each model leaves of the torque in data that nothing looked at, and the noise floor, which no "
       "model gets below. Right: where the mismatch lives; measured torque less all else (grey), fitted (blue).")  # fmt: skip
def draw_message(diagnosis: Mapping[str, Any], evidence: Evidence) -> Figure:
    """What is left of untouched data as bars; the largest named effects by themselves, or the most telling curve of the atlas."""
    named = [one for one in evidence.isolated if one.named]
    largest = sorted(named, key=lambda one: -float(np.mean(np.square(one.fitted))))[:MOST_IN_MESSAGE]
    curves = [] if largest else ranked(evidence)[:1]
    beside = len(largest) + len(curves)
    ratios = [1.0, *[1.2 if beside == 1 else 0.85] * beside]
    figure, grid = panels(1, 1 + beside, height=2.8, width=9.4, gridspec_kw={"width_ratios": ratios})
    _draw_sizes(grid[0], diagnosis["fit"], evidence.torque_unit)
    for axes, item in zip(grid[1:], largest, strict=False):
        _draw_effect(axes, item, evidence.torque_unit)
    for axes, curve in zip(grid[1:], curves, strict=False):
        _draw_curve(axes, curve, evidence.torque_unit)
    return figure


def _draw_effect(axes: Axes, item: Isolated, torque_unit: str) -> None:
    order, few = np.argsort(item.x, kind="stable"), thin(len(item.x), SHOWN)
    axes.plot(item.x[few], item.residual[few], ".", ms=2, color=MUTED)
    line(axes, item.x[order], item.fitted[order], IMPROVED, lw=2.0)
    axes.set_ylim(*main_range(item.residual, 0.99, 1.4))
    axes.set_title(item.title, color=IMPROVED, fontsize=9.0)
    label(axes, labelled(item.coordinate, item.unit), f"torque ({torque_unit})")


def _draw_sizes(axes: Axes, fit: Mapping[str, Any], unit: str) -> None:
    sizes, floor = np.array([stated(fit[name]) for name in WORDS]), float(fit["noise_floor"] or 0.0)
    least = min(floor or sizes.min(), sizes.min())
    places = np.arange(len(sizes))[::-1]
    axes.barh(places, sizes, 0.62, color=[COLORS[name] for name in WORDS])
    if least > 0.0 and sizes.max() > FAR_APART * least:
        axes.set_xscale("log")
        axes.set_xlim(0.4 * least, 30.0 * sizes.max())
    else:
        axes.set_xlim(0.0, 1.6 * max(sizes.max(), floor) or 1.0)
    for place, size, name in zip(places, sizes, WORDS, strict=True):
        met = fit[name].get("fit_percent")
        told = f"{size:.3g}" if met is None else f"{size:.3g}, fit {met:.0f} %"
        axes.annotate(told, (size, place), xytext=(4, 0), textcoords="offset points", va="center", weight="bold")
    if floor > 0.0:
        axes.axvline(floor, color=MEASURED, ls="--", lw=1.0)
        axes.annotate(f" noise floor {floor:.3g}", (floor, -0.72), fontsize=8.5, color=MEASURED, va="center")
    axes.set_ylim(-1.0, 2.5)
    axes.set_yticks(places, list(WORDS.values()))
    axes.grid(visible=False, axis="y")
    label(axes, f"torque left unexplained ({unit} rms)", "")


def draw_atlas(evidence: Evidence) -> Picture:
    """Small multiples, most telling coordinate first, all at one torque scale but the spectrum, which is another quantity."""
    curves = ranked(evidence)
    caption = (
        "Mean residual of the retuned model over each coordinate, with its 95 % band. Orange: it lives there; "
        "the share is that of the residual's power which the coordinate explains."
    )
    if not curves:
        return picture_of("where", caption, _nothing)
    ends = [(c.mean - c.band, c.mean + c.band) for c in curves if c.coordinate != "frequency"]
    common = 1.08 * max((float(np.nanmax(np.abs(end))) for pair in ends for end in pair), default=1.0) or 1.0
    shown = [_atlas_panel(curve, evidence.torque_unit, (-common, common)) for curve in curves]
    columns = min(3, len(shown))
    rows = tuple(tuple(shown[start : start + columns]) for start in range(0, len(shown), columns))
    return drawn_plot(Plot("where", caption, rows, heights=(2.2,)))


def _nothing() -> Figure:
    figure, (axes,) = panels(height=1.5)
    axes.set_axis_off()
    axes.text(0.5, 0.5, "no coordinate to look at", ha="center", va="center", transform=axes.transAxes)
    return figure


def _atlas_panel(curve: CoordinateCurve, torque_unit: str, limits: tuple[float, float]) -> Panel:
    name, color = plain(curve.coordinate), _color(curve)
    direction, spectrum = curve.coordinate == "direction", curve.coordinate == "frequency"
    x = Scale(name, curve.unit)
    if direction:
        x = Scale(name, limits=(-2.0, 2.0), ticks=((-1.0, "negative"), (1.0, "positive")))
    low, high = curve.mean - curve.band, curve.mean + curve.band
    size = 5.0 if direction else 1.3
    drawn_as = Curve("mean residual", color, curve.x, curve.mean, points=direction, size=size, low=low, high=high)
    height = Scale("residual", f"{torque_unit}/√Hz" if spectrum else torque_unit, limits=None if spectrum else limits)
    return Panel(x, height, (drawn_as,), _heading(curve), color, (Rule(0.0, MEASURED, dashed=False),))


def _color(curve: CoordinateCurve) -> str:
    return BELIEVED if curve.p_value < SIGNIFICANT else MUTED


def _heading(curve: CoordinateCurve) -> str:
    return f"{plain(curve.coordinate)}: {percent(curve.share) if curve.p_value < SIGNIFICANT else 'chance'}"


def telling(coordinate: str, share: float) -> float:
    """What a coordinate says with its share of the power: all that is no noise lives at some frequencies."""
    return 0.5 * share if coordinate == "frequency" else share


def _draw_curve(axes: Axes, curve: CoordinateCurve, torque_unit: str) -> None:
    color = _color(curve)
    axes.axhline(0.0, color=MEASURED, lw=0.7)
    if curve.coordinate == "direction":
        axes.errorbar(curve.x, curve.mean, curve.band, fmt="o", color=color, capsize=4)
        axes.set_xlim(-2, 2)
        axes.set_xticks([-1, 1], ["negative", "positive"])
    else:
        axes.fill_between(curve.x, curve.mean - curve.band, curve.mean + curve.band, color=color, alpha=0.25, lw=0)
        axes.plot(curve.x, curve.mean, color=color)
    unit = f"{torque_unit}/√Hz" if curve.coordinate == "frequency" else torque_unit
    label(axes, labelled(curve.coordinate, curve.unit), f"residual, retuned ({unit})")
    axes.set_title(f"{_heading(curve)} of what is left" if curve.p_value < SIGNIFICANT else _heading(curve), color=color)


def percent(share: float) -> str:
    """A share of the power."""
    return "under 1 %" if share < 0.01 else f"{100.0 * share:.0f} %"


def draw_series(evidence: Evidence, fit: Mapping[str, Any]) -> Picture:
    """Three panels at one scale, so that the eye compares; a belief so wrong that no other would be seen has its own."""
    series = {name: getattr(evidence, name) for name in WORDS}
    believed, *others = (main_range(values, 0.998, 1.3)[1] for values in series.values())
    own = believed > DWARFED * max(others)
    scale = max(others) if own else max(believed, *others)
    held_out = [(evidence.t[a], evidence.t[b - 1]) for a, b in runs(np.asarray(evidence.held_out, dtype=bool))]
    rows = []
    for name, values in series.items():
        apart = own and name == "believed"
        kept = "held out" if fit[name]["untouched"] is None else "untouched"
        title = f"{name}: {stated(fit[name]):.3g} {evidence.torque_unit} rms, {kept}"
        reach = believed if apart else scale
        rows.append(
            (
                Panel(
                    Scale("time", "s"),
                    Scale("residual", evidence.torque_unit, limits=(-reach, reach)),
                    (Curve(name, COLORS[name], evidence.t, values, size=0.8),),
                    f"{title}, at a scale of its own" if apart else title,
                    COLORS[name],
                    tuple(Rule(sign * float(fit["noise_floor"] or 0.0), MEASURED) for sign in (-2.0, 2.0)),
                    tuple((float(start), float(stop)) for start, stop in held_out),
                ),
            )
        )
    caption = (
        "Torque residual over time: the model as believed, retuned, and with the physics found. "
        "Grey background: held out, which no fit saw, or untouched, which no choice saw either. Dashed: twice the noise floor."
    )
    return drawn_plot(Plot("before_after", caption, tuple(rows), heights=(1.5,), linked=True))


def draw_friction(evidence: Evidence) -> Picture | None:
    """Friction against speed beside the three models; None of recordings without motion."""
    if evidence.friction is None:
        return None
    shown = {name: Shown(name, COLORS[name]) for name in WORDS}
    return draw_friction_by_speed(evidence.friction, shown, "improved", evidence.torque_unit, evidence.position_unit == "rad")


def draw_isolated(item: Isolated, index: int, evidence: Evidence) -> Picture:
    """What is left over the effect's own coordinate when the rest is taken away, and the fit."""
    reach, few = main_range(item.residual, 0.995, 1.4), thin(len(item.x), SHOWN)
    panel = Panel(
        Scale(plain(item.coordinate), item.unit),
        Scale("torque", evidence.torque_unit, limits=reach),
        (
            Curve("left when the rest is taken away", MUTED, item.x[few], item.residual[few], points=True, size=1.3),
            Curve(f"{item.title}, fitted", IMPROVED, item.x, item.fitted, size=1.8),
        ),
    )
    return drawn_plot(Plot(f"effect_{index + 1}_{item.effect}", f"{item.title}, by itself.", ((panel,),), heights=(3.0,)))


@drawn(
    "learned_map",
    "Opposing torque that the data ask for and no physics here explains: a table, with which the simulation predicts better; "
    "empty where nothing was recorded. Look for what changes with these coordinates.",
)
def draw_map(learned: Map, torque_unit: str) -> Figure:
    """A curve over one coordinate, colours over two."""
    figure, (axes,) = panels(height=3.2)
    names = list(map(labelled, learned.coordinates, learned.units))
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


def plain(coordinate: str) -> str:
    """A coordinate's name in words."""
    return coordinate.removeprefix("exogenous:").replace("_", " ")


def labelled(coordinate: str, unit: str) -> str:
    """A coordinate's name in words, with its unit if it has one."""
    return f"{plain(coordinate)} ({unit})" if unit else plain(coordinate)
