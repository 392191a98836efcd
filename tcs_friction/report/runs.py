"""Pictures of a tracking run: speed, error in time and frequency, friction against time and speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

from tcs_friction.control.loop import LoopRun
from tcs_friction.control.tracking import ARCSEC, TrackingErrors, tracking_errors
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    TRUTH,
    Array,
    drawn,
    label,
    line,
    panels,
    thin,
)

DEGREE = np.pi / 180.0
"""One degree in rad."""


@dataclass(frozen=True)
class TrackingRun:
    """How an axis followed its reference, each array (n,): s, rad/s, rad/s, rad (reference less measured)."""

    t: Array
    reference_velocity: Array
    velocity: Array
    error: Array

    def __post_init__(self) -> None:
        for entry in fields(self):
            array = np.array(getattr(self, entry.name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, entry.name, array)

    @classmethod
    def of(cls, run: LoopRun) -> TrackingRun:
        """The tracking of an offline loop."""
        return cls(run.t, run.reference_velocity, run.velocity, run.error)

    def errors(self, settle: float) -> TrackingErrors:
        """Table 3's numbers in arcsec, leaving out the first `settle` seconds."""
        return tracking_errors(self.t, self.reference_velocity, self.error / ARCSEC, settle)


@dataclass(frozen=True)
class FrictionRun:
    """Friction over a run, each array (n,): s, rad/s, N m. `truth` is None where nobody knows it."""

    t: Array
    velocity: Array
    observed: Array
    truth: Array | None = None
    simulated: Array | None = None  # by the identified law


@drawn("speed", "Speed of the axis over the run: wanted and measured.")
def draw_speed(run: TrackingRun) -> Figure:
    """Measured speed over wanted speed."""
    figure, (axes,) = panels()
    line(axes, run.t, run.velocity / DEGREE, MUTED, "measured")
    line(axes, run.t, run.reference_velocity / DEGREE, MEASURED, "wanted")
    label(axes, "time (s)", "speed (deg/s)")
    axes.legend(loc="upper right")
    return figure


@drawn("tracking_error", "Tracking error before and after compensation; the peaks are the reversals.")
def draw_errors(before: TrackingRun, after: TrackingRun, ideal: TrackingRun | None = None) -> Figure:
    """Error in time: before on top, after below at the same scale, and the run without friction."""
    figure, (top, bottom) = panels(2, sharex=True, sharey=True, height=2.2)
    line(top, before.t, before.error / ARCSEC, BELIEVED)
    label(top, "", "error (arcsec)", "before compensation")
    line(bottom, after.t, after.error / ARCSEC, IMPROVED, "after")
    if ideal is not None:
        line(bottom, ideal.t, ideal.error / ARCSEC, TRUTH, "friction switched off", lw=0.8)
        bottom.legend(loc="upper right", ncols=2)
    label(bottom, "time (s)", "error (arcsec)", "after compensation")
    return figure


@drawn("tracking_spectrum", "Tracking error over frequency before and after compensation.")
def draw_spectra(before: TrackingRun, after: TrackingRun, ideal: TrackingRun | None = None) -> Figure:
    """Amplitude density of the error."""
    figure, (axes,) = panels(height=3.0)
    every = [
        (before, BELIEVED, "before"),
        (after, IMPROVED, "after"),
        (ideal, TRUTH, "friction switched off"),
    ]
    for run, color, name in every:
        if run is not None:
            frequency, density = spectrum(run)
            axes.loglog(frequency, density, color=color, label=name)
    label(axes, "frequency (Hz)", "error (arcsec/√Hz)")
    axes.grid(True, which="both")
    axes.legend()
    return figure


def spectrum(run: TrackingRun) -> tuple[Array, Array]:
    """Frequency (Hz) and amplitude density of the error (arcsec/√Hz), by Welch's method."""
    rate = 1.0 / float(np.median(np.diff(run.t)))
    length = min(len(run.t), round(16.0 * rate))
    frequency, density = welch(run.error / ARCSEC, rate, nperseg=length)
    keep = (frequency > 0.0) & (frequency < 0.4 * rate)
    return frequency[keep], np.sqrt(density[keep])


@drawn("friction", "Friction against time and speed: observed, simulated with the identified law, and true.")
def draw_friction(run: FrictionRun) -> Figure:
    """Friction in time on the left, over speed on the right."""
    figure, (left, right) = panels(1, 2, height=3.3, width=9.4, gridspec_kw={"width_ratios": [1.5, 1]})
    every: list[tuple[Array | None, str, str]] = [
        (run.observed, MEASURED, "observed"),
        (run.truth, TRUTH, "true"),
        (run.simulated, IMPROVED, "identified law"),
    ]
    few = thin(len(run.t))
    for values, color, name in every:
        if values is None:
            continue
        line(left, run.t, values, color, name, alpha=0.9)
        right.plot(run.velocity[few] / DEGREE, values[few], ".", ms=1.5, color=color, rasterized=True)
    label(left, "time (s)", "friction (N m)")
    label(right, "speed (deg/s)", "friction (N m)")
    left.legend(loc="upper right", ncols=3)
    return figure


@drawn("cost", "Best cost of each generation of the search.")
def draw_costs(costs: Mapping[str, Array]) -> Figure:
    """Best cost (half sum of squares, (N m)²) per generation of each method, name -> (generations,)."""
    colors = (IMPROVED, BELIEVED, TRUTH)
    figure, (axes,) = panels()
    for (name, values), color in zip(costs.items(), colors, strict=False):
        axes.semilogy(np.arange(1, len(values) + 1), values, color=color, label=name)
    label(axes, "generation", "best cost (N² m²)")
    axes.grid(True, which="both")
    axes.legend()
    return figure
