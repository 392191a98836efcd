"""The controller that a recording shows: its effective gains by least squares, as far as it is a double-loop PID (`pid`).

With the reference speed fed forward, the two loops together make of the tracking error e a torque

    u = D (v_ref - v - a_ref delay) + P e + I integral(e) + J a_ref + B v_ref + constant

in which D = kp, P = kp Kp + ki, I = ki Kp of the gains in `pid`. A controller computes its torque from what it has measured, so
that noise of the encoder is no error here; what is left over is what the structure lacks. Blocks of the recording that are left
out in turn (jackknife, Efron 1982) say how sure the gains are, whatever the residual's spectrum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import stdtrit

from tcs_friction.control.pid import STATES, PidConfig, pid_parameters, pid_step
from tcs_friction.control.spread import CONTROLLER, Spread
from tcs_friction.physics.axis import Drive

Array = NDArray[np.float64]

DERIVATIVE, PROPORTIONAL, INTEGRAL, INERTIA, VISCOUS, CONSTANT = range(6)
GAINS = ("velocity_proportional", "position_proportional", "position_integral", "inertia_feedforward", "viscous_feedforward")
"""The settings of `PidConfig` that have the same effect: with no integrator in the speed loop, D, P / D, I / D, J and B."""
BLOCKS = 10
SURE = float(stdtrit(BLOCKS - 1, 0.95))
"""Standard errors by which a gain is greater than 0 with 95 %."""


@dataclass(frozen=True, eq=False)
class Run:
    """One stretch without a gap, each (n,): what a controller was given and measured, and what it commanded, SI units.

    reference: (n, 3), position, speed and acceleration. error: recorded reference less measured position. torque: the
    controller's own, without what was added to it.
    """

    t: Array
    reference: Array
    error: Array
    velocity: Array
    torque: Array


@dataclass(frozen=True)
class Shown:
    """The controller to predict with, how sure it is, and why it is this one.

    explained, by_file: share of the torque's variance, in the half of the recording that no gain was fitted to, that the gains
    fitted to the other half explain, and that the file's controller does. gains: D, P, I, J, B and their standard errors (5, 2).
    """

    controller: PidConfig
    spread: Spread
    estimated: bool
    explained: float
    by_file: float
    gains: Array


def filtered_speed(t: Array, position: Array, bandwidth: float) -> Array:
    """The speed (n,) that a controller makes of measured positions (n,): differences through a first-order filter.

    bandwidth: Hz, 0: none.
    """
    step = float(np.median(np.diff(t)))
    raw = np.diff(position, prepend=position[0]) / step
    decay = math.exp(-2.0 * math.pi * bandwidth * step) if bandwidth > 0.0 else 0.0
    return np.asarray(_smoothed(raw, decay))


def shown_by(run: Run, file: PidConfig, drive: Drive) -> Shown:
    """The gains that a run shows, or the file's controller where it explains the torque better, or all but the drive's noise.

    Half of the run tells them apart: gains that were fitted to the other half, and the file's controller fed with what was
    measured. Torque may stand at the instant from which it was computed or at the next one, whichever fits better. Gains that may
    be 0 are none: the structure does not fit.
    """
    tries = [_shown(_late(run, lag), file, drive) for lag in (0, 1)]
    return max(tries, key=lambda shown: max(shown.explained, shown.by_file))


def _late(run: Run, lag: int) -> Run:
    """The run with each torque beside what was measured so many samples before it."""
    end = len(run.t) - lag
    return Run(run.t[:end], run.reference[:end], run.error[:end], run.velocity[:end], run.torque[lag:])


def _shown(run: Run, file: PidConfig, drive: Drive) -> Shown:
    columns = _columns(run, file.velocity_delay)
    free = np.abs(run.torque) < min(drive.limit, file.torque_limit)
    half = len(run.t) // 2
    first, second = free.copy(), free.copy()
    first[half:] = second[:half] = False
    gains = _fitted(_moments(columns, run.torque, first))
    explained = _explained(run.torque - columns @ gains, run.torque, second)
    left = run.torque - _replayed(run, file)
    by_file = _explained(left, run.torque, second)
    final, covariance = _jackknife(columns, run.torque, free)
    table = np.column_stack([final, np.sqrt(np.diag(covariance))])[:CONSTANT]
    main = table[[DERIVATIVE, PROPORTIONAL]]
    known = bool(np.all(main[:, 0] > SURE * main[:, 1]))
    better = explained > max(by_file, 0.0) and float(np.std(left[second])) > drive.noise
    if not (known and better):
        return Shown(file, Spread(), False, explained, by_file, table)
    return Shown(_config(file, final), _spread(final, covariance), True, explained, by_file, table)


def _columns(run: Run, delay: float) -> Array:
    """(n, 6): what each gain is multiplied with."""
    _, speed, acceleration = run.reference.T
    steps = np.diff(run.t, prepend=run.t[0])
    integral = np.cumsum(steps * np.concatenate([[0.0], run.error[:-1]]))
    late = speed - run.velocity - delay * acceleration
    return np.column_stack([late, run.error, integral, acceleration, speed, np.ones(len(steps))])


def _moments(columns: Array, torque: Array, chosen: NDArray[np.bool_]) -> Array:
    """(7, 7) products of the columns and the torque with each other."""
    every = np.column_stack([columns, torque])[chosen]
    return np.asarray(every.T @ every)


def _fitted(moments: Array) -> Array:
    """Gains (6,), none of which is negative but the constant: those that would be are left out, as the structure has none."""
    size = np.sqrt(np.maximum(np.diag(moments), 1e-300))
    scaled = moments / np.outer(size, size)
    kept = list(range(CONSTANT + 1))
    while True:
        gains = np.zeros(CONSTANT + 1)
        gains[kept] = np.linalg.lstsq(scaled[np.ix_(kept, kept)], scaled[kept, -1], rcond=1e-12)[0]
        wrong = [k for k in (VISCOUS, INERTIA, INTEGRAL) if gains[k] < 0.0]
        if not wrong:
            return np.asarray(gains * size[-1] / size[:-1])
        kept.remove(wrong[0])


def _jackknife(columns: Array, torque: Array, free: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Gains (6,) of a whole run, and their covariance (6, 6)."""
    block = np.arange(len(torque)) * BLOCKS // len(torque)
    parts = [_moments(columns, torque, free & (block == k)) for k in range(BLOCKS)]
    whole = sum(parts, np.zeros_like(parts[0]))
    others = np.array([_fitted(whole - part) for part in parts])
    away = others - others.mean(axis=0)
    return _fitted(whole), (BLOCKS - 1) / BLOCKS * (away.T @ away)


