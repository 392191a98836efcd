"""Disturbance observer, eq. 1 of the paper with the low-pass filter Q that makes it proper.

    friction = Q(s) [u - (second s^2 + first s + constant) v]

The sign is that of friction opposing positive motion (the paper writes the torque added to u). Q is a
third-order Butterworth low-pass: its inverse model stays strictly proper also for the second-order plant of
eq. 10, and at low frequency it delays by 2 / (2 pi bandwidth). Discretised exactly: the torque is held
between ticks, as it really is, and the speed runs linearly between its samples, which under constant net
torque it does.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from tcs_friction.control.observer import Array, Design, NominalPlant, delayed_torque


def dob_delay(bandwidth: float) -> float:
    """Delay (s) of the estimate at low frequency, for a cut-off in Hz."""
    return 2.0 / (2.0 * math.pi * bandwidth)


def dob_design(plant: NominalPlant, bandwidth: float, torque_delay: float, dt: float) -> Design:
    """The observer's matrices for a tick of `dt` seconds; the torque acts `torque_delay` seconds late."""
    corner = 2.0 * math.pi * bandwidth
    gain = corner**3
    dynamics = np.array([[-2.0 * corner, 1.0, 0.0], [-2.0 * corner**2, 0.0, 1.0], [-gain, 0.0, 0.0]])
    torque = np.array([0.0, 0.0, gain])
    speed = -gain * np.array([plant.second, plant.first, plant.constant])
    new, old, ticks = delayed_torque(dynamics, torque, torque_delay, dt)
    before, now = linear_input(dynamics, speed, dt)
    return Design(expm(dynamics * dt), new, old, before, now, np.array([1.0, 0.0, 0.0]), ticks)


def linear_input(dynamics: Array, gain: Array, dt: float) -> tuple[Array, Array]:
    """Exact gains of the sample before and the sample now, for an input that runs linearly between them."""
    order = len(gain)
    block = np.zeros((order + 2, order + 2))
    block[:order, :order] = dynamics
    block[:order, order] = gain
    block[order, order + 1] = 1.0
    power = expm(block * dt)
    level, ramp = power[:order, order], power[:order, order + 1] / dt
    return level - ramp, ramp
