"""Input shaping: a reference that leaves a lightly damped mode at rest.

The shaped reference is a weighted sum of delayed ones, half a period of the mode apart. The oscillations that they excite
cancel: none is left once the last one has begun. A ZV shaper has two impulses and is exact for the frequency it is made for;
a ZVD shaper has three and tolerates an error of the frequency, to first order. (Singer and Seering 1990, Preshaping command
inputs to reduce system vibration, J. Dyn. Syst. Meas. Control 112, 76-82.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.config_field import choice, setting

Array = NDArray[np.float64]

NONE, ZV, ZVD = "none", "zv", "zvd"


@dataclass(frozen=True)
class Shaper:
    """Which oscillation the reference does not excite: that of the second body while the shaft is held, for a flexible mode."""

    kind: str = choice(NONE, (NONE, ZV, ZVD), "shaper: none, of two impulses (zv), of three (zvd: tolerates a wrong frequency)")
    frequency: float = setting(10.0, "Hz", 1e-3, 1e4, "undamped frequency of the oscillation")
    damping: float = setting(0.01, "", 0.0, 0.99, "damping ratio of the oscillation")

    def impulses(self) -> Array:
        """Shape (n, 2): weight and delay (s) of each impulse; none without a shaper. The weights' sum is 1."""
        if self.kind == NONE:
            return np.empty((0, 2))
        root = math.sqrt(1.0 - self.damping**2)
        decay = math.exp(-math.pi * self.damping / root)  # over half a period
        half = 0.5 / (self.frequency * root)
        weights = np.array([1.0, decay] if self.kind == ZV else [1.0, 2.0 * decay, decay**2])
        return np.column_stack([weights / weights.sum(), half * np.arange(len(weights))])

    @property
    def delay(self) -> float:
        """By how much the shaped reference comes later on average, s."""
        impulses = self.impulses()
        return float(impulses[:, 0] @ impulses[:, 1])
