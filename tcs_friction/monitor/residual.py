"""The torque residual of an axis that runs, in blocks of some ticks, with the parts of the model's torque beside it.

Position and torque pass the same low-pass filter; motion is its central differences. At each tick

    r = u_rotor - J a - F - x,

the balance of `diagnose.fit`, which walks through a whole recording without delay; this one is causal and one tick late.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import ACCELERATION as MOTION_ACCELERATION
from tcs_friction.physics.terms import (
    ARREST,
    DRY,
    INERTIA,
    MOBILISED,
    TEMPERATURE,
    TIME,
    TORQUE,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    set_surroundings,
)
from tcs_friction.physics.terms import POSITION as MOTION_POSITION

Array = NDArray[np.float64]

BLOCK = 0.02  # s
"""Length of a block: frequencies up to 20 Hz are seen."""
CORNER = 46.0  # Hz, of each of the four poles; together they halve the power at 20 Hz
SETTLING = 0.3  # s after a gap in which the filter forgets how it began: 1e-30 of it is left
USUAL_RESOLUTION = 1e-6  # rad/s, of the direction of motion, where the axis file does not know the encoder's noise
FULLY_SLIDING = 0.98  # share of the dry friction that is mobilised
RUNNING_IN = 0.1  # s after a reversal or rest in which what a model has wrong of presliding fades
SIGHTED = 5.0  # standard deviations of the speed's noise at which its direction is known

# Columns of a block: means over its ticks, unless said
END = 0  # s since the first tick, of the last one
RESIDUAL = 1  # N m
PLACE = 2  # rad
SPEED = 3  # rad/s
SLOWEST = 4  # rad/s, the smallest absolute speed of its ticks; 0 where the axis does not slide fully all through it
CONSTANT, DIRECTION, EXTRA, VISCOUS_PART, INERTIAL, OPPOSING, SURROUNDINGS = range(5, 12)
"""Torque of the model, N m: a constant of the size of its dry level; that level with the direction of motion; what dry friction
has beyond it; viscous friction; inertia; opposing torques; what temperature has made of it since the first tick."""
COLUMNS = 12
PARTS = slice(CONSTANT, COLUMNS)

_BEFORE, _AGE, _CLOCK, _COUNT, _RUN, _SUMS = 8, 11, 12, 13, 14, 15  # slots behind the two filters
_POLES = 4
# Settings of the kernel
_PERIOD, _POLE, _RESOLUTION, _LEVEL, _TICKS, _SETTLING, _RUNNING_IN, _COMPARED = range(8)


class Evaluator(NamedTuple):
    """An axis ready to be followed. Arrays are live."""

    axis: Any  # compiled.Machine
    unchanged: Any  # compiled.Machine, the same at the first temperature
    settings: Array
    state: Array


def evaluator(axis: Axis, period: float, signals: tuple[str, ...] = ()) -> Evaluator:
    """Follow an axis at ticks `period` (s) apart; `signals`: names of the recorded signals that act on it."""
    settings = np.array(
        [
            period,
            math.exp(-2.0 * math.pi * CORNER * period),
            direction_resolution(axis, period),
            axis.dry_level,
            ticks_per_block(period),
            math.ceil(SETTLING / period),
            math.ceil(RUNNING_IN / period),
            float(any(item.thermal for item in axis.effects)),
        ]
    )
    machine, unchanged = (compiled.build(axis, period, signals=signals) for _ in range(2))
    return Evaluator(machine, unchanged, settings, np.zeros(_SUMS + COLUMNS))


def ticks_per_block(period: float) -> int:
    """Ticks of `period` (s) in a block."""
    return max(1, round(BLOCK / period))


def direction_resolution(axis: Axis, period: float) -> float:
    """Speed (rad/s) below which the direction of motion is not known."""
    variance = axis.sensors.noise**2 + axis.sensors.resolution**2 / 12.0
    band = 0.435 * CORNER  # Hz, of four equal poles
    noise = math.sqrt(2.0 * period * variance * (2.0 * math.pi) ** 2 * band**3 / 3.0)
    return SIGHTED * noise or USUAL_RESOLUTION


@njit(cache=True, error_model="numpy", inline="always")
def _balance(m: Any, settings: Any, t: float, q: float, v: float, a: float, u: float) -> float:
    """The torque residual of one instant, N m. The machine's motion vector keeps the model's parts."""
    motion, dt = m.motion, settings[_PERIOD]
    q, v, a = compiled.true_instant(m, q, v, a, dt)
    motion[TIME] = t
    motion[TRAVEL] = 0.5 * (v + motion[VELOCITY]) * dt
    motion[MOTION_POSITION], motion[VELOCITY], motion[MOTION_ACCELERATION] = q, v, a
    motion[INERTIA] = m.constants[compiled.MASS]
    motion[ARREST] = compiled.arrest_per_speed(m, settings[_RESOLUTION]) * v
    compiled.rotor_torque(m, u, dt)
    friction, opposing = compiled.torques(m, dt)
    m.body[compiled.FRICTION], m.body[compiled.OTHERS] = friction, opposing
    return float(motion[TORQUE] - motion[INERTIA] * a - friction - opposing)


@njit(cache=True, error_model="numpy", inline="always")
def _surround(m: Any, surroundings: Any) -> None:
    """Put temperature, then each signal's value and rate into the motion vector."""
    set_surroundings(m.motion, 0, surroundings[0], 0.0)
    for s in range(1, len(surroundings), 2):
        set_surroundings(m.motion, (s + 1) // 2, surroundings[s], surroundings[s + 1])


@njit(cache=True, error_model="numpy", inline="always")
def _add(e: Any, q: float, v: float, residual: float, unchanged: float) -> None:
    """One instant into the sums of the open block."""
    sums, motion, level = e.state[_SUMS:], e.axis.motion, e.settings[_LEVEL]
    share = motion[MOBILISED]
    if e.state[_COUNT] == 0.0:
        sums[:] = 0.0
        sums[SLOWEST] = abs(v)
    slides = share * v > 0.0 and abs(share) >= FULLY_SLIDING and e.state[_AGE] > e.settings[_SETTLING]
    e.state[_RUN] = e.state[_RUN] + 1.0 if slides else 0.0
    sums[SLOWEST] = min(sums[SLOWEST], abs(v)) if e.state[_RUN] > e.settings[_RUNNING_IN] else 0.0
    sums[RESIDUAL] += residual
    sums[PLACE] += q
    sums[SPEED] += v
    sums[CONSTANT] += level
    sums[DIRECTION] += level * share
    sums[EXTRA] += motion[DRY] - level * share
    sums[VISCOUS_PART] += motion[VISCOUS]
    sums[INERTIAL] += motion[INERTIA] * motion[MOTION_ACCELERATION]
    sums[OPPOSING] += e.axis.body[compiled.OTHERS]
    sums[SURROUNDINGS] += unchanged - residual


@njit(cache=True, error_model="numpy")
def follow(e: Any, position: Any, torque: Any, surroundings: Any, out: Any) -> int:
    """Ticks (n,) of position (rad) and of the torque (N m) held until each; `out` gets a row for each block that ends.

    `surroundings` (n, 1 + 2 s): temperature (degC), then each signal's value and rate. Returns the number of rows.
    """
    state, settings, rows = e.state, e.settings, 0
    pole, dt, ticks = settings[_POLE], settings[_PERIOD], settings[_TICKS]
    for i in range(len(position)):
        if state[_AGE] == 0.0:
            state[:_POLES], state[_POLES:_BEFORE] = position[i], torque[i]
            state[_BEFORE], state[_BEFORE + 1], state[_BEFORE + 2] = position[i], position[i], torque[i]
            e.axis.motion[MOTION_POSITION] = e.unchanged.motion[MOTION_POSITION] = position[i]
        if state[_CLOCK] == 0.0:
            e.unchanged.motion[TEMPERATURE] = surroundings[i, 0]
        y, u = position[i], torque[i]
        for k in range(_POLES):
            y = state[k] = pole * state[k] + (1.0 - pole) * y
            u = state[_POLES + k] = pole * state[_POLES + k] + (1.0 - pole) * u
        before, middle = state[_BEFORE], state[_BEFORE + 1]
        v, a = (y - before) / (2.0 * dt), (y - 2.0 * middle + before) / (dt * dt)
        held = 0.5 * (state[_BEFORE + 2] + u)
        state[_BEFORE], state[_BEFORE + 1], state[_BEFORE + 2] = middle, y, u
        state[_AGE] += 1.0
        state[_CLOCK] += dt
        first = e.unchanged.motion[TEMPERATURE]
        _surround(e.axis, surroundings[i])
        residual = unchanged = _balance(e.axis, settings, state[_CLOCK], middle, v, a, held)
        if settings[_COMPARED] > 0.0:
            _surround(e.unchanged, surroundings[i])
            e.unchanged.motion[TEMPERATURE] = first
            unchanged = _balance(e.unchanged, settings, state[_CLOCK], middle, v, a, held)
        _add(e, middle, v, residual, unchanged)
        state[_COUNT] += 1.0
        if state[_COUNT] >= ticks:
            out[rows] = state[_SUMS:] / ticks
            out[rows, END] = state[_CLOCK]
            out[rows, SLOWEST] = state[_SUMS + SLOWEST]
            state[_COUNT] = 0.0
            rows += 1
    return rows


def interrupt(e: Evaluator, span: float = 0.0) -> None:
    """What comes next does not follow what came: the filter begins anew, `span` (s) later; the open block is dropped."""
    e.state[_AGE] = e.state[_COUNT] = 0.0
    e.state[_CLOCK] += span
    for m in (e.axis, e.unchanged):
        m.states[:] = 0.0
        m.motion[VELOCITY] = 0.0


def clock(e: Evaluator) -> float:
    """s since the first tick."""
    return float(e.state[_CLOCK])
