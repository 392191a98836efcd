"""Blocks of an axis that moves at random, made of numbers alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcs_friction.monitor.residual import (
    BLOCK,
    COLUMNS,
    CONSTANT,
    DIRECTION,
    END,
    INERTIAL,
    PLACE,
    RESIDUAL,
    SLOWEST,
    SPEED,
    VISCOUS_PART,
)

Array = NDArray[np.float64]
LEVEL, VISCOUS, INERTIA, NOISE = 80.0, 500.0, 1000.0, 0.2


def blocks(seconds: float, seed: int = 0, begin: float = 0.0) -> Array:
    """Blocks (n, COLUMNS) of an axis whose residual is white noise."""
    rng = np.random.default_rng(seed)
    t = begin + BLOCK * np.arange(1, round(seconds / BLOCK) + 1)
    rows = np.zeros((len(t), COLUMNS))
    frequency, phase = 2.0 * np.pi / np.array([17.0, 43.0, 71.0]), rng.uniform(0.0, 2.0 * np.pi, 3)
    amplitude = np.array([0.02, 0.05, 0.15])
    angle = frequency * t[:, None] + phase
    q, v, a = (f @ amplitude for f in (np.sin(angle), frequency * np.cos(angle), -(frequency**2) * np.sin(angle)))
    rows[:, END], rows[:, PLACE], rows[:, SPEED] = t, q, v
    rows[:, SLOWEST] = np.where(np.abs(v) > 5e-4, np.abs(v), 0.0)
    rows[:, CONSTANT], rows[:, DIRECTION] = LEVEL, LEVEL * np.sign(v)
    rows[:, VISCOUS_PART], rows[:, INERTIAL] = VISCOUS * v, INERTIA * a
    rows[:, RESIDUAL] = NOISE * rng.standard_normal(len(t))
    return rows
