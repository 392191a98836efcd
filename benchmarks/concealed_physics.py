"""The world behind the concealed recordings: an axis with every effect, written a second time.

Nothing here comes from tcs_friction: the equations are one right-hand side, integrated by Heun's method with
50 us steps, the bristle a plain differential equation, effects on friction inside its level, where a bearing
has them. What the product makes of a recording can therefore not agree with it by sharing a mistake.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

PERIOD = 0.002  # s, of control and recording
SUBSTEPS = 40  # 50 us
QUARTER = 0.5 * math.pi  # a sine is a cosine a quarter turn later

# State: position, velocity, bristle, deflection and velocity of the second body, cable, lagged torque,
# bristle of the believed law
SIZE = 8
Q, V, Z, D, W, S, U, N = range(SIZE)


class Physics(NamedTuple):
    """An axis and its effects; an effect of size zero is absent. SI units, opposing torques positive."""

    inertia: float
    coulomb: float
    static: float
    stribeck_velocity: float
    stiffness: float
    damping: float
    viscous: float
    torque_noise: float
    believed_drop: float = 1.0  # 0: the believed law lacks the Stribeck drop
    believed_bristle: float = 1.0  # 0: the believed law lacks the bristle
    asymmetry: float = 0.0
    viscous_asymmetry: float = 0.0
    friction_variation: float = 0.0
    friction_order: float = 1.0
    friction_phase: float = 0.0
    bump: float = 0.0
    bump_centre: float = 0.0
    bump_width: float = 1.0
    drag: float = 0.0
    temperature_dry: float = 0.0
    temperature_viscous: float = 0.0
    warmup_dry: float = 0.0
    warmup_viscous: float = 0.0
    warmup_time: float = 1.0
    load_friction: float = 0.0
    cogging: float = 0.0
    cogging_second: float = 0.0
    cogging_order: float = 1.0
    cogging_phase: float = 0.0
    ripple: float = 0.0
    ripple_order: float = 1.0
    ripple_phase: float = 0.0
    bias: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    gap: float = 0.0
    ratio: float = 0.0
    mode_frequency: float = 20.0  # free resonance; of a contact: with the first body held
    mode_damping: float = 0.02
    inertia_variation: float = 0.0
    inertia_phase: float = 0.0
    imbalance: float = 0.0
    imbalance_phase: float = 0.0
    cable: float = 0.0
    cable_cubic: float = 0.0
    hysteresis: float = 0.0
    hysteresis_width: float = 1.0
    encoder_error: float = 0.0
    encoder_order: float = 1.0
    encoder_phase: float = 0.0
    vibration: float = 0.0
    vibration_frequency: float = 1.0
    vibration_phase: float = 0.0
    step: float = 0.0
    step_time: float = 0.0
    coupling: float = 0.0
    wind: float = 0.0
    wind_linear: float = 0.0
    elevation_linear: float = 0.0
    speed_position: float = 0.0
    fading: float = 0.0
    fading_order: float = 1.0
    fading_frequency: float = 0.02
    chaos: float = 0.0


class Environment(NamedTuple):
    """What the world does to the axis, per control period, each (n,)."""

    reference: np.ndarray  # rad
    reference_velocity: np.ndarray  # rad/s
    temperature: np.ndarray  # degC
    wind: np.ndarray  # m/s
    elevation_velocity: np.ndarray  # rad/s
    elevation_acceleration: np.ndarray  # rad/s^2
    torque_noise: np.ndarray  # N m for each unit of Physics.torque_noise
    encoder_noise: np.ndarray  # rad
    chaos: np.ndarray  # 1, -1 to 1


class Encoder(NamedTuple):
    resolution: float = math.radians(0.002 / 3600.0)
    velocity_bandwidth: float = 100.0  # Hz


@njit(cache=True, error_model="numpy", inline="always")
def level(p: Any, v: float) -> Any:
    """Stribeck curve, N m."""
    ratio = v / p.stribeck_velocity
    return p.coulomb + (p.static - p.coulomb) * math.exp(-ratio * ratio)


@njit(cache=True, error_model="numpy", inline="always")
def wave(amplitude: float, order: float, phase: float, x: float) -> float:
    """amplitude cos(order x + phase), without the cosine's cost where there is none."""
    return amplitude * math.cos(order * x + phase) if amplitude != 0.0 else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def fading(amplitude: float, t: float, time_constant: float) -> float:
    """amplitude exp(-t / time_constant)."""
    return amplitude * math.exp(-t / time_constant) if amplitude != 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def grip(p: Any, t: float, q: float, v: float, load: float, temperature: float) -> Any:
    """Dry friction level at this place, time, direction and load, N m."""
    factor = 1.0 + wave(p.friction_variation, p.friction_order, p.friction_phase, q)
    factor += p.temperature_dry * (temperature - 20.0) + fading(p.warmup_dry, t, p.warmup_time)
    if p.bump != 0.0:
        distance = (q - p.bump_centre) / p.bump_width
        factor += p.bump * math.exp(-distance * distance)
    factor += p.asymmetry * np.sign(v)
    return max(level(p, v) * factor + p.load_friction * abs(load), 1.0)


