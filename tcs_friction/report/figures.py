"""How figures look: one style, one set of colours with one meaning each, units on every axis.

Figures are made without pyplot: no global state, nothing to close. A drawing function is wrapped in `drawn`,
which gives it the style and turns the figure that it returns into a `Picture`.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tcs_friction.config import write_bytes
from tcs_friction.numerics.envelope import envelope
from tcs_friction.report.plot import Plot

Array = NDArray[np.float64]
P = ParamSpec("P")

# Okabe and Ito's palette, which colour-blind readers can tell apart. One meaning each, in every report.
MEASURED = "#3a3f44"
BELIEVED = "#d55e00"  # before, without compensation, the model as given
RETUNED = "#b8860b"
IMPROVED = "#0072b2"  # after, with compensation, the model with the missing physics
TRUTH = "#009e73"
OTHER = "#aa4499"
MUTED = "#a8b0b8"
DARK = {
    MEASURED: "#c9d1d9",
    BELIEVED: "#ff8a3d",
    RETUNED: "#e3b341",
    IMPROVED: "#6cb8ea",
    TRUTH: "#2cc295",
    OTHER: "#d98ad0",
    MUTED: "#6e7984",
}
"""The same colours on dark paper; others stay what they are."""
SERIES = (IMPROVED, BELIEVED, TRUTH, OTHER, RETUNED, MEASURED, "#56b4e9", "#882255")

STYLE: dict[str, Any] = {
    "figure.dpi": 125,
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#6b7480",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 5),
    "grid.color": "#e3e7eb",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.constrained_layout.use": True,
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Picture:
    """A drawn figure: file name without ending, what it shows, the PNG, and the plot that it is of, if it is of one."""

    name: str
    caption: str
    png: bytes
    plot: Plot | None = None

    def save(self, folder: Path) -> Path:
        """Write NAME.png into the folder, whole or not at all."""
        path = folder / f"{self.name}.png"
        write_bytes(path, self.png)
        return path


def drawn(name: str, caption: str) -> Callable[[Callable[P, Figure]], Callable[P, Picture]]:
    """Decorator: what the function draws, in the house style, becomes a Picture of that name and caption."""

    def wrap(draw: Callable[P, Figure]) -> Callable[P, Picture]:
        @functools.wraps(draw)
        def wrapped(*args: P.args, **kwargs: P.kwargs) -> Picture:
            return picture_of(name, caption, lambda: draw(*args, **kwargs))

        return wrapped

    return wrap


def picture_of(name: str, caption: str, draw: Callable[[], Figure]) -> Picture:
    """Run a drawing function in the house style; its figure as a Picture."""
    with matplotlib.rc_context(cast(Any, STYLE)):
        figure = draw()
        buffer = io.BytesIO()
        FigureCanvasAgg(figure)
        figure.savefig(buffer, format="png")
    return Picture(name, caption, buffer.getvalue())


def panels(
    rows: int = 1, columns: int = 1, height: float = 2.8, width: float = 8.6, **kwargs: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with a grid of axes, row by row; `height` is one row's, in inches. Call it while drawing."""
    figure = Figure(figsize=(width, height * rows))
    grid = figure.subplots(rows, columns, squeeze=False, **kwargs)
    return figure, list(grid.ravel())


def label(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Axis labels, with their units, and a title."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title)


def legend(axes: Axes, columns: int = 4) -> None:
    """The legend in one row above the axes, where it hides nothing."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2)


def line(axes: Axes, x: Array, y: Array, color: str, name: str | None = None, **kwargs: Any) -> None:
    """A line that keeps its extremes however many points it has."""
    at = envelope(y)
    axes.plot(x[at], y[at], color=color, label=name, **kwargs)


def thin(count: int, most: int = 4000) -> slice:
    """A slice that takes at most about `most` of `count` samples, for scatter plots."""
    return slice(None, None, max(1, count // most))
