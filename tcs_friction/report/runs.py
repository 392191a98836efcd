"""Pictures of a tracking run: speed, error in time and frequency, friction against time and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
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
from tcs_friction.report.figures import BELIEVED, IMPROVED, MEASURED, MUTED, TRUTH, Array, Picture
from tcs_friction.report.plot import Curve, Panel, Plot, Scale, Spacing
from tcs_friction.report.plot_picture import drawn_plot

DEGREE = np.pi / 180.0
"""One degree in rad."""
SMOOTHING = 0.1  # s
TIME = Scale("time", "s")
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


def draw_speed(run: TrackingRun) -> Picture:
    """Measured speed under wanted speed."""
    measured = Curve("measured", MUTED, run.t, run.velocity / DEGREE)
    wanted = Curve("wanted", MEASURED, run.t, run.reference_velocity / DEGREE)
    panel = Panel(TIME, Scale("speed", "deg/s"), (measured, wanted))
    return drawn_plot(Plot("speed", "Speed of the axis over the run: wanted and measured.", ((panel,),)))


@dataclass(frozen=True)
class Stage:
    """A tracking run in one stage of compensation, and how it is drawn."""

    name: str
    color: str
    run: TrackingRun


def draw_errors(stages: Sequence[Stage]) -> Picture:
    """Error in time, without compensation first; on the right its mean over SMOOTHING about a reversal, without that stage."""
    first = stages[0].run
    crossings = reversals(first.t, first.reference_velocity)[:, 0]
    inside = crossings[crossings < first.t[-1] - NEAR]
    center = float(inside[-1] if len(inside) else first.t[-1])
    whole = tuple(Curve(stage.name, stage.color, stage.run.t, stage.run.error / ARCSEC, size=0.9) for stage in stages)
    close = []
    for stage in stages[1:]:
        near = np.abs(stage.run.t - center) < NEAR
        mean = smoothed(stage.run.t, stage.run.error)[near] / ARCSEC
        close.append(Curve(stage.name, stage.color, stage.run.t[near], mean, size=1.1))
    panels = (
        Panel(TIME, Scale("tracking error", "arcsec"), whole),
        Panel(TIME, Scale(f"mean over {SMOOTHING:g} s", "arcsec"), tuple(close), "about a reversal"),
    )
    caption = "Tracking error in each stage of compensation: the whole run, and its mean over 0.1 s about a reversal."
    return drawn_plot(Plot("tracking_error", caption, (panels,), heights=(3.2,), widths=(1.7, 1.0)))


def draw_spectra(stages: Sequence[Stage]) -> Picture:
    """Amplitude density of the error."""
    curves = tuple(Curve(stage.name, stage.color, *spectrum(stage.run), size=1.0) for stage in stages)
    density = Scale("tracking error", "arcsec/√Hz", Spacing.LOG)
    panel = Panel(Scale("frequency", "Hz", Spacing.LOG), density, curves)
    caption = "Tracking error over frequency in each stage of compensation."
    return drawn_plot(Plot("tracking_spectrum", caption, ((panel,),), heights=(3.0,)))


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


def draw_friction(run: FrictionRun) -> Picture:
    """Friction in time on the left, over speed on the right."""
    every: list[tuple[Array | None, str, str, float]] = [
        (run.truth, TRUTH, "true", 3.0),
        (run.observed, MEASURED, "observed", 1.2),
        (run.simulated, IMPROVED, "identified law", 1.0),
    ]
    known = [(values, color, name, width) for values, color, name, width in every if values is not None]
    speed = smoothed(run.t, run.velocity) / DEGREE
    in_time = tuple(Curve(name, color, run.t, values, size=width) for values, color, name, width in known)
    over_speed = tuple(Curve(name, color, speed, values, points=True, size=1.0 + 0.4 * w) for values, color, name, w in known)
    panels = (
        Panel(TIME, Scale("friction", "N m"), in_time),
        Panel(Scale("speed", "deg/s", also=("rad/s", DEGREE)), Scale("friction", "N m"), over_speed),
    )
    caption = "Friction against time and against speed (its mean over 0.1 s)."
    return drawn_plot(Plot("friction", caption, (panels,), heights=(3.3,), widths=(1.5, 1.0)))


def draw_costs(costs: Mapping[str, Array]) -> Picture:
    """Best cost (half sum of squares, (N m)²) per generation of each method, name -> (generations,)."""
    colors = (IMPROVED, BELIEVED, TRUTH)
    curves = tuple(
        Curve(name, color, np.arange(1.0, len(values) + 1.0), values)
        for (name, values), color in zip(costs.items(), colors, strict=False)
    )
    panel = Panel(Scale("generation"), Scale("best cost", "(N m)²", Spacing.LOG), curves)
    return drawn_plot(Plot("cost", "Best cost of each generation of the search.", ((panel,),)))
