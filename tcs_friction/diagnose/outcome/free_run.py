"""The proof in motion: an axis model driven by the measured torque alone, beside what the axis really did.

A torque residual can be small where it does not matter and large where it does; a free run shows what a simulation with this
model is worth. Many windows of held-out data start from the measured state; the terms' memories (bristles, delay,
second body) are those that the measured motion up to there has left in them. What is stated comes from windows of untouched data.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numba import njit
from scipy import stats

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.conditioning.filters import through
from tcs_friction.numerics.runs import runs
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.machine import (
    CLOCK,
    LAST_MIDDLE,
    MASS,
    OTHERS,
    TRUE_ACCELERATION,
    TRUE_POSITION,
    TRUE_VELOCITY,
    Machine,
    advance,
    arrest_per_speed,
    call_term,
    torques,
)
from tcs_friction.physics.registry import alignment
from tcs_friction.physics.terms import (
    ACCELERATION,
    ARREST,
    INERTIA,
    POSITION,
    TIME,
    TORQUE,
    TRAVEL,
    VELOCITY,
    set_surroundings,
)

Kept = Literal["held_out", "untouched"]

HORIZON = 1.0  # s
HALVINGS = 4  # of the horizon at most, where two axes move alike
SHORTEST_PERIODS = 2.0  # of the cutoff, that such a horizon spans: within less, torque and motion hardly change
WINDOWS = 100  # at most, spread over the held-out data; more where they are shorter than HORIZON, so that all last as long
LONGEST_STEP = 1e-3  # s
MOST_PIECES = 1000  # steps between two samples
TINY = 1e-300  # rad, instead of no error, so that its logarithm exists
WINDOWS_WANTED = 8  # from which their scatter is known
FEWEST_WINDOWS = 3
BY_CHANCE = 0.01  # probability below which a difference is none of chance


def usable_horizon(data: DataSet, horizon: float = HORIZON, kept: Kept = "held_out") -> float:
    """The horizon (s), shorter where no stretch of what is kept is that long or few windows would fit; 0 where nothing is kept.

    Of untouched data one window does: nothing is chosen by their scatter.
    """
    step = data.dt / data.stride
    lengths = [b - a - 1 for mask in _kept(data, kept) for a, b in mask]
    wanted = WINDOWS_WANTED if kept == "held_out" else 1
    return min(horizon, max(lengths, default=0) * step, sum(lengths) * step / wanted)


def telling_horizon(data: DataSet, better: Axis, other: Axis) -> float:
    """The longest of the usable horizon (s) and its halves at which an axis strays less than another; the usable one if at none.

    Torque that nobody logged moves every model away: over long windows it hides what is fast, such as a resonance. Where an axis
    strays more over the usable horizon, shorter ones say nothing against that.
    """
    longest = usable_horizon(data)
    if better is other:
        return longest
    halves = longest * 0.5 ** np.arange(HALVINGS + 1)
    for horizon in halves[halves * data.cutoff >= SHORTEST_PERIODS]:
        one, two = (window_errors(data, axis, float(horizon)) for axis in (better, other))
        if moves_worse(two, one):
            return float(horizon)
        if horizon == longest and moves_worse(one, two):
            return longest
    return longest


def free_run(data: DataSet, axis: Axis, horizon: float = HORIZON) -> float:
    """The typical one of the `window_errors` (rad)."""
    return typical(window_errors(data, axis, horizon))


def typical(errors: np.ndarray) -> float:
    """Geometric mean of the errors (w,) of windows, 0 without any.

    Whether an axis just stops or just goes on hangs on what no model knows: a few windows in which it does the other thing would
    outweigh all others in a mean.
    """
    return float(np.exp(np.mean(np.log(np.maximum(errors, TINY))))) if len(errors) else 0.0


def moves_worse(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether a model's errors (w,) are larger than another's in the same windows by more than chance.

    Student's t of the logarithms of their ratios, of as many as are independent; of fewer than three windows nothing is said.
    """
    ratios = np.log(np.maximum(one, TINY) / np.maximum(other, TINY))
    if len(ratios) < FEWEST_WINDOWS:
        return False
    count = independent(ratios)
    scatter = max(float(ratios.std(ddof=1)) / math.sqrt(count), TINY)
    return bool(stats.t.sf(float(ratios.mean()) / scatter, count - 1.0) < BY_CHANCE)


