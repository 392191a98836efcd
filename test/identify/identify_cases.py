"""Motions with a known friction, shared by the identification tests."""

from __future__ import annotations

import numpy as np

from tcs_friction.conditioning.motion import FrictionSeries
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording

LUGRE = {
    "coulomb": 78.1,
    "static": 117.2,
    "stribeck_velocity": 6.1e-4,
    "stiffness": 2.96e5,
    "damping": 3.4e4,
    "viscous": 572.0,
}
INERTIA = 1000.0
SPEED = 3.5e-3
PERIOD = 12.0


def axis_of(values: dict[str, float] | None = None, name: str = "lugre", inertia: float = INERTIA) -> Axis:
    return Axis("test", inertia, instance(law(name), values or LUGRE))


def walked(chosen: Instance, t: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Friction torque (n,) along a motion from rest."""
    velocity = np.gradient(position, t)
    out, zero = np.empty((len(t), 8)), np.zeros(len(t))
    built = machine.build(Axis("test", 1.0, chosen), float(t[1] - t[0]))
    machine.evaluate(built, t, position, velocity, zero, zero, np.full((1, len(t)), 20.0), 1e-7, out)
    friction: np.ndarray = out[:, machine.DRY_PART] + out[:, machine.VISCOUS_PART]
    return friction


def recording(
    axis: Axis,
    seconds: float = 36.0,
    seed: int = 0,
    noise: float = 0.3,
    offset: float = 0.0,
    period: float = PERIOD,
    rate: float = 500.0,
) -> Recording:
    """A sinusoid from rest with the torque that it takes, white torque noise and a little encoder noise."""
    random = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    amplitude = SPEED * period / (2.0 * np.pi)
    position = -amplitude * np.cos(2.0 * np.pi * t / period)
    acceleration = amplitude * (2.0 * np.pi / period) ** 2 * np.cos(2.0 * np.pi * t / period)
    torque = axis.inertia * acceleration + walked(axis.friction, t, position) + offset
    measured = position + 2e-8 * random.standard_normal(len(t))
    return Recording(t, measured, torque + noise * random.standard_normal(len(t)), source="test")


def series(
    axis: Axis,
    seed: int = 0,
    noise: float = 0.5,
    seconds: float = 24.0,
    period: float = PERIOD,
    rate: float = 500.0,
) -> FrictionSeries:
    """Friction against time on the same sinusoid."""
    random = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    position = -SPEED * period / (2.0 * np.pi) * np.cos(2.0 * np.pi * t / period)
    friction = walked(axis.friction, t, position) + noise * random.standard_normal(len(t))
    return FrictionSeries(t, SPEED * np.sin(2.0 * np.pi * t / period), friction)