@njit(cache=True, error_model="numpy")
def pushing(p: Any, e: Any, k: int, t: float, q: float, v: float, s: float) -> Any:
    """Opposing torque apart from friction, N m."""
    x = (
        p.bias
        + p.drag * v * abs(v)
        + p.viscous_asymmetry * abs(v)
        + wave(p.imbalance, 1.0, p.imbalance_phase - QUARTER, q)
    )
    x += (p.cable + p.cable_cubic * q * q) * q + p.hysteresis * s
    x += wave(p.cogging, p.cogging_order, p.cogging_phase, q)
    x += wave(p.cogging_second, 2.0 * p.cogging_order, 1.7 * p.cogging_phase, q)
    x += wave(p.vibration, 2.0 * math.pi * p.vibration_frequency, p.vibration_phase - QUARTER, t)
    x += p.step if t >= p.step_time else 0.0
    x += p.coupling * e.elevation_acceleration[k] + p.elevation_linear * e.elevation_velocity[k]
    x += p.wind * e.wind[k] * abs(e.wind[k]) + p.wind_linear * e.wind[k]
    x += v * wave(p.speed_position, 3.0, 0.5, q) + p.chaos * e.chaos[k]
    x += wave(p.fading, p.fading_order, 0.0, q) * math.cos(2.0 * math.pi * p.fading_frequency * t)
    return x


@njit(cache=True, error_model="numpy")
def coupled(p: Any, y: Any) -> Any:
    """Torque of the second body on the first one, N m: through its spring, beyond the gap."""
    if p.ratio == 0.0:
        return 0.0
    half = 0.5 * p.gap
    beyond = y[D] - min(max(y[D], -half), half)
    if p.gap > 0.0 and beyond == 0.0:
        return 0.0
    held = 1.0 if p.gap > 0.0 else math.sqrt(1.0 - p.ratio)
    omega = 2.0 * math.pi * p.mode_frequency * held
    moved = y[W] - y[V]
    return p.ratio * p.inertia * (omega * omega * beyond + 2.0 * p.mode_damping * omega * moved)


@njit(cache=True, error_model="numpy")
def slope(p: Any, e: Any, k: int, t: float, y: Any, command: float, noise: float, dy: Any) -> Any:
    """Right-hand side of the equations of motion into `dy`; returns the believed friction torque, N m."""
    q, v = y[Q], y[V]
    motor = command if p.lag == 0.0 else y[U]
    motor *= 1.0 + wave(p.ripple, p.ripple_order, p.ripple_phase, q)
    dy[U] = (command - y[U]) / p.lag if p.lag > 0.0 else 0.0
    g = grip(p, t, q, v, motor, e.temperature[k])
    dy[Z] = v - p.stiffness * abs(v) / g * y[Z]
    sticky = (
        1.0 + p.temperature_viscous * (e.temperature[k] - 20.0) + fading(p.warmup_viscous, t, p.warmup_time)
    )
    friction = p.stiffness * y[Z] + p.damping * dy[Z] + p.viscous * sticky * v
    opposing = friction + pushing(p, e, k, t, q, v, y[S])
    own = p.inertia * (1.0 - p.ratio) * (1.0 + wave(p.inertia_variation, 2.0, p.inertia_phase, q))
    opposing -= p.inertia * wave(p.inertia_variation, 2.0, p.inertia_phase - QUARTER, q) * v * v
    spring = coupled(p, y)
    dy[Q] = v
    dy[V] = (motor + noise - opposing + spring) / own
    dy[D] = y[W] - v if p.ratio > 0.0 else 0.0
    dy[W] = -spring / (p.ratio * p.inertia) if p.ratio > 0.0 else 0.0
    dy[S] = v / p.hysteresis_width * (1.0 - y[S] * np.sign(v))
    believed = level(p, v) if p.believed_drop > 0.0 else p.coulomb
    dy[N] = v - p.stiffness * abs(v) / believed * y[N]
    if p.believed_bristle == 0.0:
        return believed * math.tanh(v / 5e-5) + p.viscous * v
    damping = p.damping if p.believed_drop > 0.0 else 0.0
    return p.stiffness * y[N] + damping * dy[N] + p.viscous * v


@njit(cache=True, error_model="numpy")
def simulate(p: Any, e: Any, encoder: Any, substeps: int) -> Any:
    """Closed loop over the whole reference.

    Returns (n, 4): measured position (rad), measured velocity (rad/s), torque command (N m), and the mean over
    the period of what the believed physics cannot explain: command less inertia, believed friction and noise.
    """
    count = len(e.reference)
    out = np.zeros((count, 4))
    h = PERIOD / substeps
    y, first, second, ahead = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    y[Q] = e.reference[0]
    before, measured_velocity, integral = y[Q], 0.0, 0.0
    gain = 1.0 - math.exp(-2.0 * math.pi * encoder.velocity_bandwidth * PERIOD)
    for k in range(count):
        measured = (
            y[Q] + p.encoder_error * math.sin(p.encoder_order * y[Q] + p.encoder_phase) + e.encoder_noise[k]
        )
        measured = encoder.resolution * math.floor(measured / encoder.resolution + 0.5)
        if k > 0:
            measured_velocity += gain * ((measured - before) / PERIOD - measured_velocity)
        before = measured
        wanted = e.reference_velocity[k] + 10.0 * (e.reference[k] - measured)
        integral += 6.0 * (wanted - measured_velocity) * PERIOD
        command = 62.8 * p.inertia * (wanted - measured_velocity + integral)
        out[k, 0], out[k, 1], out[k, 2] = measured, measured_velocity, command
        noise = p.torque_noise * e.torque_noise[k]
        unexplained = 0.0
        for i in range(substeps):
            t = k * PERIOD + i * h
            late = out[max(math.floor((t - p.delay) / PERIOD + 1e-9), 0), 2]
            known = slope(p, e, k, t, y, late, noise, first)
            unexplained += command + noise - p.inertia * first[V] - known
            for j in range(SIZE):
                ahead[j] = y[j] + h * first[j]
            slope(p, e, k, t + h, ahead, late, noise, second)
            for j in range(SIZE):
                y[j] += 0.5 * h * (first[j] + second[j])
        out[k, 3] = unexplained / substeps
    return out
