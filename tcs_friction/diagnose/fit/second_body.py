"""What an acceleration of an axis moves: its inertia at each position, and second bodies that resonate with it.

In: an axis. Out: the logarithm of its inertia over positions, and the gain 1 + sum_i G_i(j 2 pi f) of the required torque over
J a, with the transfer function G_i of each body.
"""

from __future__ import annotations

import math

import numpy as np

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance


def resonant_bodies(axis: Axis) -> list[Instance]:
    """Effects that are second bodies with a linear response."""
    return [item for item in axis.effects if item.term.resonates]


def motion_gain(axis: Axis, frequency: np.ndarray) -> np.ndarray:
    """Torque that an acceleration of the axis requires over that of its inertia alone, complex, at frequencies (n,), Hz."""
    s = 2j * math.pi * frequency
    gain = np.ones(len(s), dtype=complex)
    for item in resonant_bodies(axis):
        assert item.term.transfer is not None
        gain += item.term.transfer(item.values, s)
    return gain


def log_inertia(axis: Axis, position: np.ndarray) -> float:
    """Mean logarithm of the inertia that moves at positions (n,)."""
    factors = [x.term.inertia_over(x.values, axis.cycle * position) for x in axis.effects if x.term.inertia_over is not None]
    return math.log(axis.inertia) + float(sum(np.mean(np.log(factor)) for factor in factors))
