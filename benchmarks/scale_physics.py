"""An axis with LuGre friction under a sampled controller, of any size: the simulator of `scale_worlds`.

It shares nothing with the product on purpose: equations, integrator and controller are written anew, so that a mistake in one
is not hidden by the same mistake in the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAMES = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous", "inertia", "offset")
TOLERANCE = 1e-8  # of the scales of position, velocity and bristle, per step

# RODAS of Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.7: a Rosenbrock method of order 4, stiffly
# accurate and L-stable, with an embedded one of order 3. A bristle that follows a fast motion is as stiff as |v| s0 / g.
_GAMMA = 0.25
_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ]
)
_C = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
    ]
)


@dataclass(frozen=True)
class Control:
    """What drives the axis, one entry a control tick.

    Attributes
    ----------
    position, velocity, feedforward : ndarray, shape (k,)
        Reference [rad or m, rad/s or m/s] and torque that is added [N m or N].
    powered : ndarray of bool, shape (k,)
        Where it is False the torque is zero and the integrator empty.
    position_gain, velocity_gain, integral_gain : float
        1/s, N m s/rad, N m/rad; all zero: open loop.
    filter_rate : float
        Corner of the filtered difference that serves as velocity [rad/s].
    """

    position: Array
    velocity: Array
    feedforward: Array
    powered: NDArray[np.bool_]
    position_gain: float
    velocity_gain: float
    integral_gain: float
    filter_rate: float


@njit(cache=True)
def rates(v: float, z: float, torque: float, p: Array) -> tuple[float, float]:
    """Acceleration and bristle velocity; `torque` is all that acts beside friction and offset, `p` in the order of `NAMES`."""
    fall = (p[1] - p[0]) * math.exp(-((v / p[2]) ** 2))
    bristle = v - p[3] * abs(v) * z / (p[0] + fall)
    return (torque - p[7] - p[3] * z - p[4] * bristle - p[5] * v) / p[6], bristle


@njit(cache=True)
def step(
    v: float, z: float, torque: float, p: Array, h: float, k: Array
) -> tuple[float, float, float, float, float, float]:
    """One step under constant torque: distance, velocity and bristle at its end, and the estimated error of each.

    `k` is room for the stages, shape (3, 6).
    """
    fall = (p[1] - p[0]) * math.exp(-((v / p[2]) ** 2))
    g = p[0] + fall
    slope = -2.0 * v / p[2] ** 2 * fall
    z_v = 1.0 - p[3] * z * (math.copysign(1.0, v) / g - abs(v) * slope / g**2)
    z_z = -p[3] * abs(v) / g
    v_v = (-p[4] * z_v - p[5]) / p[6]
    v_z = (-p[3] - p[4] * z_z) / p[6]
    shift = 1.0 / (h * _GAMMA)
    m_v, m_z = shift - v_v, shift - z_z
    determinant = m_v * m_z - v_z * z_v
    x_at, v_at, z_at = 0.0, v, z
    for i in range(6):
        x_at, v_at, z_at = 0.0, v, z
        x_c, v_c, z_c = 0.0, 0.0, 0.0
        for j in range(i):
            a, c = _A[i, j], _C[i, j] / h
            x_at += a * k[0, j]
            v_at += a * k[1, j]
            z_at += a * k[2, j]
            x_c += c * k[0, j]
            v_c += c * k[1, j]
            z_c += c * k[2, j]
        acceleration, bristle = rates(v_at, z_at, torque, p)
        v_c += acceleration
        z_c += bristle
        k[1, i] = (m_z * v_c + v_z * z_c) / determinant
        k[2, i] = (m_v * z_c + z_v * v_c) / determinant
        k[0, i] = (v_at + x_c + k[1, i]) / shift
    return x_at + k[0, 5], v_at + k[1, 5], z_at + k[2, 5], k[0, 5], k[1, 5], k[2, 5]


@njit(cache=True)
def next_step(
    h: float, errors: tuple[float, float, float], speed: float, scales: Array, tolerance: float
) -> tuple[bool, float]:
    """Whether a step of length `h` was accurate enough, and how long the next may be; `scales` of position and velocity."""
    x_error = max(abs(errors[0]), abs(errors[2])) / scales[0]
    v_error = abs(errors[1]) / (scales[1] + 0.01 * speed)
    error = max(x_error, v_error) / tolerance
    factor = 5.0 if error < 1e-4 else min(5.0, max(0.2, 0.85 * error**-0.25))
    return error <= 1.0, h * factor


@njit(cache=True)
def advance(
    state: Array, torque: float, p: Array, duration: float, scales: Array, tolerance: float, k: Array
) -> None:
    """Integrate position, velocity and bristle over `duration` in place; state[3] keeps the length of the next step."""
    left = duration
    while left > 1e-12 * duration:
        h = min(state[3], left)
        dx, v, z, e_x, e_v, e_z = step(state[1], state[2], torque, p, h, k)
        good, following = next_step(h, (e_x, e_v, e_z), abs(v), scales, tolerance)
        if good:
            state[0] += dx
            state[1] = v
            state[2] = z
            left -= h
            if h == state[3] or following < h:  # a step cut short by the end says nothing about longer ones
                state[3] = following
        else:
            state[3] = following


@njit(cache=True)
def _run(
    ticks: Array,
    noise: Array,
    samples: Array,
    p: Array,
    scales: Array,
    reference: Array,
    gains: Array,
    reading_noise: Array,
    quantum: float,
    tolerance: float,
) -> tuple[Array, Array]:
    count, split = noise.shape
    torque = np.empty(count)
    states = np.empty((samples.size, 3))
    k = np.empty((3, 6))
    state = np.zeros(4)
    state[3] = ticks[1] - ticks[0]
    integral, speed, last, taken = 0.0, 0.0, 0.0, 0
    for j in range(count):
        reading = state[0] + reading_noise[j]
        if quantum > 0.0:
            reading = round(reading / quantum) * quantum
        length = ticks[j + 1] - ticks[j]
        if j > 0:
            before = ticks[j] - ticks[j - 1]
            speed += (1.0 - math.exp(-gains[3] * before)) * ((reading - last) / before - speed)
        last = reading
        error = reference[1, j] + gains[0] * (reference[0, j] - reading) - speed
        if reference[3, j] > 0.0:
            integral += gains[2] * error * length
            torque[j] = reference[2, j] + gains[1] * error + integral
        else:
            integral = 0.0
            torque[j] = 0.0
        for i in range(split):
            now = ticks[j] + length * i / split
            end = ticks[j] + length * (i + 1) / split
            while taken < samples.size and samples[taken] < end - 1e-9 * length:
                if samples[taken] > now:
                    advance(state, torque[j] + noise[j, i], p, samples[taken] - now, scales, tolerance, k)
                    now = samples[taken]
                states[taken] = state[:3]
                taken += 1
            advance(state, torque[j] + noise[j, i], p, end - now, scales, tolerance, k)
    while taken < samples.size:
        states[taken] = state[:3]
        taken += 1
    return torque, states


def simulate(
    ticks: Array,
    noise: Array,
    samples: Array,
    parameters: Array,
    scales: Array,
    control: Control,
    reading_noise: Array,
    quantum: float,
    tolerance: float = TOLERANCE,
) -> tuple[Array, Array]:
    """The axis from rest, under a controller that reads the encoder at every tick and holds its torque to the next.

    Parameters
    ----------
    ticks : ndarray, shape (k + 1,)
        Control ticks and the end [s].
    noise : ndarray, shape (k, split)
        Torque noise of the drive, held over each of `split` equal parts of a tick [N m or N].
    samples : ndarray, shape (n,)
        When the state is wanted [s], ascending.
    parameters : ndarray, shape (8,)
        In the order of `NAMES`.
    scales : ndarray, shape (2,)
        Position (and bristle) and velocity to which the tolerance refers.
    control : Control
        Reference and gains.
    reading_noise : ndarray, shape (k,)
        Noise of the encoder at the ticks; `quantum` is its step, 0 for none.
    tolerance : float
        Largest error of a step, of the scales.

    Returns
    -------
    torque : ndarray, shape (k,)
        What the controller applied.
    states : ndarray, shape (n, 3)
        True position, velocity and bristle at the samples.
    """
    reference = np.stack(
        [control.position, control.velocity, control.feedforward, control.powered.astype(float)]
    )
    gains = np.array(
        [control.position_gain, control.velocity_gain, control.integral_gain, control.filter_rate]
    )
    return _run(
        ticks, noise, samples, parameters, scales, reference, gains, reading_noise, quantum, tolerance
    )
