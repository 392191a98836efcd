"""Section 5.2, Figs. 12 to 15: the disturbance observer calibrated with a dynamometer, friction at ten speeds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from tcs_friction.control.dob import DobConfig
from tcs_friction.control.loop import LoopRun
from tcs_friction.control.observer import NominalPlant, observer_step, pack
from tcs_friction.report import published
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
from tcs_friction.report.html import picture, section, table
from tcs_friction.report.paper.stand import TOP_SPEED, Chapter, Observed, Stand
from tcs_friction.report.runs import DEGREE

DYNAMOMETER_RANGE = 200.0  # N m at the lever it pulls at
DYNAMOMETER_CLASS = 1e-3  # of the range, as the paper's
TORQUE_SCALE = 0.97  # of the torque that the uncalibrated observer believes in
WRONG_INERTIA = 0.9  # of the true one, in the uncalibrated observer
LEAST_TRAVEL = 4.5e-4  # rad, amplitude of the slow runs: enough to slide both ways
STEADY = 0.05  # rad/s^2 relative to the largest: below, motion counts as uniform


@dataclass(frozen=True)
class Calibration:
    """Dynamometer and observer over the calibration run, each (n,), and how near they come; Fig. 12.

    accuracy: 1 - rms(observed - measured) / rms(measured), over all the run and over its uniform motion.
    """

    t: Array
    measured: Array
    before: Array
    after: Array
    accuracy_before: float
    accuracy: float
    accuracy_uniform: float
    inertia: float


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
    """Fit the observer's torque scale, nominal inertia and offset to the dynamometer."""
    run = stand.run(stand.tracking)
    observer = stand.control.observer
    ticks = round(observer.filter_delay / float(run.t[1] - run.t[0]))
    stop = len(run.t) - ticks
    torque = _filtered(run.torque * TORQUE_SCALE, np.zeros(len(run.t)), observer)[ticks:]
    inertia = -_filtered(np.zeros(len(run.t)), run.velocity, observer)[ticks:]  # torque of 1 kg m^2
    noise = np.random.default_rng(stand.seed).standard_normal(stop)
    reading = (run.friction + run.opposing)[:stop] + DYNAMOMETER_CLASS * DYNAMOMETER_RANGE * noise
    measured = uniform_filter1d(reading, 50)
    columns = np.stack([torque, -inertia, np.ones(stop)], axis=1)
    settled = run.t[:stop] > 1.0
    found = np.linalg.lstsq(columns[settled], measured[settled], rcond=None)[0]
    before = torque - WRONG_INERTIA * stand.axis.inertia * inertia
    after = columns @ found
    pace = np.abs(np.gradient(run.reference_velocity[:stop], run.t[:stop]))
    steady = (
        settled & (pace < STEADY * pace.max()) & (np.abs(run.reference_velocity[:stop]) > 0.5 * TOP_SPEED)
    )
    return Calibration(
        run.t[:stop],
        measured,
        before,
        after,
        _accuracy(before, measured, settled),
        _accuracy(after, measured, settled),
        _accuracy(after, measured, steady),
        float(found[1]) / float(found[0]),
    )


def _filtered(torque: Array, velocity: Array, observer: DobConfig) -> Array:
    """The observer's answer (n,) to these inputs with a nominal inertia of 1 kg m^2."""
    config = replace(observer, plant=NominalPlant(first=1.0))
    parameters, state = pack(config.design(1e-3))
    answer = np.empty(len(torque))
    for k in range(len(torque)):
        answer[k] = observer_step(state, parameters, torque[k], velocity[k], 0.0)
    return answer


def _accuracy(observed: Array, measured: Array, keep: NDArray[np.bool_]) -> float:
    error = (observed - measured)[keep]
    return 1.0 - float(np.sqrt(np.mean(error**2) / np.mean(measured[keep] ** 2)))


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


@drawn("figure_12", "Fig. 12. Friction observed and friction measured by the dynamometer, before and after calibration "
       "of the observer; below, the difference.")  # fmt: skip
def draw_calibration(result: Calibration) -> Figure:
    """Series on top, difference below."""
    figure, (top, bottom) = panels(2, height=2.2, sharex=True)
    line(top, result.t, result.measured, TRUTH, "dynamometer", lw=2.4)
    line(top, result.t, result.after, MEASURED, "observed, calibrated")
    line(bottom, result.t, result.before - result.measured, BELIEVED, "not calibrated")
    line(bottom, result.t, result.after - result.measured, IMPROVED, "calibrated")
    label(top, "", "friction (N m)")
    label(bottom, "time (s)", "difference (N m)")
    legend(top)
    legend(bottom)
    return figure


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


def chapter(result: MeasurementResult) -> Chapter:
    """Pictures and the accuracy beside the paper's."""
    calibration = result.calibration
    pictures = (
        draw_calibration(calibration),
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
        f"{100 * (1 - TORQUE_SCALE):.0f} % too little torque; calibration finds {calibration.inertia:.0f} kg m². The "
        "dynamometer is simulated too (0.1 % of 200 N m), and here it can be read while the axis reverses, which the "
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
