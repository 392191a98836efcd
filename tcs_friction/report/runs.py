"""Pictures of a tracking run: speed, error in time and frequency, friction against time and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d
from scipy.signal import welch

from tcs_friction.control.compensator import (
    STATES,
    CompensatorConfig,
    LugreParameters,
    compensator_parameters,
    lugre_step,
)
from tcs_friction.control.loop import LoopRun
from tcs_friction.control.tracking import (
    ARCSEC,
    Improvement,
    TrackingErrors,
    errors_by_reversal,
    improvement,
    reversals,
    tracking_errors,
)
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    TRUTH,
    Array,
    drawn,
    label,
    legend,
    line,
    panels,
)

DEGREE = np.pi / 180.0
"""One degree in rad."""
SMOOTHING = 0.1  # s
NEAR = 1.5  # s to either side of a reversal that is looked at closely


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

    def improvement(self, after: TrackingRun, settle: float) -> Improvement:
        """What became of the error in a later run of the same reference."""
        runs = (self, after)
        return improvement(*(errors_by_reversal(run.t, run.reference_velocity, run.error, settle) for run in runs))


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
    """Measured speed under wanted speed."""
    figure, (axes,) = panels()
    line(axes, run.t, run.velocity / DEGREE, MUTED, "measured")
    line(axes, run.t, run.reference_velocity / DEGREE, MEASURED, "wanted")
    label(axes, "time (s)", "speed (deg/s)")
    legend(axes)
    return figure


@dataclass(frozen=True)
class Stage:
    """A tracking run in one stage of compensation, and how it is drawn."""

    name: str
    color: str
    run: TrackingRun


@drawn("tracking_error", "Tracking error in each stage of compensation: the whole run, and its mean over 0.1 s about a reversal.")
def draw_errors(stages: Sequence[Stage]) -> Figure:
    """Error in time, without compensation first; on the right its mean over SMOOTHING about a reversal, without that stage."""
    figure, (whole, close) = panels(1, 2, height=3.2, width=9.4, gridspec_kw={"width_ratios": [1.7, 1]})
    first = stages[0].run
    crossings = reversals(first.t, first.reference_velocity)[:, 0]
    inside = crossings[crossings < first.t[-1] - NEAR]
    center = float(inside[-1] if len(inside) else first.t[-1])
    for stage in stages:
        line(whole, stage.run.t, stage.run.error / ARCSEC, stage.color, stage.name, lw=0.9)
    for stage in stages[1:]:
        near = np.abs(stage.run.t - center) < NEAR
        line(close, stage.run.t[near], smoothed(stage.run.t, stage.run.error)[near] / ARCSEC, stage.color, lw=1.1)
    label(whole, "time (s)", "tracking error (arcsec)")
    label(close, f"time (s); mean over {SMOOTHING:g} s", "")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


@drawn("tracking_spectrum", "Tracking error over frequency in each stage of compensation.")
def draw_spectra(stages: Sequence[Stage]) -> Figure:
    """Amplitude density of the error."""
    figure, (axes,) = panels(height=3.0)
    for stage in stages:
        frequency, density = spectrum(stage.run)
        axes.loglog(frequency, density, color=stage.color, label=stage.name, lw=1.0)
    label(axes, "frequency (Hz)", "tracking error (arcsec/√Hz)")
    legend(axes)
    return figure


def spectrum(run: TrackingRun) -> tuple[Array, Array]:
    """Frequency (Hz) and amplitude density of the error (arcsec/√Hz), by Welch's method."""
    rate = 1.0 / float(np.median(np.diff(run.t)))
    length = min(len(run.t), round(16.0 * rate))
    frequency, density = welch(run.error / ARCSEC, rate, nperseg=length)
    keep = (frequency > 0.0) & (frequency < 0.4 * rate)
    return frequency[keep], np.sqrt(density[keep])


def smoothed(t: Array, values: Array) -> Array:
    """Running mean over SMOOTHING seconds."""
    width = max(1, round(SMOOTHING / float(np.median(np.diff(t)))))
    mean: Array = uniform_filter1d(values, width)
    return mean


def simulated_friction(t: Array, velocity: Array, parameters: LugreParameters) -> Array:
    """LuGre friction (n,) along a measured velocity (n,), smoothed so that its noise does not dither the bristle."""
    dt = float(np.median(np.diff(t)))
    packed = compensator_parameters(CompensatorConfig(parameters, parameters), dt)
    state, friction = np.zeros(STATES), np.empty(len(t))
    for k, speed in enumerate(smoothed(t, velocity)):
        friction[k] = lugre_step(state, packed, speed, 0.0)
    return friction


@drawn("friction", "Friction against time and against speed (its mean over 0.1 s).")
def draw_friction(run: FrictionRun) -> Figure:
    """Friction in time on the left, over speed on the right."""
    figure, (left, right) = panels(1, 2, height=3.3, width=9.4, gridspec_kw={"width_ratios": [1.5, 1]})
    every: list[tuple[Array | None, str, str, float]] = [
        (run.truth, TRUTH, "true", 3.0),
        (run.observed, MEASURED, "observed", 1.2),
        (run.simulated, IMPROVED, "identified law", 1.0),
    ]
    for values, color, name, width in every:
        if values is not None:
            line(left, run.t, values, color, name, lw=width)
            right.plot(smoothed(run.t, run.velocity) / DEGREE, values, color=color, lw=width)
    label(left, "time (s)", "friction (N m)")
    label(right, "speed (deg/s)", "")
    legend(left)
    return figure


@drawn("cost", "Best cost of each generation of the search.")
def draw_costs(costs: Mapping[str, Array]) -> Figure:
    """Best cost (half sum of squares, (N m)²) per generation of each method, name -> (generations,)."""
    colors = (IMPROVED, BELIEVED, TRUTH)
    figure, (axes,) = panels()
    for (name, values), color in zip(costs.items(), colors, strict=False):
        axes.semilogy(np.arange(1, len(values) + 1), values, color=color, label=name)
    label(axes, "generation", "best cost ((N m)²)")
    if len(costs) > 1:
        legend(axes)
    return figure
