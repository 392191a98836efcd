"""What a low pass leaves of white noise, also where the signal is differentiated."""

from __future__ import annotations

import math


def derivative_noise(density: float, band: float, order: int) -> float:
    """Standard deviation of the order-th time derivative of white noise up to a band edge.

    density: one-sided, unit^2/Hz; band: Hz. The integral of density (2 pi f)^(2 order) over frequencies f up to the band's edge
    is the variance density (2 pi)^(2 order) band^(2 order + 1) / (2 order + 1). An encoder's noise is white and so is the
    position's: its velocity (order 1) and acceleration (order 2) are noise at high frequencies.
    """
    power = 2 * order + 1
    return (2.0 * math.pi) ** order * math.sqrt(density * band**power / power)