def _config(file: PidConfig, gains: Array) -> PidConfig:
    return replace(file, velocity_integral=0.0, position_derivative=0.0, velocity_derivative=0.0, **_settings(gains))


def _settings(gains: Array) -> dict[str, float]:
    """The settings of `GAINS` that have these gains, (6,)."""
    derivative, proportional, integral, inertia, viscous = gains[:CONSTANT].tolist()
    return dict(zip(GAINS, (derivative, proportional / derivative, integral / derivative, inertia, viscous), strict=True))


def _spread(gains: Array, covariance: Array) -> Spread:
    derivative, proportional, integral = gains[:INERTIA]
    slopes = np.eye(CONSTANT)
    slopes[PROPORTIONAL, :INERTIA] = -proportional / derivative**2, 1.0 / derivative, 0.0
    slopes[INTEGRAL, :INERTIA] = -integral / derivative**2, 0.0, 1.0 / derivative
    own = covariance[:CONSTANT, :CONSTANT]
    return Spread(tuple((CONTROLLER, name) for name in GAINS), slopes @ own @ slopes.T)


def _explained(residual: Array, torque: Array, chosen: NDArray[np.bool_]) -> float:
    """Share of the variance; what an integrator had gathered before the run is no error."""
    whole = float(np.var(torque[chosen])) if chosen.any() else 0.0
    return 1.0 - float(np.var(residual[chosen])) / whole if whole > 0.0 else -math.inf


def _replayed(run: Run, file: PidConfig) -> Array:
    """(n,) torque of a controller that is fed with what was measured."""
    step = float(np.median(np.diff(run.t)))
    position = run.reference[:, 0] - run.error
    return np.asarray(_replay(pid_parameters(file, step), position, np.ascontiguousarray(run.velocity), run.reference))


@njit(cache=True)
def _replay(parameters: Array, position: Array, velocity: Array, reference: Array) -> Array:
    torque, state = np.empty(len(position)), np.zeros(STATES)
    for k in range(len(position)):
        q, v, a = reference[k]
        torque[k] = pid_step(state, parameters, position[k], velocity[k], q, v, a, 0.0)
    return torque


@njit(cache=True)
def _smoothed(raw: Array, decay: float) -> Array:
    speed, out = 0.0, np.empty(len(raw))
    for k in range(len(raw)):
        speed = decay * speed + (1.0 - decay) * raw[k]
        out[k] = speed
    return out
