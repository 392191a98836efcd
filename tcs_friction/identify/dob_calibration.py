"""Calibration of a disturbance observer against a dynamometer (paper section 5.2): gain, offset, inertia, accuracy.

Where the axis moves uniformly, dynamometer and observer measure the same torque; a gain and an offset make them agree.
Elsewhere what is left in proportion to the acceleration is an error of the observer's nominal inertia.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError

LEAST_UNIFORM = 20  # samples of uniform motion


@dataclass(frozen=True)
class Calibration:
    """measured = gain estimate + offset + inertia_error acceleration.

    gain (1), offset (N m), inertia_error (kg m^2): to be added to the nominal inertia times gain.
    accuracy: 1 less the relative rms error after calibration, in uniform motion and over everything (the paper: 0.9694).
    uniform: share of the samples in uniform motion.
    """

    gain: float
    gain_std: float
    offset: float
    offset_std: float
    inertia_error: float
    accuracy_before: float
    accuracy_uniform: float
    accuracy: float
    uniform: float

    def corrected(self, estimate: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """(n,) N m: the observer's estimates as the dynamometer would have measured them."""
        return np.asarray(self.gain * estimate + self.offset + self.inertia_error * acceleration)


def uniform_motion(
    t: np.ndarray, velocity: np.ndarray, seconds: float = 0.5, tolerance: float = 0.05
) -> np.ndarray:
    """(n,) True where the velocity stays within `tolerance` of its mean over `seconds` around, and the axis does move."""
    half = max(1, int(0.5 * seconds / float(np.median(np.diff(t)))))
    if len(t) <= 2 * half + 1:
        return np.zeros(len(t), dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(velocity, 2 * half + 1)
    mean = windows.mean(axis=1)
    steady = np.ptp(windows, axis=1) <= tolerance * np.abs(mean)
    result = np.zeros(len(t), dtype=bool)
    result[half : len(t) - half] = steady & (np.abs(mean) > 0.02 * np.abs(velocity).max())
    return result


def calibrate(
    t: np.ndarray, velocity: np.ndarray, estimate: np.ndarray, measured: np.ndarray, lag: float = 0.0
) -> Calibration:
    """Calibrate an observer's `estimate` (n,) by a dynamometer's `measured` (n,), N m, on one time base.

    `lag`: delay of the observer's filter, s, taken out first.

    Raises InputError when there is too little uniform motion in the recording.
    """
    prompt = np.interp(t + lag, t, estimate)
    steady = uniform_motion(t, velocity)
    if np.count_nonzero(steady) < LEAST_UNIFORM:
        found = f"{np.count_nonzero(steady)} samples of uniform motion"
        raise InputError("calibration", found, f"at least {LEAST_UNIFORM}")
    design = np.column_stack([prompt[steady], np.ones(np.count_nonzero(steady))])
    both_ways = np.ptp(np.sign(velocity[steady])) > 0.0
    if not both_ways:  # an offset cannot be told from a gain at one level of friction
        design = design[:, :1]
    solution = np.linalg.lstsq(design, measured[steady], rcond=None)[0]
    residual = measured[steady] - design @ solution
    blocks = max(1, len(residual) // 50)  # neighbouring samples are not independent
    scatter = float(residual @ residual) / max(len(residual) - 2, 1) * (len(residual) / blocks)
    deviation = np.sqrt(np.diag(scatter * np.linalg.inv(design.T @ design)))
    gain, offset = float(solution[0]), float(solution[1]) if both_ways else 0.0
    acceleration = np.gradient(velocity, t)
    kept = t <= t[-1] - lag
    rest = (measured - gain * prompt - offset)[kept]
    power = float(acceleration[kept] @ acceleration[kept])
    inertia = float(acceleration[kept] @ rest) / power if power > 0.0 else 0.0
    final = rest - inertia * acceleration[kept]
    return Calibration(
        gain,
        float(deviation[0]),
        offset,
        float(deviation[1]) if both_ways else 0.0,
        inertia,
        accuracy(measured, estimate),
        1.0 - _rms(final[steady[kept]]) / _rms(measured[steady]),
        1.0 - _rms(final) / _rms(measured[kept]),
        float(steady.mean()),
    )


def accuracy(measured: np.ndarray, estimate: np.ndarray) -> float:
    """1 less the rms of the error over the rms of what was measured."""
    return 1.0 - _rms(measured - estimate) / _rms(measured)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
