"""How each concealed effect is drawn: its values, those its size scales, their names in the vocabulary."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.concealed_physics import PERIOD, Environment, Physics

OUTSIDE = ("unknown:speed_position", "unknown:fading_cogging", "unknown:chaotic_torque")


@dataclass(frozen=True)
class Setting:
    """What an effect's values are drawn from."""

    rng: np.random.Generator
    physics: Physics
    environment: Environment

    def phase(self) -> float:
        return float(self.rng.uniform(0.0, 2.0 * math.pi))

    def sign(self) -> float:
        return float(self.rng.choice((-1.0, 1.0)))

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def order(self, low: int, high: int) -> float:
        return float(self.rng.integers(low, high + 1))

    @property
    def duration(self) -> float:
        return len(self.environment.reference) * PERIOD


@dataclass(frozen=True)
class Effect:
    """One effect: `draw` gives Physics fields at a plain size, `scaled` lists those that the size multiplies.

    `names`: vocabulary parameter -> Physics field, for comparing values. `rounds`: of scaling, more where
    torque and value are not proportional. `limits`: of the first scaled field. What scales nothing comes as
    large as it is.
    """

    draw: Callable[[Setting], dict[str, float]]
    scaled: tuple[str, ...]
    names: Mapping[str, str] = field(default_factory=dict)
    rounds: int = 1
    limits: tuple[float, float] = (-math.inf, math.inf)


def _exogenous(s: Setting) -> dict[str, float]:
    return {"wind_linear": 0.3 * s.sign()} if s.rng.random() < 0.5 else {"elevation_linear": 60.0 * s.sign()}


def _bump(s: Setting) -> dict[str, float]:
    low, high = s.environment.reference.min(), s.environment.reference.max()
    centre = s.between(low + 0.15 * (high - low), high - 0.15 * (high - low))
    return {"bump": 0.3, "bump_centre": centre, "bump_width": s.between(0.05, 0.3)}


