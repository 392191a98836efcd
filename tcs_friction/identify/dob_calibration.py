"""Calibration of a friction observer against a dynamometer (paper section 5.2): torque scale, offset, nominal inertia.

The observer is linear in what it is told: with Q its own filter, friction = Q(scale torque + offset - inertia acceleration).
Where the axis moves uniformly, dynamometer and observer measure the same torque whatever the inertia; that gives scale and
offset. What is left elsewhere in proportion to the acceleration gives the inertia. The delay of Q is known and taken out; that
of the dynamometer, whose readings come over a serial line, is searched for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from tcs_friction.control.observer import Array, FrictionObserver, NominalPlant
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import InputError
from tcs_friction.identify.result import finite
from tcs_friction.recording.recording import Recording

DYNAMOMETER = "dynamometer"
"""Name of the dynamometer among a recording's exogenous signals."""
LEAST_UNIFORM = 1.0  # s of uniform motion
SETTLE = 1.0  # s at the start of a recording in which filters and bristles settle
LONGEST_DELAY = 0.3  # s of the dynamometer
HARDLY = 0.01  # of the friction: an inertial torque that says nothing of the inertia
BLOCK = 0.2  # s over which errors count as one


@dataclass(frozen=True, eq=False)
class Comparison:
    """One recording of an axis with a dynamometer on it, each (n,), on one regular time base.

    t s, torque as logged and dynamometer N m (positive against positive motion), velocity rad/s.
    """

    t: Array
    torque: Array
    velocity: Array
    dynamometer: Array
    source: str = "recording"

    def __post_init__(self) -> None:
        for name in ("t", "torque", "velocity", "dynamometer"):
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if values.shape != np.shape(self.t) or not np.isfinite(values).all():
                raise InputError(
                    self.source, f"{name} of shape {values.shape} or not finite", f"({len(self.t)},), finite"
                )
            object.__setattr__(self, name, values)
        if len(self.t) < 2 or self.t[-1] - self.t[0] < 2.0 * SETTLE:
            raise InputError(self.source, "too short a recording", f"at least {2.0 * SETTLE:g} s")

    @property
    def period(self) -> float:
        """s between samples."""
        return float(np.median(np.diff(self.t)))


@dataclass(frozen=True, eq=False)
class Calibration:
    """What was found, and how near observer and dynamometer come (1 less the relative rms error; the paper: 0.9694).

    observer: the settings with torque_scale, torque_offset (N m) and inertia as found. scale_std, offset_std, inertia_std:
    standard deviations; offset_std and inertia_std are nan where the motion does not show them and the old value was kept.
    dynamometer_delay: s by which its readings are late. accuracy_before, accuracy: over everything, accuracy_uniform: in uniform
    motion. t, measured, before, after, uniform: (n,) of all recordings one after the other, for pictures.
    """

    observer: ObserverSettings
    scale_std: float
    offset_std: float
    inertia_std: float
    dynamometer_delay: float
    accuracy_before: float
    accuracy_uniform: float
    accuracy: float
    t: Array
    measured: Array
    before: Array
    after: Array
    uniform: np.ndarray
    notes: tuple[str, ...] = ()

    def to_mapping(self) -> dict[str, Any]:
        """The content of `calibration.json`."""
        plant = self.observer.plant
        return {
            "schema": "tcs_friction/calibration/1",
            "torque_scale": {"value": self.observer.torque_scale, "std": self.scale_std, "unit": "1"},
            "torque_offset": {
                "value": self.observer.torque_offset,
                "std": finite(self.offset_std),
                "unit": "N m",
            },
            "inertia": {"value": plant.first, "std": finite(self.inertia_std), "unit": "kg m^2"},
            "dynamometer_delay": self.dynamometer_delay,
            "accuracy": {
                "before": self.accuracy_before,
                "uniform_motion": self.accuracy_uniform,
                "everything": self.accuracy,
            },
            "uniform_share": float(self.uniform.mean()),
            "notes": list(self.notes),
        }


