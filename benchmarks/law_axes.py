"""Axes of any friction law drawn at random, of the size of a 1.2 m telescope's azimuth axis."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance

ENCODER = Sensors(resolution=2.4240684e-8, noise=4.8481368e-8, velocity_bandwidth=100.0)  # 0.005" and 0.01"
INERTIA = (800.0, 1300.0)
RANGES: Mapping[str, tuple[float, float]] = {
    "coulomb": (60.0, 105.0),
    "static": (1.22, 1.58),  # times coulomb
    "stribeck_velocity": (4.8e-4, 8.5e-4),
    "stiffness": (2.2e5, 4.2e5),
    "damping": (0.4, 0.9),  # times the critical one
    "viscous": (350.0, 650.0),
    "exponent": (0.8, 2.2),
    "shape_1": (0.85, 1.15),
    "shape_2": (0.85, 1.15),
    "shape_3": (0.85, 1.15),
    "transient": (15.0, 40.0),
    "presliding_distance": (6e-4, 1.5e-3),
    "ratio": (0.2, 0.5),
    "spread": (0.5, 1.5),
    "load": (0.05, 0.15),
    "load_stribeck": (0.02, 0.08),
}
WRAP = 9000.0  # N m/rad, known, for laws that depend on the load: +-60 N m; one that is constant would not tell its share


def draw(name: str, random: np.random.Generator) -> Axis:
    """An axis with that law; LuGre's are those of `accuracy.draw`."""
    term = law(name)
    inertia = random.uniform(*INERTIA)
    values = {p.name: random.uniform(*RANGES[p.name]) for p in term.parameters if p.name in RANGES}
    if "static" in values:
        values["static"] *= values["coulomb"]
    if "damping" in values:
        values["damping"] *= 2.0 * math.sqrt(values["stiffness"] * inertia)
    defaults = {p.name: p.default for p in term.parameters if p.name not in RANGES and p.default is not None}
    drive = Drive(limit=1000.0, noise=random.uniform(0.2, 0.33), noise_bandwidth=10.0)
    return Axis(
        "azimuth", inertia, instance(term, {**defaults, **values}), known(name), sensors=ENCODER, drive=drive
    )


def known(name: str) -> tuple[Instance, ...]:
    """What is known of the axis beside the law: a load, if the friction depends on it."""
    if not any(p.name == "load" for p in law(name).parameters):
        return ()
    return (instance(effect("cable_wrap"), {"stiffness": WRAP}),)
