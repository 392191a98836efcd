"""A small axis driven by a torque without a controller, and what a recorder would have noted of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import simulate_open_loop
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording

PERIOD = 2e-3
NOISE = 1e-7  # rad, of the encoder
LUGRE = {
    "coulomb": 60.0,
    "static": 90.0,
    "stribeck_velocity": 6e-4,
    "stiffness": 3e5,
    "damping": 2e4,
    "viscous": 500.0,
}


def item(name: str, **values: float) -> Instance:
    return instance(effect(name), values)


def axis(*effects: Instance) -> Axis:
    return Axis("test", 1000.0, instance(law("lugre"), LUGRE), effects)


def recorded(true: Axis, duration: float = 40.0, seed: int = 0, scale: float = 1.0) -> Recording:
    """Driven to and fro by two sinusoids of torque."""
    t = PERIOD * np.arange(1, round(duration / PERIOD) + 1)
    torque = scale * (160.0 * np.sin(2.0 * np.pi * 0.11 * t) + 80.0 * np.sin(2.0 * np.pi * 0.9 * t))
    motion = simulate_open_loop(true, torque, PERIOD)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(t))
    return Recording(t=t, position=motion.position + noise, torque=torque, source="bag")


def along(position: np.ndarray, torque: np.ndarray, period: float = PERIOD) -> Recording:
    t = period * np.arange(len(position))
    noise = NOISE * np.random.default_rng(1).standard_normal(len(t))
    return Recording(t=t, position=position + noise, torque=torque, source="bag")


def scaled(r: Recording, position: float = 1.0, torque: float = 1.0) -> Recording:
    return replace(r, position=r.position * position, torque=r.torque * torque)


def conditioned(r: Recording) -> DataSet:
    return prepare([r])