def comparisons_of(recording: Recording) -> list[Comparison]:
    """Every stretch of a recording that is long enough, on a regular time base; the dynamometer is its exogenous signal.

    Raises InputError when none is.
    """
    if DYNAMOMETER not in recording.exogenous:
        raise InputError(
            recording.source, "no usable reading of the dynamometer", "; ".join(recording.notes[-1:])
        )
    found: list[Comparison] = []
    velocity = np.empty(len(recording.t)) if recording.velocity is None else recording.velocity
    for part in recording.segments:
        t = recording.t[part]
        if len(t) < 2 or t[-1] - t[0] < 2.0 * SETTLE:
            continue
        if recording.velocity is None:
            velocity[part] = np.gradient(recording.position[part], t)
        period = float(np.median(np.diff(t)))
        grid = t[0] + period * np.arange(int((t[-1] - t[0]) / period + 1e-6) + 1)
        torque, speed, reading = (
            np.interp(grid, t, values[part])
            for values in (recording.torque, velocity, recording.exogenous[DYNAMOMETER])
        )
        found.append(Comparison(grid, torque, speed, reading, recording.source))
    if not found:
        raise InputError(recording.source, "every stretch is too short", f"{2.0 * SETTLE:g} s without a gap")
    return found


def uniform_motion(t: Array, velocity: Array, seconds: float = 0.5, tolerance: float = 0.05) -> np.ndarray:
    """(n,) True where the velocity stays within `tolerance` of its mean over `seconds` around, and the axis does move.

    The velocity is averaged over a fifth of that time first: sensors are noisy where the motion is not.
    """
    width = max(3, int(seconds / float(np.median(np.diff(t)))))
    if len(t) <= width:
        return np.zeros(len(t), dtype=bool)
    smooth = uniform_filter1d(velocity, max(1, width // 5))
    mean = uniform_filter1d(velocity, width)
    spread = maximum_filter1d(smooth, width) - minimum_filter1d(smooth, width)
    result = (spread <= tolerance * np.abs(mean)) & (np.abs(mean) > 0.02 * np.abs(smooth).max())
    result[: width // 2] = result[len(t) - width // 2 :] = False
    return np.asarray(result)


def calibrate(comparisons: Sequence[Comparison], observer: ObserverSettings) -> Calibration:
    """Scale and offset of the torque and the nominal inertia that make the observer read what the dynamometer does.

    Raises InputError when there is too little uniform motion in the recordings.
    """
    if not comparisons:
        raise InputError("calibration", "no recording", "at least one")
    seen = [_Seen(item, observer) for item in comparisons]
    delay = _dynamometer_delay(seen)
    parts = [item.columns(delay) for item in seen]
    torque, inertia, fixed, target, before, acceleration, times, uniform = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    uniform = uniform > 0.0
    period = comparisons[0].period
    if np.count_nonzero(uniform) * period < LEAST_UNIFORM:
        found = f"{np.count_nonzero(uniform) * period:.2g} s of uniform motion"
        raise InputError("calibration", found, f"at least {LEAST_UNIFORM:g} s at constant speed")
    notes: list[str] = []
    wanted = target + fixed + inertia * observer.plant.first
    scale, offset, scale_std, offset_std = _torque_fit(
        torque, wanted, uniform, period, observer.torque_offset, notes
    )
    first, first_std = observer.plant.first, np.nan
    others = ~uniform
    if others.any() and _rms(acceleration[others]) * first > HARDLY * _rms(target):
        rest = scale * torque + offset - fixed - target
        (first,), (first_std,) = _fitted(inertia[:, None], rest, others, period)
    else:
        notes.append("the recordings hardly accelerate: the inertia was left as it was")
    after = scale * torque + offset - fixed - first * inertia
    plant = replace(observer.plant, first=float(first))
    settings = replace(observer, plant=plant, torque_scale=float(scale), torque_offset=float(offset))
    settings.validate("calibration")
    return Calibration(
        settings, float(scale_std), float(offset_std), float(first_std), delay,
        accuracy(target, before), accuracy(target[uniform], after[uniform]), accuracy(target, after),
        times, target, before, after, uniform, tuple(notes),
    )  # fmt: skip


def _torque_fit(
    torque: Array, wanted: Array, uniform: np.ndarray, period: float, known_offset: float, notes: list[str]
) -> tuple[float, float, float, float]:
    """Scale and offset from uniform motion, and their standard deviations; the offset only where motion was both ways."""
    if np.ptp(np.sign(torque[uniform])) > 0.0:
        design = np.column_stack([torque, np.ones(len(torque))])
        (scale, offset), (scale_std, offset_std) = _fitted(design, wanted, uniform, period)
        return scale, offset, scale_std, offset_std
    notes.append("uniform motion one way only: an offset cannot be told from a scale and was left as it was")
    (scale,), (scale_std,) = _fitted(torque[:, None], wanted - known_offset, uniform, period)
    return scale, known_offset, scale_std, np.nan


def accuracy(measured: Array, estimate: Array) -> float:
    """1 less the rms of the error over the rms of what was measured."""
    return 1.0 - _rms(measured - estimate) / _rms(measured)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


class _Seen:
    """A recording as the observer sees it; everything that passes Q is Q's delay later than what it belongs to."""

    def __init__(self, item: Comparison, observer: ObserverSettings) -> None:
        period = item.period
        zero = np.zeros(len(item.t))
        plain = replace(observer, torque_scale=1.0, torque_offset=0.0)

        def answer(plant: NominalPlant) -> Array:
            return -FrictionObserver(replace(plain, plant=plant), period).over(zero, item.velocity)

        least = 1e-12  # kg m^2: none
        self.item, self.period = item, period
        self.late, self.early = round(observer.filter_delay / period), round(SETTLE / period)
        self.torque = FrictionObserver(plain, period).over(item.torque, zero)
        self.inertia = answer(NominalPlant(first=1.0))  # torque of 1 kg m^2
        self.fixed = answer(NominalPlant(observer.plant.second, least, 0.0))
        viscous = answer(NominalPlant(0.0, least, observer.plant.constant))
        # the observer leaves out the viscous friction that its plant holds, the dynamometer does not
        self.before = FrictionObserver(observer, period).over(item.torque, item.velocity) + viscous
        smooth = uniform_filter1d(item.velocity, max(1, round(0.05 / period)))
        self.acceleration = np.gradient(smooth, item.t)
        self.uniform = uniform_motion(item.t, item.velocity).astype(np.float64)

    def columns(self, delay: float) -> tuple[Array, ...]:
        """Q(torque), Q(acceleration), the rest of the plant, the dynamometer, estimate, acceleration, t, uniform: each (m,)."""
        stop = len(self.item.t) - max(self.late, round(delay / self.period))
        now, then = slice(self.early, stop), slice(self.early + self.late, stop + self.late)
        t = self.item.t
        target = np.interp(t[now] + delay, t, self.item.dynamometer)
        return (
            self.torque[then], self.inertia[then], self.fixed[then], target, self.before[then],
            self.acceleration[now], t[now], self.uniform[now],
        )  # fmt: skip


def _fitted(design: Array, target: Array, keep: np.ndarray, period: float) -> tuple[Array, Array]:
    """Least squares over the samples kept, and standard deviations for errors that are alike within BLOCK seconds."""
    chosen, wanted = design[keep], target[keep]
    solution = np.linalg.lstsq(chosen, wanted, rcond=None)[0]
    residual = wanted - chosen @ solution
    alike = max(1.0, BLOCK / period)
    scatter = float(residual @ residual) / max(len(residual) - len(solution), 1) * alike
    return solution, np.sqrt(np.diag(scatter * np.linalg.inv(chosen.T @ chosen)))


def _dynamometer_delay(seen: Sequence[_Seen]) -> float:
    """s by which the readings are late: where observer and dynamometer fit best, 0 where the motion does not show it.

    It shows at reversals. Found by ever finer steps around the best so far.
    """

    def error(delay: float) -> float:
        squares = count = 0.0
        for item in seen:
            torque, inertia, fixed, target, *_ = item.columns(delay)
            target = target + fixed
            design = np.column_stack([torque, inertia, np.ones(len(torque))])
            residual = target - design @ np.linalg.lstsq(design, target, rcond=None)[0]
            squares, count = squares + float(residual @ residual), count + len(residual)
        return squares / count

    step, best = 0.05, 0.0
    trials = step * np.arange(-1, round(LONGEST_DELAY / step) + 1)
    errors = [error(delay) for delay in trials]
    if max(errors) < 1.1 * min(errors):
        return 0.0
    best = float(trials[int(np.argmin(errors))])
    while step > seen[0].period:
        step *= 0.4
        trials = best + step * np.arange(-2, 3)
        best = float(trials[int(np.argmin([error(delay) for delay in trials]))])
    return best
