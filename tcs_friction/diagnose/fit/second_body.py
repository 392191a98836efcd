"""Bodies that swing on an axis: what an acceleration of the axis requires for them."""

from __future__ import annotations

import math

import numpy as np

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance


def swinging(axis: Axis) -> list[Instance]:
    """Effects that are bodies with a linear response."""
    return [item for item in axis.effects if item.term.swings]


def motion_gain(axis: Axis, frequency: np.ndarray) -> np.ndarray:
    """Torque that an acceleration of the axis requires over that of its inertia alone, complex, at frequencies (n,), Hz."""
    s = 2j * math.pi * frequency
    gain = np.ones(len(s), dtype=complex)
    for item in swinging(axis):
        assert item.term.transfer is not None
        gain += item.term.transfer(item.values, s)
    return gain
