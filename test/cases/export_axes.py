"""Axes of every law and every effect, for what is exported."""

from __future__ import annotations

import numpy as np

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law, laws
from tcs_friction.physics.terms import Instance, Table, instance

VALUES = {
    "coulomb": 60.0, "static": 90.0, "stribeck_velocity": 2e-2, "stiffness": 3e4, "damping": 50.0, "viscous": 50.0,
    "exponent": 1.3, "load": 0.1, "load_stribeck": 0.2, "spread": 1.0, "elements": 6.0, "transient": 20.0,
   "presliding_distance": 1e-3, "ratio": 0.3,
}  # fmt: skip
OWN = {
    "actuator_lag": {"time_constant": 3e-3},
    "backlash": {"gap": 1e-3, "inertia_ratio": 0.3, "contact_frequency": 20.0},
    "cable_hysteresis": {"amplitude": 20.0, "width": 0.02, "exponent": 0.5},
    "cable_wrap": {"stiffness": 50.0, "cubic": 9.0, "neutral": 0.1},
    "cogging": {"order": 24.0, "amplitude": 20.0, "phase": 0.3, "amplitude_2": 4.0, "phase_2": 1.0},
    "coulomb_asymmetry": {"asymmetry": 0.2},
    "cross_axis_coupling": {"inertia": 0.3},
    "encoder_periodic_error": {"order": 300.0, "amplitude": 4e-7},
    "exogenous": {"linear": 2.0, "squared": 1.0},
    "flexible_mode": {"frequency": 18.0, "inertia_ratio": 0.3},
    "imbalance": {"amplitude": 30.0, "phase": 1.0},
    "load_dependent_friction": {"coefficient": 0.2},
    "load_step": {"step": 10.0, "time": 0.1},
    "local_friction_bump": {"amplitude": 0.5, "centre": 0.0, "width": 0.3},
    "periodic_vibration": {"frequency": 12.0, "amplitude": 5.0},
    "position_dependent_friction": {"order": 10.0, "amplitude": 0.2},
    "position_dependent_inertia": {"amplitude": 0.3, "phase": 1.0},
    "presliding": {"stiffness": 3e4, "damping": 50.0},
    "quadratic_drag": {"coefficient": 30.0},
    "stribeck": {"drop": 30.0, "stribeck_velocity": 2e-2},
    "temperature_dependent_friction": {"dry": -0.01, "viscous": -0.02},
    "torque_bias": {"bias": 12.0},
    "torque_ripple": {"order": 30.0, "amplitude": 0.1},
    "transport_delay": {"delay": 2.3e-3},
    "viscous_asymmetry": {"asymmetry": 20.0},
    "warmup_drift": {"dry": 0.3, "viscous": 0.2, "time_constant": 5.0},
    "wind_torque": {"coefficient": 1.0},
    "learned_map": {},
}
TABLE = Table(("position", "velocity"), (-1.0, -1.0), (1.0, 1.0), np.random.default_rng(0).normal(0.0, 5.0, (7, 4)))


def law_of(name: str) -> Instance:
    """A law with the values above, as far as it has them."""
    term = law(name)
    return instance(term, {p.name: VALUES[p.name] for p in term.parameters if p.name in VALUES})


def effect_of(name: str, **values: float) -> Instance:
    """An effect with the values above, or others."""
    term = effect(name)
    signal, table = "wind_speed" if term.signals else None, TABLE if term.tabulated else None
    return instance(term, OWN[name] | values, signal=signal, table=table)


def axis(friction: str = "lugre", *names: str, kind: str = "rotary", inertia: float = 100.0) -> Axis:
    """An axis with this law and these effects."""
    return Axis("azimuth", inertia, law_of(friction), tuple(map(effect_of, names)), kind)


def every() -> dict[str, Axis]:
    """Each law, and all effects five by five."""
    names = sorted(effects())
    groups = [names[k : k + 5] for k in range(0, len(names), 5)]
    found = {name: axis(name) for name in laws()}
    return found | {f"{group[0]} to {group[-1]}": axis("lugre", *group) for group in groups}