EFFECTS: Mapping[str, Effect] = {
    # `drop` stands for static - coulomb
    "stribeck": Effect(
        lambda s: {"drop": s.physics.static - s.physics.coulomb, "damping": 0.0, "believed_drop": 0.0},
        ("drop",),
        {"stribeck_velocity": "stribeck_velocity"},
        2,
        (0.0, 200.0),
    ),
    "presliding": Effect(
        lambda s: {"stiffness": s.physics.stiffness, "believed_bristle": 0.0},
        (),
        {"stiffness": "stiffness", "damping": "damping"},
    ),
    "coulomb_asymmetry": Effect(
        lambda s: {"asymmetry": 0.05 * s.sign()}, ("asymmetry",), {"asymmetry": "asymmetry"}
    ),
    "viscous_asymmetry": Effect(
        lambda s: {"viscous_asymmetry": 50.0 * s.sign()},
        ("viscous_asymmetry",),
        {"asymmetry": "viscous_asymmetry"},
    ),
    "position_dependent_friction": Effect(
        lambda s: {"friction_variation": 0.1, "friction_order": s.order(1, 3), "friction_phase": s.phase()},
        ("friction_variation",),
        {"order": "friction_order", "amplitude": "friction_variation", "phase": "friction_phase"},
    ),
    "local_friction_bump": Effect(
        _bump, ("bump",), {"amplitude": "bump", "centre": "bump_centre", "width": "bump_width"}
    ),
    "quadratic_drag": Effect(lambda s: {"drag": 300.0 * s.sign()}, ("drag",), {"coefficient": "drag"}),
    "temperature_dependent_friction": Effect(
        lambda s: {"temperature_dry": -0.01, "temperature_viscous": -0.02 * s.between(0.0, 1.0)},
        ("temperature_dry", "temperature_viscous"),
        {"dry": "temperature_dry", "viscous": "temperature_viscous"},
    ),
    "warmup_drift": Effect(
        lambda s: {
            "warmup_dry": 0.1,
            "warmup_viscous": s.between(0.0, 0.2),
            "warmup_time": s.duration * s.between(0.12, 0.35),
        },
        ("warmup_dry", "warmup_viscous"),
        {"dry": "warmup_dry", "viscous": "warmup_viscous", "time_constant": "warmup_time"},
    ),
    "load_dependent_friction": Effect(
        lambda _: {"load_friction": 0.05}, ("load_friction",), {"coefficient": "load_friction"}
    ),
    "cogging": Effect(
        lambda s: {
            "cogging": 2.0,
            "cogging_second": 2.0 * s.between(0.0, 0.35),
            "cogging_order": s.order(18, 96),
            "cogging_phase": s.phase(),
        },
        ("cogging", "cogging_second"),
        {"order": "cogging_order", "amplitude": "cogging", "phase": "cogging_phase"},
    ),
    "torque_ripple": Effect(
        lambda s: {"ripple": 0.02, "ripple_order": s.order(12, 60), "ripple_phase": s.phase()},
        ("ripple",),
        {"order": "ripple_order", "amplitude": "ripple", "phase": "ripple_phase"},
    ),
    "torque_bias": Effect(lambda s: {"bias": s.sign()}, ("bias",), {"bias": "bias"}),
    "transport_delay": Effect(lambda _: {"delay": 0.002}, ("delay",), {"delay": "delay"}, 4, (0.0, 0.02)),
    "actuator_lag": Effect(lambda _: {"lag": 0.002}, ("lag",), {"time_constant": "lag"}, 4, (2e-4, 0.02)),
    "backlash": Effect(
        lambda s: {
            "ratio": 0.2,
            "gap": 10 ** s.between(-4.5, -3.5),
            "mode_frequency": s.between(30.0, 60.0),
            "mode_damping": 0.1,
        },
        ("ratio",),
        {"gap": "gap", "inertia_ratio": "ratio"},
        3,
        (0.005, 0.5),
    ),
    "flexible_mode": Effect(
        lambda s: {
            "ratio": 0.2,
            "mode_frequency": s.between(12.0, 32.0),
            "mode_damping": s.between(0.015, 0.05),
        },
        ("ratio",),
        {"frequency": "mode_frequency", "damping": "mode_damping", "inertia_ratio": "ratio"},
        3,
        (0.005, 0.5),
    ),
    "position_dependent_inertia": Effect(
        lambda s: {"inertia_variation": 0.1, "inertia_phase": s.phase()},
        ("inertia_variation",),
        {"amplitude": "inertia_variation", "phase": "inertia_phase"},
        1,
        (0.0, 0.7),
    ),
    "imbalance": Effect(
        lambda s: {"imbalance": 3.0, "imbalance_phase": s.phase()},
        ("imbalance",),
        {"amplitude": "imbalance", "phase": "imbalance_phase"},
    ),
    "cable_wrap": Effect(
        lambda s: {"cable": 1.0, "cable_cubic": s.between(0.0, 0.05)},
        ("cable", "cable_cubic"),
        {"stiffness": "cable", "cubic": "cable_cubic"},
    ),
    "cable_hysteresis": Effect(
        lambda s: {"hysteresis": 2.0, "hysteresis_width": 10 ** s.between(-2.0, -1.0)},
        ("hysteresis",),
        {"amplitude": "hysteresis", "width": "hysteresis_width"},
    ),
    "encoder_periodic_error": Effect(
        lambda s: {"encoder_error": 2e-5, "encoder_order": s.order(8, 48), "encoder_phase": s.phase()},
        ("encoder_error",),
        {"order": "encoder_order", "amplitude": "encoder_error", "phase": "encoder_phase"},
    ),
    "periodic_vibration": Effect(
        lambda s: {
            "vibration": 1.0,
            "vibration_frequency": 10 ** s.between(-0.3, 1.0),
            "vibration_phase": s.phase(),
        },
        ("vibration",),
        {"frequency": "vibration_frequency", "amplitude": "vibration", "phase": "vibration_phase"},
    ),
    "load_step": Effect(
        lambda s: {"step": 2.0 * s.sign(), "step_time": s.duration * s.between(0.25, 0.75)},
        ("step",),
        {"step": "step", "time": "step_time"},
    ),
    "cross_axis_coupling": Effect(
        lambda s: {"coupling": 40.0 * s.sign()}, ("coupling",), {"inertia": "coupling"}
    ),
    "wind_torque": Effect(lambda s: {"wind": 0.05 * s.sign()}, ("wind",), {"coefficient": "wind"}),
    "exogenous": Effect(_exogenous, ("wind_linear", "elevation_linear")),
    "unknown:speed_position": Effect(lambda _: {"speed_position": 50.0}, ("speed_position",)),
    "unknown:fading_cogging": Effect(
        lambda s: {"fading": 2.0, "fading_order": s.order(18, 96), "fading_frequency": s.between(0.01, 0.03)},
        ("fading",),
    ),
    "unknown:chaotic_torque": Effect(lambda _: {"chaos": 1.0}, ("chaos",)),
}

# Pairs that would not be one effect each: they act through the same spring, signal or loss
EXCLUSIVE = (
    {"backlash", "flexible_mode"},
    {"transport_delay", "actuator_lag"},
    {"temperature_dependent_friction", "warmup_drift"},
    {"wind_torque", "exogenous"},
    {"cross_axis_coupling", "exogenous"},
)


def compatible(effects: tuple[str, ...]) -> bool:
    """Whether these effects can be concealed together."""
    return not any(pair <= set(effects) for pair in EXCLUSIVE)
