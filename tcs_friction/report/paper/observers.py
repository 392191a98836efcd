"""The disturbance observer beside a Luenberger observer with Kalman gain, while the plant is not what both believe (section 2).

The paper names the weak point of a disturbance observer: its nominal plant. Here inertia and torque constant of the nominal plant
are wrong by 5, 10 and 20 %, either way, and the worse way counts. Both observers are tuned to the same delay. What any linear
observer makes of such errors is known beforehand: (error of the inertia) x acceleration and (error of the constant) x torque,
through its low-pass filter. The measured errors are shown beside that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tcs_friction.control.kalman import kalman_delay
from tcs_friction.control.loop import LoopRun
from tcs_friction.control.observer import FrictionObserver
from tcs_friction.control.observer_settings import DOB, KALMAN, ObserverSettings
from tcs_friction.control.reference import Reference
from tcs_friction.report.figures import BELIEVED, IMPROVED, MEASURED, MUTED, Array, drawn, label, panels
from tcs_friction.report.html import Html, picture, section, table
from tcs_friction.report.paper.stand import TOP_SPEED, Chapter, Stand
from tcs_friction.report.runs import DEGREE, TrackingRun

ERRORS = (0.0, 0.05, 0.10, 0.20)
INERTIA, TORQUE = "inertia", "torque constant"
PARAMETERS = (INERTIA, TORQUE)
NAMES = {DOB: "disturbance observer", KALMAN: "Kalman observer"}
COLORS = {DOB: BELIEVED, KALMAN: IMPROVED}
BRISK_SPEED, BRISK_PERIOD = 1.0 * DEGREE, 4.0  # rad/s, s: inertial torque is a third of the friction
SETTLE = 5.0  # s


@dataclass(frozen=True)
class Trial:
    """One observer believing one parameter wrong by a share (the worse sign).

    slow, brisk: relative rms error of the estimate over a zero-crossing run and over one with strong acceleration; expected:
    what the wrong parameter alone should make of the brisk one; tracking: arcsec rms of the tracking error with feedback.
    """

    observer: str
    parameter: str
    error: float
    slow: float
    brisk: float
    expected: float
    tracking: float


@dataclass(frozen=True)
class ObserversResult:
    """All trials, and arcsec rms of the tracking error without an observer."""

    trials: tuple[Trial, ...]
    without: float

    def at(self, observer: str, parameter: str) -> list[Trial]:
        """The trials of one observer and parameter, by growing error."""
        chosen = [item for item in self.trials if (item.observer, item.parameter) == (observer, parameter)]
        return sorted(chosen, key=lambda item: item.error)


def measure(stand: Stand) -> ObserversResult:
    """Every observer under every error."""
    slow = stand.run(stand.sinusoid(TOP_SPEED, 40.0, 1.0))
    brisk = stand.run(stand.sinusoid(BRISK_SPEED, BRISK_PERIOD, 5.0))
    trials: list[Trial] = []
    for settings in (stand.control.observer, of_equal_delay(stand.control.observer)):
        right = _worse(stand, settings, INERTIA, 0.0, slow, brisk)
        for parameter in PARAMETERS:
            trials.append(replace(right, parameter=parameter))
            trials += [_worse(stand, settings, parameter, error, slow, brisk) for error in ERRORS if error]
    return ObserversResult(tuple(trials), _tracking(stand, None))


def of_equal_delay(observer: ObserverSettings) -> ObserverSettings:
    """The Kalman observer whose estimate is as late as that of a disturbance observer."""
    bandwidth = observer.bandwidth
    wanted = observer.filter_delay - observer.velocity_delay
    for _ in range(50):  # the delay is nearly in inverse proportion to the bandwidth
        bandwidth *= kalman_delay(observer.plant, bandwidth) / wanted
    return replace(observer, estimator=KALMAN, bandwidth=bandwidth)


def believing(observer: ObserverSettings, parameter: str, factor: float) -> ObserverSettings:
    """The observer with one parameter of its plant multiplied."""
    if parameter == TORQUE:
        return replace(observer, torque_scale=observer.torque_scale * factor)
    plant = observer.plant
    return replace(observer, plant=replace(plant, first=plant.first * factor))


def _worse(
    stand: Stand, right: ObserverSettings, parameter: str, error: float, slow: LoopRun, brisk: LoopRun
) -> Trial:
    signs = (1.0, -1.0) if error else (1.0,)
    wrong = [believing(right, parameter, 1.0 + sign * error) for sign in signs]
    expected = error * _disturbance(stand, right, parameter, brisk)
    return Trial(
        right.estimator,
        parameter,
        error,
        max(relative_error(item, slow) for item in wrong),
        max(relative_error(item, brisk) for item in wrong),
        float(np.hypot(relative_error(right, brisk), expected)),
        max(_tracking(stand, item) for item in wrong),
    )


def relative_error(observer: ObserverSettings, run: LoopRun) -> float:
    """RMS error of the estimate over rms of the friction, delay taken out, after SETTLE seconds."""
    period = float(run.t[1] - run.t[0])
    estimate = FrictionObserver(observer, period).over(run.torque, run.velocity)
    late, early = round(observer.filter_delay / period), round(SETTLE / period)
    truth = (run.friction + run.opposing)[early : len(run.t) - late]
    return _rms(estimate[early + late :] - truth) / _rms(truth)


def _disturbance(stand: Stand, observer: ObserverSettings, parameter: str, run: LoopRun) -> float:
    """RMS torque that 100 % of a parameter stands for, through the observer's filter, over rms of the friction."""
    period = float(run.t[1] - run.t[0])
    acceleration = np.gradient(run.reference_velocity, run.t)
    torque = run.torque if parameter == TORQUE else stand.axis.inertia * acceleration
    seen = FrictionObserver(observer, period).over(torque, np.zeros(len(run.t)))
    early = round(SETTLE / period)
    return _rms(seen[early:]) / _rms((run.friction + run.opposing)[early:])