def independent(series: np.ndarray) -> float:
    """How many independent values have as sure a mean as a series (n,) of values that resemble their neighbours; 2 at least.

    n / (1 + 2 sum of autocorrelations), summed in pairs while these are positive (Geyer 1992, initial positive sequence).
    """
    away, n = series - series.mean(), len(series)
    power = float(away @ away)
    if power <= 0.0:
        return float(n)
    correlation = np.correlate(away, away, "full")[n - 1 :] / power
    pairs = correlation[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    positive = pairs[: int(np.argmin(pairs > 0.0))] if (pairs <= 0.0).any() else pairs
    return min(max(n / max(2.0 * float(positive.sum()) - 1.0, 1.0), 2.0), float(n))


def window_errors(data: DataSet, axis: Axis, horizon: float = HORIZON, kept: Kept = "held_out") -> np.ndarray:
    """Rms (rad) of the position error within each window (w,) of `horizon` (s, or what fits) of held-out or untouched data.

    An error beyond the whole travel counts as the travel, so a model that runs away has a large error but a number. So does a
    model that is too fast to be followed: no axis is, whose motion was sampled like this.
    """
    step = data.dt / data.stride
    length = round(usable_horizon(data, horizon, kept) / step)
    if length < 1:
        return np.zeros(0)
    starts = kept_windows(data, length, kept)
    travel = float(np.ptp(data.joined("position")))
    pieces = max(1, math.ceil(step / min(LONGEST_STEP, 0.2 / axis.fastest_rate()) - 1e-9))
    if pieces > MOST_PIECES:
        return np.full(sum(map(len, starts)), travel)
    resolution, late = data.speed_resolution, axis.lateness
    axis = replace(axis, lateness=0.0)
    found: list[np.ndarray] = []
    for s, begins in zip(data.stretches, starts, strict=True):
        if not len(begins):
            continue
        compiled = machine.build(axis, step / pieces, signals=data.names, position=float(s.position[0]))
        errors = np.empty((len(begins), length))
        _walk(
            compiled,
            s.t,
            s.position,
            s.velocity,
            s.acceleration,
            acting_torque(s.torque, step, late),
            s.signals,
            resolution,
            pieces,
            begins,
            travel,
            errors,
        )
        found.append(np.sqrt(np.mean(errors**2, axis=1)))
    return np.concatenate([np.zeros(0), *found])


def acting_torque(torque: np.ndarray, step: float, late: float) -> np.ndarray:
    """A logged torque (n,), `step` s apart, when it acts: so much later, s; a negative time is no extrapolation but a filter."""
    response = alignment().transfer
    if late == 0.0 or response is None:
        return torque
    at = {alignment().alignment: late}
    return torque + through(torque - torque[0], step, lambda frequency: response(at, 2j * np.pi * frequency))


def kept_windows(data: DataSet, length: int, kept: Kept = "held_out") -> list[np.ndarray]:
    """First samples of windows of `length` samples of what is kept, for each stretch; at most some WINDOWS in all."""
    seconds = length * data.dt / data.stride
    return _windows(_kept(data, kept), length, round(WINDOWS * max(HORIZON / seconds, 1.0)))


def _kept(data: DataSet, kept: Kept) -> list[list[tuple[int, int]]]:
    """For each stretch the runs (first, last + 1) of evaluated samples that are kept, halts on the way among them."""
    return [
        [(a * data.stride, min((b - 1) * data.stride + 1, len(s.t))) for a, b in _blocks(s, getattr(s, kept), data.stride)]
        for s in data.stretches
    ]


def _blocks(s: Stretch, mask: np.ndarray, stride: int) -> list[tuple[int, int]]:
    """Runs (first, last + 1) of compared samples from one in a mask (m,) to another, with nothing but rest between them."""
    blocks = []
    for a, b in runs(mask | s.resting[::stride]):
        inside = np.flatnonzero(mask[a:b])
        if len(inside):
            blocks.append((int(a + inside[0]), int(a + inside[-1] + 1)))
    return blocks


def _windows(allowed: list[list[tuple[int, int]]], length: int, most: int) -> list[np.ndarray]:
    """First samples of the windows in each stretch: end to end, then every n-th so that at most so many are left."""
    begins = [[a + k * length for a, b in inside for k in range((b - a - 1) // length)] for inside in allowed]
    every = max(1, math.ceil(sum(map(len, begins)) / most))
    offset, result = 0, []
    for some in begins:
        result.append(np.array(some[(-offset) % every :: every], dtype=np.int64))
        offset += len(some)
    return result


@njit(cache=True, error_model="numpy", nogil=True)
def _walk(
    m: Machine,
    t: Any,
    position: Any,
    velocity: Any,
    acceleration: Any,
    torque: Any,
    signals: Any,
    resolution: float,
    pieces: int,
    begins: Any,
    cap: float,
    errors: Any,
) -> None:
    """Follow the measured motion in fine steps and let go at each of `begins`; errors (windows, length) in rad.

    The terms see the middle of each step, as in the integration that goes on from there: half a step between a shaft and a second
    body on a stiff contact is a torque.
    """
    motion, dt = m.motion, m.constants[machine.STEP]
    slope = arrest_per_speed(m, resolution)
    window, before, opposing = 0, 0.0, 0.0
    last = begins[-1]
    for i in range(last + 1):
        for piece in range(1 if i == 0 else pieces):
            part = 0.0 if i == 0 else (piece + 0.5) / pieces
            k = max(i - 1, 0)
            elapsed = dt if i > 0 else 0.0
            q = position[k] + part * (position[i] - position[k])
            v = velocity[k] + part * (velocity[i] - velocity[k])
            motion[TIME] = t[k] + part * (t[i] - t[k])
            motion[POSITION] = q
            error = _sensor_error(m, elapsed)
            if elapsed > 0.0:
                v -= (error - before) / elapsed
            before = error
            motion[TRAVEL] = 0.5 * (v + motion[VELOCITY]) * elapsed
            motion[POSITION] = q - error
            motion[VELOCITY] = v
            motion[ACCELERATION] = acceleration[k] + part * (acceleration[i] - acceleration[k])
            motion[INERTIA] = m.constants[MASS]
            motion[ARREST] = slope * v
            for s in range(signals.shape[0]):
                change = signals[s, i] - signals[s, k]
                set_surroundings(motion, s, signals[s, k] + part * change, change / (pieces * dt))
            motion[TORQUE] = torque[k] + part * (torque[i] - torque[k])
            for j in range(m.ends[0]):
                motion[TORQUE] = call_term(m, j, elapsed)
            _, opposing = torques(m, elapsed)
        if i == begins[window]:
            states, kept = m.states.copy(), motion.copy()
            motion[POSITION] = position[i]
            error = _sensor_error(m, 0.5 * dt)
            motion[POSITION] = position[i] - error
            motion[VELOCITY] = velocity[i] - 2.0 * (error - before) / dt
            motion[ACCELERATION] = acceleration[i]
            _let_go(m, i, opposing, t, position, torque, signals, pieces, cap, errors[window])
            m.states[:] = states
            motion[:] = kept
            window += 1


@njit(cache=True, error_model="numpy", inline="always")
def _sensor_error(m: Machine, dt: float) -> float:
    """What the sensors' terms add to the position in `m.motion`, rad."""
    error = 0.0
    for j in range(m.ends[4], m.ends[5]):
        error += call_term(m, j, dt)
    return error


@njit(cache=True, error_model="numpy", nogil=True)
def _let_go(
    m: Machine,
    begin: int,
    opposing: float,
    t: Any,
    position: Any,
    torque: Any,
    signals: Any,
    pieces: int,
    cap: float,
    errors: Any,
) -> None:
    """Integrate from the state in `m.motion` on with the measured torque."""
    motion, body = m.motion, m.body
    body[TRUE_POSITION] = motion[POSITION]
    body[LAST_MIDDLE] = motion[POSITION] - 0.5 * m.constants[machine.STEP] * motion[VELOCITY]
    body[TRUE_VELOCITY] = motion[VELOCITY]
    body[TRUE_ACCELERATION] = motion[ACCELERATION]
    motion[ACCELERATION] = 0.0
    body[OTHERS] = opposing
    body[CLOCK] = t[begin]
    for n in range(len(errors)):
        i = begin + n
        for piece in range(pieces):
            part = (piece + 0.5) / pieces
            for s in range(signals.shape[0]):
                change = signals[s, i + 1] - signals[s, i]
                set_surroundings(
                    motion, s, signals[s, i] + part * change, change / (pieces * m.constants[machine.STEP])
                )
            advance(m, torque[i] + part * (torque[i + 1] - torque[i]))
        motion[POSITION] = body[TRUE_POSITION]
        error = body[TRUE_POSITION] - position[i + 1] + _sensor_error(m, m.constants[machine.STEP])
        if not abs(error) < cap:
            errors[n:] = cap
            return
        errors[n] = error
