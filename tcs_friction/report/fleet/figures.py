"""Pictures of a parameter over time and against temperature, narrow enough for a telephone."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import matplotlib.dates as dates
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    Array,
    Picture,
    label,
    panels,
    picture_of,
)
from tcs_friction.trends.changes import Trend
from tcs_friction.trends.words import date, spoken

WIDTH, HEIGHT = 5.0, 2.7  # inches
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def over_time(trend: Trend, law: str, reference_temperature: float) -> Picture:
    """The parameter at the reference temperature over time, its normal course with changes, and the changes marked."""
    series, name = trend.series, trend.series.name
    thermal = _columns(trend, ("temperature",))
    level = series.value - thermal
    where = f" at {reference_temperature:g} °C" if np.any(thermal) else ""
    caption = f"{_title(name, law)}{where} over time, the model with its 95 % band"
    caption += ", and what changed." if trend.changes else ": nothing changed."

    def draw() -> Figure:
        figure, (axes,) = panels(height=HEIGHT, width=WIDTH)
        days = [EPOCH + timedelta(days=float(day)) for day in series.day]
        axes.errorbar(days, level, trend.noise.std, fmt=".", ms=5, lw=0.7, color=MEASURED, ecolor=MUTED)  # type: ignore[arg-type]
        modelled = series.value - trend.fit.residual - thermal
        band = 1.96 * _error(trend)
        axes.plot(days, modelled, color=IMPROVED)  # type: ignore[arg-type]
        axes.fill_between(days, modelled - band, modelled + band, color=IMPROVED, alpha=0.2, lw=0)  # type: ignore[arg-type]
        for change in trend.changes:
            _mark(axes, change.kind, change.day, change.earliest, change.latest)
        locator = dates.AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
        label(axes, "", _with_unit(name, law, series.unit))
        return figure

    return picture_of(f"{name}_time", caption, draw)


def over_temperature(trend: Trend, law: str) -> Picture | None:
    """The parameter without its changes against temperature, with the normal model; None where no temperature is in it."""
    series, name = trend.series, trend.series.name
    if "temperature" not in trend.fit.design.names:
        return None
    modelled = trend.fit.value("level")[0] + _columns(trend, ("temperature",))
    slope, error = trend.fit.value("temperature")
    level = abs(trend.fit.value("level")[0])
    relative = (
        f", {100.0 * slope / level:.2g} ± {100.0 * error / level:.2g} % per °C"
        if level > 3.0 * abs(slope)
        else ""
    )
    caption = f"{_title(name, law)} against temperature, changes taken out{relative}."

    def draw() -> Figure:
        figure, (axes,) = panels(height=HEIGHT, width=WIDTH)
        axes.errorbar(
            series.temperature,
            modelled + trend.fit.residual,
            trend.noise.std,
            fmt=".",
            ms=5,
            lw=0.7,
            color=MEASURED,
            ecolor=MUTED,
        )
        order = np.argsort(series.temperature)
        axes.plot(series.temperature[order], modelled[order], color=IMPROVED)
        label(axes, "temperature (°C)", _with_unit(name, law, series.unit))
        return figure

    return picture_of(f"{name}_temperature", caption, draw)


def _mark(axes: Axes, kind: str, day: float, earliest: float, latest: float) -> None:
    at, first, last = (EPOCH + timedelta(days=value) for value in (day, earliest, latest))
    axes.axvspan(first, last, color=BELIEVED, alpha=0.15, lw=0)  # type: ignore[arg-type]
    axes.axvline(at, color=BELIEVED, lw=1.2, ls="--" if kind == "step" else ":")  # type: ignore[arg-type]
    words = date(day) if kind == "step" else f"drift from {date(day)}"
    axes.annotate(words, (at, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -9), textcoords="offset points",
                  color=BELIEVED, fontsize=8.5)  # fmt: skip


def _columns(trend: Trend, starts: tuple[str, ...]) -> Array:
    """(n,) what the terms whose names start so add."""
    design = trend.fit.design
    taken = [k for k, name in enumerate(design.names) if name.startswith(starts)]
    return np.asarray(design.columns[:, taken] @ trend.fit.values[taken], dtype=np.float64)


def _error(trend: Trend) -> Array:
    """(n,) standard deviation of the modelled course."""
    columns = trend.fit.design.columns
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", columns, trend.fit.covariance, columns), 0.0))


def _title(name: str, law: str) -> str:
    words = spoken(name, law)
    return words[:1].upper() + words[1:]


def _with_unit(name: str, law: str, unit: str) -> str:
    words = spoken(name, law)
    words = words if len(words) < 28 else words.partition(": ")[2] or words
    return f"{words} ({unit})" if unit else words


def largest_shift(trend: Trend) -> float:
    """How much of a parameter changed, in its own scatter: what order pictures come in."""
    return max(
        (abs(change.size) / change.std if change.std > 0.0 else math.inf for change in trend.changes),
        default=0.0,
    )
