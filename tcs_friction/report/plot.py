"""What a plot shows, apart from how it is drawn: panels with scales, curves and marks.

One `Plot` is drawn twice: as a picture for paper and for pages without scripts (`plot_picture`), and as data for a figure that
can be zoomed and read off (`plot_page`). Arrays are copied and read-only. NaN is a gap in a line.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Spacing(enum.StrEnum):
    """How values are spread along a scale. ASINH: evenly up to `Scale.linear`, beyond it by decades, both signs."""

    LINEAR = "linear"
    LOG = "log"
    ASINH = "asinh"


@dataclass(frozen=True)
class Scale:
    """An axis of a panel.

    limits: what is shown before anyone zooms; None: all of the curves. linear: width of the even part of ASINH.
    also: a second unit for the read-out, and how many of it the first is: ("rad/s", pi / 180) where `unit` is deg/s.
    ticks: values that are named instead of numbered, as +1 and -1 of a direction.
    """

    name: str
    unit: str = ""
    spacing: Spacing = Spacing.LINEAR
    linear: float = 1.0
    limits: tuple[float, float] | None = None
    also: tuple[str, float] | None = None
    ticks: tuple[tuple[float, str], ...] = ()

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True, eq=False)
class Curve:
    """A line through, or points at, x and y, each (n,).

    low, high: (n,) ends of a band around the line or of the bars at the points. size: width of the line or diameter of a point,
    1/72 inch. hollow: points that are only outlined. A line is drawn in order of x.
    """

    name: str
    color: str
    x: Array
    y: Array
    points: bool = False
    size: float = 1.2
    dashed: bool = False
    hollow: bool = False
    low: Array | None = None
    high: Array | None = None

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, np.ndarray):
                array = np.array(value, dtype=np.float64)
                array.setflags(write=False)
                object.__setattr__(self, entry.name, array)
        lengths = {len(a) for a in (self.x, self.y, self.low, self.high) if a is not None}
        if len(lengths) > 1:
            raise ValueError(f"curve {self.name!r} has arrays of {sorted(lengths)} values")
        if (self.low is None) is not (self.high is None):
            raise ValueError(f"curve {self.name!r} has one end of a band, not two")


@dataclass(frozen=True)
class Rule:
    """A straight line across a panel at a value of x or of y, as a threshold."""

    at: float
    color: str
    across: str = "y"
    dashed: bool = True


@dataclass(frozen=True, eq=False)
class Panel:
    """One coordinate system. spans: ranges of x with a grey background. title: with its colour, where it has one of its own."""

    x: Scale
    y: Scale
    curves: tuple[Curve, ...]
    title: str = ""
    title_color: str | None = None
    rules: tuple[Rule, ...] = ()
    spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Plot:
    """Panels in rows with a caption; `name` is the file's, without ending.

    heights: of the rows, inches; the last one stands for all further rows. widths: shares of the columns.
    linked: the panels have the same x; what is zoomed or read in one is in all.
    """

    name: str
    caption: str
    rows: tuple[tuple[Panel, ...], ...]
    heights: tuple[float, ...] = (2.8,)
    widths: tuple[float, ...] = (1.0,)
    linked: bool = False

    @property
    def panels(self) -> tuple[Panel, ...]:
        """Row by row."""
        return tuple(panel for row in self.rows for panel in row)

    def height(self, row: int) -> float:
        """Of a row, inches."""
        return self.heights[min(row, len(self.heights) - 1)]


def shown_limits(panel: Panel) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of x and y before anyone zooms: those stated, otherwise all values with a margin."""
    every_x = [curve.x for curve in panel.curves]
    every_y = [a for curve in panel.curves for a in (curve.y, curve.low, curve.high) if a is not None]
    return _limits(panel.x, every_x, 0.0), _limits(panel.y, every_y, 0.06)


def _limits(scale: Scale, arrays: list[Array], margin: float) -> tuple[float, float]:
    if scale.limits is not None:
        return scale.limits
    values = np.concatenate(arrays) if arrays else np.zeros(1)
    values = values[np.isfinite(values) & ((values > 0.0) | (scale.spacing is not Spacing.LOG))]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if scale.spacing is Spacing.LOG:
        factor = (high / low) ** margin if high > low else 2.0
        return low / factor, high * factor
    if scale.spacing is Spacing.ASINH:
        low, high = (scale.linear * float(np.sinh(v)) for v in _limits(Scale(""), [np.arcsinh(values / scale.linear)], 0.02))
        return low, high
    room = margin * (high - low) or (0.05 * abs(high) + 1e-12 if high == low else 0.0)
    return low - room, high + room


def main_range(values: Array, share: float = 0.999, room: float = 1.5) -> tuple[float, float]:
    """Limits about zero that show all but the most extreme share of values (n,)."""
    finite = np.abs(values[np.isfinite(values)])
    spread = room * float(np.quantile(finite, share)) if len(finite) else 0.0
    spread = spread if spread > 0.0 else 1.0
    return -spread, spread
