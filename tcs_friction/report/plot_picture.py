"""A plot as a picture: for paper, for the file beside the page, and for pages whose scripts do not run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tcs_friction.numerics.envelope import envelope
from tcs_friction.report.figures import Picture, picture_of
from tcs_friction.report.plot import Curve, Panel, Plot, Scale, Spacing, shown_limits

WIDTH = 9.2  # inches
GROUND = "#eceff2"  # of spans
BARS = 0.45  # opacity of the bars at points
MANY = 500  # points that are a cloud, behind lines
AXIS = {"x": "xaxis", "y": "yaxis"}


def drawn_plot(plot: Plot) -> Picture:
    """The plot by matplotlib, in the house style."""
    return replace(picture_of(plot.name, plot.caption, lambda: draw(plot)), plot=plot)


def draw(plot: Plot) -> Figure:
    """The figure; call it while drawing."""
    count, columns = len(plot.rows), max(map(len, plot.rows))
    heights = [plot.height(row) for row in range(count)]
    widths = [*plot.widths, *[plot.widths[-1]] * columns][:columns]
    figure = Figure(figsize=(WIDTH, sum(heights) + 0.3))
    grid = figure.add_gridspec(count, columns, height_ratios=heights, width_ratios=widths)
    for row, panels in enumerate(plot.rows):
        for column, panel in enumerate(panels):
            hidden = plot.linked and row + 1 < count
            _draw_panel(figure.add_subplot(grid[row, column]), panel, hidden)
    _legend(figure, plot)
    return figure


def _draw_panel(axes: Axes, panel: Panel, bare: bool) -> None:
    """One panel; `bare`: another one below has the same x and its numbers."""
    for way, scale, limits in zip("xy", (panel.x, panel.y), shown_limits(panel), strict=True):
        _spread(axes, way, scale)
        axes.set(**{f"{way}lim": limits})
    for start, stop in panel.spans:
        axes.axvspan(start, stop, color=GROUND, lw=0, zorder=0)
    for rule in panel.rules:
        across = axes.axhline if rule.across == "y" else axes.axvline
        across(rule.at, color=rule.color, lw=0.8, ls="--" if rule.dashed else "-", zorder=1.5)
    for curve in panel.curves:
        _draw_curve(axes, curve)
    if bare:
        axes.tick_params(labelbottom=False)
    else:
        axes.set_xlabel(panel.x.label)
    axes.set_ylabel(panel.y.label)
    if panel.title:
        axes.set_title(panel.title, color=panel.title_color or "black")


def _spread(axes: Axes, way: str, scale: Scale) -> None:
    choose = axes.set_xscale if way == "x" else axes.set_yscale
    if scale.spacing is Spacing.ASINH:
        choose("asinh", linear_width=scale.linear)
        getattr(axes, AXIS[way]).set_major_formatter(lambda value, _: f"{value:.3g}")
    elif scale.spacing is Spacing.LOG:
        choose("log")
    if scale.ticks:
        at, words = zip(*scale.ticks, strict=True)
        getattr(axes, AXIS[way]).set_ticks(at, words)


def _draw_curve(axes: Axes, curve: Curve) -> None:
    if curve.points:
        face = "white" if curve.hollow else curve.color
        shape: dict[str, Any] = {"ms": curve.size, "mew": 0.9 if curve.hollow else 0.0, "mfc": face, "mec": curve.color}
        if curve.low is not None and curve.high is not None:
            axes.vlines(curve.x, curve.low, curve.high, color=curve.color, lw=0.8, alpha=BARS, zorder=2.2)
        axes.plot(curve.x, curve.y, "o", label=curve.name, zorder=2.0 if len(curve.x) > MANY else 2.5, **shape)
        return
    order = np.argsort(curve.x, kind="stable")
    at = order[envelope(curve.y[order])]
    axes.plot(curve.x[at], curve.y[at], color=curve.color, lw=curve.size, ls="--" if curve.dashed else "-", label=curve.name)
    if curve.low is not None and curve.high is not None:
        axes.fill_between(curve.x[order], curve.low[order], curve.high[order], color=curve.color, alpha=0.22, lw=0)


def _legend(figure: Figure, plot: Plot) -> None:
    """One legend above all panels, where there is more than one name."""
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    if len(handles) > 1 or any(len(panel.curves) > 1 for panel in plot.panels):
        made: Any = figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=4)
        for handle in made.legend_handles:
            if isinstance(handle, Line2D) and handle.get_marker() == "o":
                handle.set_markersize(max(float(handle.get_markersize()), 4.0))