def _tracking(stand: Stand, observer: ObserverSettings | None) -> float:
    if observer is not None:
        control = replace(stand.control, observer=observer)
        stand = replace(stand, file=replace(stand.file, control=control))
    reference: Reference = stand.tracking
    run = TrackingRun.of(stand.run(reference, feed_back=observer is not None))
    return run.errors(stand.settle).rms


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@drawn("observers", "Two observers of the same delay while a parameter of their nominal plant is wrong. Left: error of the "
       "estimate on a brisk run (1 deg/s, 4 s period). Right: tracking error with the estimate fed back.")  # fmt: skip
def draw(result: ObserversResult) -> Figure:
    """Estimates on the left, tracking on the right; the two observers nearly coincide, hence rings and dots."""
    figure, (left, right) = panels(1, 2, height=3.2, width=9.4)
    marks: dict[str, dict[str, Any]] = {
        DOB: {"marker": "o", "ms": 10, "mfc": "none", "mew": 1.6, "ls": "none"},
        KALMAN: {"marker": "o", "ms": 5, "ls": "none"},
    }
    for parameter in PARAMETERS:
        for observer, mark in marks.items():
            trials = result.at(observer, parameter)
            x = [100.0 * item.error for item in trials]
            name = NAMES[observer] if parameter == INERTIA else None
            left.plot(x, [100.0 * item.brisk for item in trials], color=COLORS[observer], label=name, **mark)
            right.plot(x, [item.tracking for item in trials], color=COLORS[observer], **mark)
        expected = [100.0 * item.expected for item in result.at(DOB, parameter)]
        left.plot(
            x, expected, color=MUTED, lw=1.0, zorder=1, label="expected" if parameter == INERTIA else None
        )
        at = (15.0, 0.75 * expected[-1])
        left.annotate(parameter, at, xytext=(-8, 5), textcoords="offset points", ha="right")
    right.axhline(result.without, color=MUTED, lw=1.2)
    right.annotate("without observer", (20.0, result.without), ha="right", va="bottom", color=MEASURED)
    for axes in (left, right):
        axes.set_xticks([100.0 * error for error in ERRORS])
    right.set_ylim(0.0, 1.2 * result.without)
    label(left, "error of the parameter (%)", "estimate's error (% of friction)")
    label(right, "error of the parameter (%)", "tracking error (arcsec rms)")
    left.legend(loc="upper left")
    return figure


def chapter(result: ObserversResult) -> Chapter:
    """Picture, table and what it says."""
    image = draw(result)
    head = [
        "parameter",
        "off by",
        *(f"{NAMES[o]}: {what}" for what in ("slow", "brisk", "tracking") for o in NAMES),
    ]
    rows = []
    for parameter in PARAMETERS:
        for k, error in enumerate(ERRORS):
            pair = [result.at(observer, parameter)[k] for observer in NAMES]
            shown = [f"{100 * item.slow:.2f} %" for item in pair] + [
                f"{100 * item.brisk:.2f} %" for item in pair
            ]
            rows.append(
                [parameter, f"{100 * error:.0f} %", *shown, *(f"{item.tracking:.4f}″" for item in pair)]
            )
    caption = "Estimate's relative rms error on slow zero crossings and on a brisk run; rms tracking error with feedback"
    html: Html = section(
        "Observers while the plant is not what they believe",
        picture(image),
        table(head, rows, caption),
        _words(result),
    )
    return Chapter(html, (image,))


def _words(result: ObserversResult) -> str:
    worst = {observer: result.at(observer, INERTIA)[-1] for observer in NAMES}
    slow, brisk = ([100 * getattr(worst[name], run) for name in (DOB, KALMAN)] for run in ("slow", "brisk"))
    return (
        "At the same delay the two answer such errors alike, as they must: either sees the torque that its nominal plant does "
        f"not explain. An inertia 20 % off costs {slow[0]:.1f} and {slow[1]:.1f} % on slow zero crossings, where friction is "
        f"measured, but {brisk[0]:.1f} and {brisk[1]:.1f} % where the axis accelerates; an error of the torque constant "
        "goes into the estimate whole. Fed back, either cuts the tracking error all the same: the loop around it integrates. "
        "Calibration against a dynamometer takes both errors away."
    )
