"""Luenberger observer of friction with the stationary Kalman gain: an alternative to the disturbance observer.

State: the nominal plant's speed (and its derivative where the plant is of second order) and the friction torque as a
random walk. The gain is the stationary one, from the discrete Riccati equation. Only the ratio of the random walk to the
noise of the speed matters, and the bandwidth sets it: there the friction that is sought is as strong in the speed as
its noise,

    walk / noise density = | j w D(j w) |,     w = 2 pi bandwidth,     D(s) = second s^2 + first s + constant.

For a plain inertia the estimate is then the friction through a second-order Butterworth low-pass of that cut-off.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from tcs_friction.control.observer import Array, Design, NominalPlant, delayed_torque


def kalman_bandwidth(plant: NominalPlant, friction_walk: float, velocity_noise: float, dt: float) -> float:
    """Bandwidth (Hz) that is optimal for known noises.

    `friction_walk`: RMS change of friction within one second, N m/s^0.5; `velocity_noise`: RMS of one speed sample, rad/s.
    """
    ratio = friction_walk / (velocity_noise * math.sqrt(dt))
    d = plant
    # |s D(s)|^2 at s = j w is a polynomial in w^2, and grows
    squared = [d.second**2, d.first**2 - 2.0 * d.second * d.constant, d.constant**2, -(ratio**2)]
    roots = np.roots(np.trim_zeros(squared, "f"))
    real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real
    return float(math.sqrt(real.max()) / (2.0 * math.pi))


def noise_ratio(plant: NominalPlant, bandwidth: float) -> float:
    """Random walk of friction over density of the speed's noise (N m/rad)."""
    s = 2j * math.pi * bandwidth
    return abs(s * (plant.second * s * s + plant.first * s + plant.constant))


def kalman_delay(plant: NominalPlant, bandwidth: float) -> float:
    """Delay (s) of the estimate at low frequency: of Q(s) = p(0) / p(s) with p(s) p(-s) = N(s) N(-s) + ratio^2, N = s D."""
    forward = np.trim_zeros(np.array([plant.second, plant.first, plant.constant, 0.0]), "f")
    mirrored = forward * (-1.0) ** np.arange(len(forward))[::-1]
    both = np.polymul(forward, mirrored)
    both[-1] += noise_ratio(plant, bandwidth) ** 2
    roots = np.roots(both)
    return float(np.sum(-1.0 / roots[roots.real < 0.0]).real)


def kalman_design(plant: NominalPlant, bandwidth: float, torque_delay: float, dt: float) -> Design:
    """The observer's matrices for a tick of `dt` seconds; the torque acts `torque_delay` seconds late."""
    dynamics, gain = _model(plant)
    order = len(gain)
    transition = expm(dynamics * dt)
    new, old, ticks = delayed_torque(dynamics, gain, torque_delay, dt)
    sensor = np.zeros((1, order))
    sensor[0, 0] = 1.0
    ratio = noise_ratio(plant, bandwidth) * math.sqrt(dt)
    walk = _walk_covariance(dynamics, math.sqrt(ratio), dt)
    noise = np.array([[1.0 / ratio]])
    predicted = solve_discrete_are(transition.T, sensor.T, walk, noise)
    correction = (predicted @ sensor.T / (sensor @ predicted @ sensor.T + noise)).ravel()
    keep = np.eye(order) - np.outer(correction, sensor[0])
    output = np.zeros(order)
    output[-1] = 1.0
    return Design(keep @ transition, keep @ new, keep @ old, np.zeros(order), correction, output, ticks)


def _model(plant: NominalPlant) -> tuple[Array, Array]:
    """Continuous dynamics and torque gain of (speed, [its derivative,] friction)."""
    if plant.second == 0.0:
        dynamics = np.array([[-plant.constant, -1.0], [0.0, 0.0]])
        dynamics[0] /= plant.first
        return dynamics, np.array([1.0 / plant.first, 0.0])
    dynamics = np.zeros((3, 3))
    dynamics[0, 1] = 1.0
    dynamics[1] = np.array([-plant.constant, -plant.first, -1.0]) / plant.second
    return dynamics, np.array([0.0, 1.0 / plant.second, 0.0])


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
