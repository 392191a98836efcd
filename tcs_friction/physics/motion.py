"""What a kernel is given and may change: the motion vector. And how a kernel is compiled.

SI units; for a linear axis read m, N and kg for rad, N m and kg m^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType
from typing import Any

from numba import float64, njit

# Slots of the motion vector. Recorded exogenous signals follow from EXOGENOUS on, in the order of their names: each its value,
# then its rate, both at the instant of the motion.
TIME = 0  # s since the start of the recording or run
POSITION = 1  # rad
VELOCITY = 2  # rad/s
ACCELERATION = 3  # rad/s^2; zero while simulating, where it is the result
TORQUE = 4  # N m, applied by the drive: as logged before the DRIVE terms, at the rotor after them
ARREST = 5  # N m, friction that would stop the axis within this step; what a law without bristles compares its level with
DRY = 6  # N m, dry part of the friction, written by the law
VISCOUS = 7  # N m, viscous part of the friction, written by the law
INERTIA = 8  # kg m^2, what moves rigidly with the shaft
CYCLE = 9  # rad of phase per unit of position at order 1: 1 for a rotary axis, 2 pi per metre for a linear one
TRAVEL = 10  # rad, moved since the previous instant
LEVEL = 11  # N m, dry friction available here and now (the scaled Stribeck curve), written by the law
MOBILISED = 12  # -1 to 1, share of LEVEL that is mobilised: the direction of motion once the axis slides
EXTRA_LEVEL = 13  # N m, added to the law's level by SCALE terms
DRY_SCALE = 14  # factor on the level, by SCALE terms
VISCOUS_SCALE = 15  # factor on the viscous part, by SCALE terms
TEMPERATURE = 16  # degC
EXOGENOUS = 17
PER_SIGNAL = 2  # slots of a recorded signal

SLOTS = MappingProxyType(
    {
        "time": TIME,
        "position": POSITION,
        "velocity": VELOCITY,
        "acceleration": ACCELERATION,
        "torque": TORQUE,
        "temperature": TEMPERATURE,
    }
)

KERNEL_SIGNATURE = float64(float64[::1], float64[::1], float64[::1], float64)

Kernel = Callable[[Any, Any, Any, float], float]


def kernel(function: Kernel) -> Kernel:
    """Compile a term's kernel with the one signature all of them share, so that any list of them runs unrecompiled."""
    compiled: Kernel = njit(KERNEL_SIGNATURE, cache=True, error_model="numpy")(function)
    return compiled


def signal_slot(index: int) -> int:
    """Slot of the value of recorded signal number `index`; its rate is in the one behind."""
    return EXOGENOUS + PER_SIGNAL * index


@njit(cache=True, error_model="numpy", inline="always")
def set_surroundings(motion: Any, s: int, value: float, rate: float) -> None:
    """Put row `s` of recorded surroundings (0: temperature, then the signals) and its rate (1/s) into the motion vector."""
    if s == 0:
        motion[TEMPERATURE] = value
    else:
        slot = EXOGENOUS + PER_SIGNAL * (s - 1)
        motion[slot], motion[slot + 1] = value, rate


@njit(cache=True, error_model="numpy")
def rate_at(series: Any, i: int, dt: float) -> float:
    """Time derivative at sample i of a series (n,) at steps of `dt`, s; 0 where dt is 0.

    A fourth-order central difference: at three samples a period it is still in phase, and 4 % too small at six. The ends have
    the differences of their order that fit.
    """
    last = len(series) - 1
    if dt <= 0.0 or last < 1:
        return 0.0
    if 2 <= i <= last - 2:
        return float((8.0 * (series[i + 1] - series[i - 1]) - series[i + 2] + series[i - 2]) / (12.0 * dt))
    before, after = max(i - 1, 0), min(i + 1, last)
    return float((series[after] - series[before]) / ((after - before) * dt))


@njit(cache=True, error_model="numpy")
def resolved(motion: Any, order: float) -> bool:
    """Whether less than half a period of a wave over the position was passed since the previous instant.

    A faster wave averages out over the step, while samples of it would look like a slow wave (aliasing).
    """
    return bool(abs(order * motion[CYCLE] * motion[TRAVEL]) < math.pi)
