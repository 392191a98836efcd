"""Axes, effects with values at which each shows plainly, and a drive that moves them: shared by the physics tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import Instance, Table, instance

LUGRE = instance(
    law("lugre"),
    {
        "coulomb": 78.0,
        "static": 110.0,
        "stribeck_velocity": 6e-4,
        "stiffness": 3e5,
        "damping": 2e4,
        "viscous": 500.0,
    },
)
DAHL = instance(law("dahl_viscous"), {"coulomb": 78.0, "stiffness": 3e5, "viscous": 500.0})
STRIBECK = instance(
    law("stribeck_static"), {"coulomb": 78.0, "static": 110.0, "stribeck_velocity": 6e-4, "viscous": 500.0}
)
COULOMB = instance(law("coulomb_viscous"), {"coulomb": 78.0, "viscous": 500.0})
LAWS = (LUGRE, DAHL, STRIBECK, COULOMB)
INERTIA = 1000.0
SIGNALS = ("other", "wind")

VALUES: Mapping[str, Mapping[str, float]] = {
    "actuator_lag": {"time_constant": 0.004},
    "backlash": {"gap": 2e-4, "inertia_ratio": 0.3},
    "cable_hysteresis": {"amplitude": 10.0, "width": 0.01},
    "cable_wrap": {"stiffness": 100.0, "cubic": 500.0, "neutral": 0.1},
    "cogging": {"order": 72.0, "amplitude": 5.0, "phase": 0.3, "amplitude_2": 2.0, "phase_2": 1.0},
    "coulomb_asymmetry": {"asymmetry": 0.1},
    "cross_axis_coupling": {"inertia": 60.0},
    "encoder_periodic_error": {"order": 40.0, "amplitude": 1e-4, "phase": 0.4},
    "exogenous": {"linear": 5.0, "squared": 3.0},
    "flexible_mode": {"frequency": 20.0, "damping": 0.03, "inertia_ratio": 0.3},
    "imbalance": {"amplitude": 20.0, "phase": 0.2},
    "load_dependent_friction": {"coefficient": 0.1},
    "load_step": {"step": 10.0, "time": 1.5},
    "local_friction_bump": {"amplitude": 0.3, "centre": 0.31, "width": 0.02},
    "periodic_vibration": {"frequency": 7.0, "amplitude": 8.0, "phase": 1.0},
    "position_dependent_friction": {"order": 20.0, "amplitude": 0.2, "phase": 0.5},
    "position_dependent_inertia": {"amplitude": 0.2, "phase": 0.3},
    "quadratic_drag": {"coefficient": 3000.0},
    "temperature_dependent_friction": {"dry": -0.02, "viscous": -0.05},
    "torque_bias": {"bias": 9.0},
    "torque_ripple": {"order": 30.0, "amplitude": 0.05, "phase": 0.2},
    "transport_delay": {"delay": 0.0031},
    "viscous_asymmetry": {"asymmetry": 100.0},
    "warmup_drift": {"dry": 0.2, "viscous": 0.3, "time_constant": 1.5},
    "wind_torque": {"coefficient": 2.0},
    "stribeck": {"drop": 30.0, "stribeck_velocity": 0.02},
    "presliding": {"stiffness": 2e5, "damping": 5e3},
    "learned_map": {},
}
BASE_LAW = {"stribeck": DAHL, "presliding": STRIBECK}
TABLE = Table(("position",), (0.2,), (0.5,), np.array([-8.0, 5.0, 2.0, -6.0]))


def plain(name: str) -> Instance:
    """The effect at a size that nobody overlooks."""
    term = effect(name)
    signal = {"wind_torque": "wind"}.get(name, "other") if term.signals else None
    return instance(term, VALUES[name], signal=signal, table=TABLE if name == "learned_map" else None)


def axis_with(*names: str, friction: Instance | None = None, kind: str = "rotary") -> Axis:
    """An axis with these effects; the law is one that the effect completes where it needs such."""
    chosen = friction or next((BASE_LAW[name] for name in names if name in BASE_LAW), LUGRE)
    return Axis("test", INERTIA, chosen, tuple(plain(name) for name in names), kind=kind)


@dataclass(frozen=True)
class Run:
    """A simulated run, each (n,) at the ends of its steps; `signals` (3, n) are temperature, other, wind."""

    t: np.ndarray
    position: np.ndarray
    torque: np.ndarray
    signals: np.ndarray
    measured_velocity: np.ndarray


def torque_at(t: np.ndarray) -> np.ndarray:
    """Drive torque, N m: slides to and fro over 0.05 rad, with faster parts on top."""
    two_pi_t = 2.0 * np.pi * t
    return 300.0 * np.sin(0.5 * two_pi_t) + 90.0 * np.sin(3.1 * two_pi_t) + 30.0 * np.sin(11.0 * two_pi_t)


def run(axis: Axis, duration: float = 4.0, dt: float = 2e-4, seed: int = 0) -> Run:
    """Simulate an axis under `torque_at`, one integration step a control period."""
    t = dt * np.arange(1, round(duration / dt) + 1)
    torque = torque_at(t)
    signals = np.array([20.0 + 5.0 * np.sin(t), 0.3 * np.sin(8.2 * t), 1.0 + 2.0 * np.sin(2.5 * t)])
    simulator = Simulator(axis, dt, seed=seed, position=0.3, signals=SIGNALS, substeps=1)
    position, velocity = np.empty(len(t)), np.empty(len(t))
    for i in range(len(t)):
        simulator.step(torque[i], signals[0, i], (signals[1, i], signals[2, i]))
        position[i], velocity[i] = simulator.measured_position, simulator.measured_velocity
    return Run(t, position, torque, signals, velocity)


def residual(axis: Axis, measured: Run, resolution: float = 1e-7) -> np.ndarray:
    """Torque at the rotor minus the torque that the motion requires, (n,) without the ends, N m."""
    dt = measured.t[1] - measured.t[0]
    acceleration = np.zeros(len(measured.t))
    acceleration[1:-1] = np.diff(measured.position, 2) / dt**2
    between = measured.torque.copy()
    between[:-1] += measured.torque[1:]
    between[:-1] *= 0.5  # an acceleration about t_i comes from the steps before and after
    out = np.empty((len(measured.t), 8))
    machine.evaluate(
        machine.build(axis, dt, 1, SIGNALS, measured.position[0]),
        measured.t,
        measured.position,
        np.gradient(measured.position, dt),
        acceleration,
        between,
        measured.signals,
        resolution,
        out,
    )
    difference: np.ndarray = (out[:, machine.ROTOR] - out[:, machine.REQUIRED])[50:-50]
    return difference


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
