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
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

from tcs_friction.control.config_field import setting, validate
from tcs_friction.control.observer import Array, Design, NominalPlant, delayed_torque


@dataclass(frozen=True)
class DobConfig:
    """Nominal plant, filter and known delays of the disturbance observer."""

    plant: NominalPlant = field(default_factory=NominalPlant)
    bandwidth: float = setting(10.0, "Hz", 0.01, 1000.0, "cut-off frequency of the Q filter")
    actuation_delay: float = setting(
        0.0, "s", 0.0, 0.1, "known delay between the logged torque and its action"
    )
    velocity_delay: float = setting(0.0, "s", 0.0, 0.1, "known delay of the measured speed (its filter)")

    def validate(self, where: str = "dob") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)

    @property
    def filter_delay(self) -> float:
        """Delay of the estimate at low frequency (s): that of Q and that of the measured speed."""
        return 2.0 / (2.0 * math.pi * self.bandwidth) + self.velocity_delay

    def design(self, dt: float) -> Design:
        """The observer's matrices for a tick of `dt` seconds."""
        corner = 2.0 * math.pi * self.bandwidth
        gain = corner**3
        dynamics = np.array([[-2.0 * corner, 1.0, 0.0], [-2.0 * corner**2, 0.0, 1.0], [-gain, 0.0, 0.0]])
        torque = np.array([0.0, 0.0, gain])
        speed = -gain * np.array([self.plant.second, self.plant.first, self.plant.constant])
        # the torque waits for the late speed, so that both speak of the same moment
        new, old, ticks = delayed_torque(dynamics, torque, self.actuation_delay + self.velocity_delay, dt)
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
