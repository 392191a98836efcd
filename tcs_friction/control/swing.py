"""How far a body on a spring swings while the shaft that carries it moves.

A module of its own: scipy.signal is slow to load, and the nodes of the control loop do without it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]


def swing(position: Array, period: float, frequency: float, damping: float) -> Array:
    """Deflection of a body on a spring from the shaft that carries it.

    position: of the shaft (rad), at rest before the first value; between two values, `period` (s) apart, its speed is constant.
    frequency, damping: of the body while the shaft is held, Hz and ratio. d'' + 2 zeta w d' + w^2 d = -(shaft acceleration).
    """
    omega = 2.0 * math.pi * frequency
    system = ([-1.0, 0.0, 0.0], [1.0, 2.0 * damping * omega, omega * omega])
    numerator, denominator, _ = cont2discrete(system, period, method="foh")
    return np.asarray(lfilter(np.ravel(numerator), denominator, position - position[0]), dtype=np.float64)
