"""Kalman observer of friction: an alternative to the disturbance observer, with the same interface.

State: the nominal plant's speed (and its derivative where the plant is of second order) and the friction
torque as a random walk. The gain is the stationary one, from the discrete Riccati equation.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from tcs_friction.control.config_field import setting, validate
from tcs_friction.control.observer import Array, Design, NominalPlant, delayed_torque


@dataclass(frozen=True)
class KalmanConfig:
    """Nominal plant, noise and known delays of the Kalman observer. Only the ratio of the noises matters."""

    plant: NominalPlant = field(default_factory=NominalPlant)
    friction_walk: float = setting(100.0, "N m/s^0.5", 1e-9, 1e9, "RMS change of friction within one second")
    velocity_noise: float = setting(2e-4, "rad/s", 1e-15, 1e3, "RMS noise of one speed measurement")
    actuation_delay: float = setting(
        0.0, "s", 0.0, 0.1, "known delay between the logged torque and its action"
    )
    velocity_delay: float = setting(0.0, "s", 0.0, 0.1, "known delay of the measured speed (its filter)")

    def validate(self, where: str = "observer") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)

    def _model(self) -> tuple[Array, Array]:
        """Continuous dynamics and torque gain of (speed, [its derivative,] friction)."""
        plant = self.plant
        if plant.second == 0.0:
            dynamics = np.array([[-plant.constant, -1.0], [0.0, 0.0]])
            dynamics[0] /= plant.first
            return dynamics, np.array([1.0 / plant.first, 0.0])
        dynamics = np.zeros((3, 3))
        dynamics[0, 1] = 1.0
        dynamics[1] = np.array([-plant.constant, -plant.first, -1.0]) / plant.second
        return dynamics, np.array([0.0, 1.0 / plant.second, 0.0])

    def design(self, dt: float) -> Design:
        """The observer's matrices for a tick of `dt` seconds."""
        dynamics, gain = self._model()
        order = len(gain)
        transition = expm(dynamics * dt)
        new, old, ticks = delayed_torque(dynamics, gain, self.actuation_delay + self.velocity_delay, dt)
        sensor = np.zeros((1, order))
        sensor[0, 0] = 1.0
        walk = _walk_covariance(dynamics, self.friction_walk, dt)
        noise = np.array([[self.velocity_noise**2]])
        predicted = solve_discrete_are(transition.T, sensor.T, walk, noise)
        correction = (predicted @ sensor.T / (sensor @ predicted @ sensor.T + noise)).ravel()
        keep = np.eye(order) - np.outer(correction, sensor[0])
        output = np.zeros(order)
        output[-1] = 1.0
        return Design(keep @ transition, keep @ new, keep @ old, np.zeros(order), correction, output, ticks)


def _walk_covariance(dynamics: Array, walk: float, dt: float) -> Array:
    """Covariance that the friction's random walk adds to the state in one tick (Van Loan's integral)."""
    order = len(dynamics)
    block = np.zeros((2 * order, 2 * order))
    block[:order, :order] = -dynamics
    block[order - 1, 2 * order - 1] = walk**2
    block[order:, order:] = dynamics.T
    power = expm(block * dt)
    covariance: Array = power[order:, order:].T @ power[:order, order:]
    return 0.5 * (covariance + covariance.T)
