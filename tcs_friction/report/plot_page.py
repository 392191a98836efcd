"""A plot in a page: its picture, and its numbers for a figure that can be zoomed and read off.

The figure is made by uPlot in the reader's browser (`assets/plots.js`). Where no script runs, and on paper, the picture is seen.
The numbers stand as JSON in a script element of a type that no browser runs; `<`, `>` and `&` are escaped in it, so that nothing
in a name is ever markup. Long lines keep least and greatest value of every stretch: a page stays small and no peak is lost.
"""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcs_friction.numerics.envelope import envelope
from tcs_friction.report.assets import plots_script, uplot_script, uplot_style
from tcs_friction.report.figures import DARK
from tcs_friction.report.plot import Array, Curve, Panel, Plot, Scale, Spacing, shown_limits

LINE = 2400  # values of a line that a page keeps
CLOUD = 2500  # values of a cloud of points
DIGITS = 5  # of what a panel shows
PIXELS = 84  # of the page to an inch of the picture
NUMBERS = 40  # pixels more where numbers and label of x stand below

MARK = '<figure class="plot">'

STYLE = """
.plot .live{display:none}
.plot.ready .live{display:block}
.plot .hint{display:none}
@media screen{.plot.ready .still{display:none}.plot.ready .hint{display:inline}}
@media print{.plot .live,.plot.ready .live{display:none}}
.plot .row{display:grid;gap:0 1rem;background:var(--panel)}
.plot .cell{min-width:0}
.plot .title{font-size:.92rem;font-weight:600;margin:.5rem 0 0 .3rem}
.plot .live{border:1px solid var(--line);border-radius:8px;padding:.3rem .4rem;background:var(--panel)}
.plot .u-legend{font-size:.82rem;text-align:left;margin:0 0 .3rem;display:block}
.plot .u-legend tbody{display:flex;flex-wrap:wrap}
.plot .u-legend .u-series{display:block;margin-right:.8rem}
.plot .u-legend .u-series>*{padding:1px 3px}
.plot .u-legend td,.plot .u-legend th{border:0;color:var(--ink);font-variant-numeric:tabular-nums}
.plot .u-legend th{font-weight:400;color:var(--soft)}
.plot .u-select{background:var(--select)}
@media(max-width:40rem){.plot .row{grid-template-columns:minmax(0,1fr)!important}}
"""


def plot_figure(plot: Plot, png: bytes) -> str:
    """The figure element of a plot, with its picture for paper."""
    image = base64.b64encode(png).decode("ascii")
    caption = html.escape(plot.caption)
    hint = '<span class="hint"> Drag over a part to zoom, double-click (tap twice) to go back.</span>'
    return (
        f'{MARK}<img class="still" alt="{caption}" src="data:image/png;base64,{image}"><div class="live"></div>'
        f'<script type="application/json">{_inert(plot_data(plot))}</script><figcaption>{caption}{hint}</figcaption></figure>'
    )


def plot_head() -> str:
    """What a page with plots needs in its head."""
    return f"<style>{uplot_style()}{STYLE}</style>"


def plot_foot() -> str:
    """What it needs at its end: the library, and what makes a figure of every plot."""
    return f"<script>{uplot_script()}</script>\n<script>{plots_script()}</script>"


def plot_data(plot: Plot) -> dict[str, Any]:
    """What the page keeps of a plot."""
    columns, last = max(map(len, plot.rows)), len(plot.rows) - 1
    heights = [round(PIXELS * plot.height(row)) + (0 if plot.linked and row < last else NUMBERS) for row in range(last + 1)]
    return {
        "caption": plot.caption,
        "linked": plot.linked,
        "widths": [*plot.widths, *[plot.widths[-1]] * columns][:columns],
        "rows": [
            {"height": height, "panels": [_panel(panel) for panel in panels]}
            for height, panels in zip(heights, plot.rows, strict=True)
        ],
    }


def kept(curves: Sequence[Curve]) -> list[np.ndarray]:
    """Indices of what the page keeps of each curve; lines over the same x keep the same, so that they are read off together."""
    chosen: list[np.ndarray] = []
    for curve in curves:
        if curve.points:
            few = np.arange(0, len(curve.x), max(1, math.ceil(len(curve.x) / CLOUD)))
            chosen.append(np.union1d(few, envelope(curve.y, 200)))
            continue
        alike = [c for c in curves if not c.points and len(c.x) == len(curve.x) and np.array_equal(c.x, curve.x)]
        order = np.argsort(curve.x, kind="stable")
        at = [envelope(c.y[order], max(LINE // len(alike), 400)) for c in alike] if len(order) > LINE else [np.arange(len(order))]
        chosen.append(order[np.unique(np.concatenate(at))])
    return chosen


def _panel(panel: Panel) -> dict[str, Any]:
    x_limits, y_limits = shown_limits(panel)
    return {
        "title": panel.title,
        "titleColor": _both(panel.title_color) if panel.title_color else None,
        "x": _scale(panel.x, x_limits),
        "y": _scale(panel.y, y_limits),
        "curves": [
            _curve(panel, curve, at, x_limits, y_limits) for curve, at in zip(panel.curves, kept(panel.curves), strict=True)
        ],
        "rules": [{"at": r.at, "across": r.across, "color": _both(r.color), "dashed": r.dashed} for r in panel.rules],
        "spans": [list(map(float, span)) for span in panel.spans],
    }


def _scale(scale: Scale, limits: tuple[float, float]) -> dict[str, Any]:
    return {
        "label": scale.label,
        "name": scale.name,
        "unit": scale.unit,
        "spacing": scale.spacing.value,
        "linear": scale.linear,
        "limits": [float(limit) for limit in limits],
        "also": None if scale.also is None else list(scale.also),
        "ticks": [list(tick) for tick in scale.ticks],
    }


def _curve(
    panel: Panel, curve: Curve, at: np.ndarray, x_limits: tuple[float, float], y_limits: tuple[float, float]
) -> dict[str, Any]:
    return {
        "name": curve.name,
        "color": _both(curve.color),
        "points": curve.points,
        "size": curve.size,
        "dashed": curve.dashed,
        "hollow": curve.hollow,
        "x": short(curve.x[at], panel.x, x_limits),
        "y": short(curve.y[at], panel.y, y_limits),
        "low": None if curve.low is None else short(curve.low[at], panel.y, y_limits),
        "high": None if curve.high is None else short(curve.high[at], panel.y, y_limits),
    }


def short(values: Array, scale: Scale, limits: tuple[float, float]) -> list[float | None]:
    """Values (n,) with no more digits than can be told apart, None where there is none."""
    span = limits[1] - limits[0]
    if scale.spacing is Spacing.LINEAR and span > 0.0:
        places = DIGITS - math.floor(math.log10(span))
        rounded = np.round(values, places).tolist()
    else:
        rounded = [float(f"{value:.{DIGITS + 1}g}") for value in values.tolist()]
    return [value if math.isfinite(value) else None for value in rounded]


def _both(color: str) -> list[str]:
    """A colour on light and on dark paper."""
    return [color, DARK.get(color, color)]


def _inert(content: Any) -> str:
    """JSON that cannot end the element it stands in."""
    words = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return words.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
