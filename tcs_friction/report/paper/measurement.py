"""Section 5.2, Figs. 12 to 15: the disturbance observer calibrated with a dynamometer, friction at ten speeds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d

from tcs_friction.control.loop import LoopRun
from tcs_friction.identify.dob_calibration import Calibration, Comparison
from tcs_friction.identify.dob_calibration import calibrate as calibrated
from tcs_friction.report import published
from tcs_friction.report.calibration import draw_calibration
from tcs_friction.report.figures import (
    IMPROVED,
    MEASURED,
    MUTED,
    TRUTH,
    Array,
    Picture,
    drawn,
    label,
    legend,
    line,
    panels,
)
from tcs_friction.report.html import picture, section, table
from tcs_friction.report.paper.stand import TOP_SPEED, Chapter, Observed, Stand
from tcs_friction.report.runs import DEGREE

DYNAMOMETER_RANGE = 200.0  # N m at the lever it pulls at
DYNAMOMETER_CLASS = 1e-3  # of the range, as the paper's
TORQUE_SCALE = 0.97  # of the torque that the uncalibrated observer believes in
WRONG_INERTIA = 0.9  # of the true one, in the uncalibrated observer
LEAST_TRAVEL = 4.5e-4  # rad, amplitude of the slow runs: enough to slide both ways


@dataclass(frozen=True)
class Loop:
    """Friction over speed at one top speed: reference speed rad/s and friction N m, each (n,)."""

    speed: float  # deg/s
    velocity: Array
    friction: Array


@dataclass(frozen=True)
class MeasurementResult:
    """Figs. 12 to 15."""

    calibration: Calibration
    run: LoopRun
    observed: Observed
    loops: tuple[Loop, ...]


def measure(stand: Stand) -> MeasurementResult:
    """The calibration run, the 0.1 deg/s run and the ten speeds."""
    run = stand.run(stand.sinusoid(TOP_SPEED, 40.0, 2.25))
    observed = Observed.of(run, stand.control.observer.filter_delay)
    loops = tuple(_loop(stand, speed) for speed in published.SPEEDS)
    return MeasurementResult(calibrate(stand), run, observed, loops)


def calibrate(stand: Stand) -> Calibration:
    """The observer, told of a wrong inertia and of too little torque, on the tracking run with a dynamometer beside it."""
    run = stand.run(stand.tracking)
    noise = np.random.default_rng(stand.seed).standard_normal(len(run.t))
    reading = run.friction + run.opposing + DYNAMOMETER_CLASS * DYNAMOMETER_RANGE * noise
    observer = stand.control.observer
    wrong = replace(observer, plant=replace(observer.plant, first=WRONG_INERTIA * stand.axis.inertia))
    return calibrated([Comparison(run.t, TORQUE_SCALE * run.torque, run.velocity, reading)], wrong)


def _loop(stand: Stand, speed: float) -> Loop:
    """One run at a top speed (deg/s), without the way in, smoothed over a hundredth of its period."""
    period = max(20.0, 2.0 * np.pi * LEAST_TRAVEL / (speed * DEGREE))
    observed = Observed.of(
        stand.run(stand.sinusoid(speed * DEGREE, period, 1.5)), stand.control.observer.filter_delay
    )
    width = max(1, round(0.005 * period / stand.control.loop.period))
    keep = slice(np.searchsorted(observed.t, 0.5 * period), None, max(1, width // 4))
    smooth = uniform_filter1d(observed.friction, width)
    return Loop(speed, observed.velocity[keep].copy(), smooth[keep].copy())


@drawn("figure_13", "Fig. 13. The axis at a working speed of 0.1 deg/s: wanted and measured speed.")
def draw_speed(run: LoopRun) -> Figure:
    """Measured speed under wanted speed."""
    figure, (axes,) = panels(height=2.4)
    line(axes, run.t, run.velocity / DEGREE, MUTED, "measured")
    line(axes, run.t, run.reference_velocity / DEGREE, MEASURED, "wanted")
    label(axes, "time (s)", "speed (deg/s)")
    legend(axes)
    return figure


@drawn("figure_14", "Fig. 14. Friction torque at 0.1 deg/s, observed and true.")
def draw_friction(observed: Observed) -> Figure:
    """Friction in time."""
    figure, (axes,) = panels(height=2.4)
    line(axes, observed.t, observed.truth, TRUTH, "true", lw=2.4)
    line(axes, observed.t, observed.friction, MEASURED, "observed")
    label(axes, "time (s)", "friction (N m)")
    legend(axes)
    return figure


@drawn("figure_15", "Fig. 15. Friction over speed at the paper's ten working speeds, observed on sinusoids of that top "
       "speed. The hysteresis is the bristles'. At the slowest speeds the axis' own jitter acts as dither and lowers "
       "the friction that bristles build up.")  # fmt: skip
def draw_loops(loops: tuple[Loop, ...]) -> Figure:
    """Ten small multiples."""
    figure, grid = panels(2, 5, height=1.9, width=10.0, sharey=True)
    for axes, loop in zip(grid, loops, strict=True):
        axes.plot(loop.velocity / DEGREE / loop.speed, loop.friction, color=IMPROVED, lw=1.0)
        axes.set_title(f"{loop.speed:g} deg/s", fontsize=9)
    for axes in grid[::5]:
        axes.set_ylabel("friction (N m)")
    for axes in grid[5:]:
        axes.set_xlabel("speed / top speed")
    return figure


def figure_12(calibration: Calibration) -> Picture:
    """As the report of `./tcs calibrate` draws it."""
    image = draw_calibration(calibration, str)
    return Picture("figure_12", f"Fig. 12. {image.caption}", image.png)


def chapter(result: MeasurementResult) -> Chapter:
    """Pictures and the accuracy beside the paper's."""
    calibration = result.calibration
    pictures = (
        figure_12(calibration),
        draw_speed(result.run),
        draw_friction(result.observed),
        draw_loops(result.loops),
    )
    rows = [
        [
            "calibrated, over the whole run",
            f"{100 * calibration.accuracy:.2f} %",
            f"{100 * published.DOB_ACCURACY:.2f} %",
        ],
        ["calibrated, in uniform motion", f"{100 * calibration.accuracy_uniform:.2f} %", "–"],
        ["not calibrated", f"{100 * calibration.accuracy_before:.2f} %", "–"],
    ]
    words = (
        f"Before calibration the observer believes in an inertia {100 * (1 - WRONG_INERTIA):.0f} % too small and sees "
        f"{100 * (1 - TORQUE_SCALE):.0f} % too little torque; calibration finds {calibration.observer.plant.first:.0f} kg m². "
        "The dynamometer is simulated too (0.1 % of 200 N m), and here it can be read while the axis reverses, which the "
        "paper's could not."
    )
    first = section(
        "5.2 Friction measured",
        picture(pictures[0]),
        table(["observer's accuracy", "ours", "paper"], rows),
        words,
    )
    second = section("Friction at the working speeds", *map(picture, pictures[1:]))
    return Chapter(type(first)(first + second), pictures)
