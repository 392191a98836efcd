"""The encoder's known errors are taken from the measured position and speed before controller and observer use them.

    q = q_m - e(q),   v = v_m / (1 + de/dq)

with the kernels that simulate the errors e, by a few steps of fixed-point iteration: an error is small against its period.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.control.model_compensator import effect_names, follow, rise_per_tick
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.machine import MEASURED, STEP, Machine, build, sensor_error
from tcs_friction.physics.terms import TRAVEL, Place

Array = NDArray[np.float64]

PASSES = 3  # each is nearer by the error's slope


@njit(cache=True, error_model="numpy")
def correct(m: Machine, shares: Array, wanted: Array, rise: float, position: float, velocity: float) -> tuple[float, float]:
    """One tick: position and speed without the errors' shares. Shares follow `wanted` by at most `rise`."""
    first = math.isnan(m.body[MEASURED])
    m.motion[TRAVEL] = 0.0 if first else position - m.body[MEASURED]
    m.body[MEASURED] = position
    follow(shares, wanted, rise, first)
    true, slope = position, 0.0
    for _ in range(PASSES):
        error, slope = 0.0, 0.0
        for k in range(len(shares)):
            own = sensor_error(m, k, true, m.constants[STEP])
            error += shares[k] * own[0]
            slope += shares[k] * own[1]
        true = position - error
    return true, velocity / (1.0 + slope)


class PositionCorrection:
    """The correction by the sensor terms of an axis model, one `step` a tick of `dt` seconds."""

    def __init__(self, model: Axis, dt: float) -> None:
        self.effects = {name: item for name, item in effect_names(model).items() if item.term.place is Place.SENSOR}
        """What is corrected, by name."""
        self.model, self.dt = model, dt
        self.machine = build(model, dt, terms=list(self.effects.values()))
        self.shares, self.wanted = np.zeros(len(self.effects)), np.ones(len(self.effects))
        self.rise = 1.0
        self.reset()

    def configure(self, left_out: Collection[str], entry_time: float) -> None:
        """Other effects left out, by name, from the next tick on; each comes and goes within `entry_time` (s)."""
        self.wanted[:] = [0.0 if name in left_out else 1.0 for name in self.effects]
        self.rise = rise_per_tick(self.dt, entry_time)

    def reset(self) -> None:
        """Forget the past."""
        self.machine.body[MEASURED] = math.nan

    def step(self, position: float, velocity: float) -> tuple[float, float]:
        """Position (rad) and speed (rad/s) of the axis, from the measured ones."""
        corrected: tuple[float, float] = correct(self.machine, self.shares, self.wanted, self.rise, position, velocity)
        return corrected
