"""Law worlds: an axis with one friction law, and a belief with another one; alone, or with an effect beside it.

Every pair of laws is a world. Not all laws exist twice, so these worlds are simulated by the product's own terms; what
is tested is the choice between laws, not the equations. What a belief lacks follows from the features that the laws declare,
and from which law contains which for some values of its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.concealed_motion import draw_environment
from benchmarks.concealed_physics import PERIOD, Environment
from benchmarks.concealed_score import Expected
from benchmarks.law_axes import RANGES, draw
from benchmarks.trials import Trial, rng_of, signals_of
from tcs_friction.config import AxisFile
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law, laws
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import Feature, Instance, Role, instance
from tcs_friction.recording.recording import Recording

STRETCH = 0.35  # of the concealed worlds' motion, about 130 s
BELIEF = 0.1  # largest relative error of believed numbers
ACTUATION_DELAY = 0.5 * PERIOD  # of a torque that is held until the next sample
LOAD = 60.0  # N m, of the known spring at the ends of the travel, where friction depends on the load
SIZES = (3.0, 8.0)  # torque rms of an effect over that of the noise

LACKS = {Feature.STRIBECK: "stribeck", Feature.PRESLIDING: "presliding"}
LOADED = "load_dependent_friction"

# What each law can be, for some values of its parameters, beside itself. A stiff enough bristle is none.
CONTAINS: Mapping[str, frozenset[str]] = {
    "coulomb_viscous": frozenset(),
    "stribeck_static": frozenset({"coulomb_viscous"}),
    "dahl_viscous": frozenset({"coulomb_viscous"}),
    "lugre": frozenset({"coulomb_viscous", "stribeck_static", "dahl_viscous"}),
    "free_curve": frozenset({"coulomb_viscous", "stribeck_static", "dahl_viscous", "lugre"}),  # closely enough
    "reset_integrator": frozenset({"coulomb_viscous"}),
    "bliman_sorine": frozenset({"coulomb_viscous", "dahl_viscous"}),
    "maxwell_slip": frozenset({"coulomb_viscous", "stribeck_static"}),
    "bam": frozenset({"coulomb_viscous", "stribeck_static"}),
}
# Laws whose friction falls after the start of motion with the path, or at once, and not with the speed
FALLS_OTHERWISE = frozenset({"bliman_sorine", "reset_integrator"})


@dataclass(frozen=True)
class Setting:
    """What an effect of torque rms 1 N m is drawn from: a generator, the reference's position and speed, the coulomb friction."""

    rng: np.random.Generator
    q: np.ndarray
    v: np.ndarray
    coulomb: float

    def sign(self) -> float:
        return float(self.rng.choice((-1.0, 1.0)))

    def phase(self) -> float:
        return float(self.rng.uniform(0.0, 2.0 * math.pi))


def _imbalance(s: Setting) -> dict[str, float]:
    phase = s.phase()
    return {"amplitude": 1.0 / rms(np.sin(s.q + phase)), "phase": phase}


def _wave(s: Setting, low: int, high: int, level: float) -> dict[str, float]:
    return {
        "order": float(s.rng.integers(low, high + 1)),
        "amplitude": math.sqrt(2.0) / level,
        "phase": s.phase(),
    }


def _step(s: Setting) -> dict[str, float]:
    return {"step": s.sign(), "time": len(s.q) * PERIOD * float(s.rng.uniform(0.3, 0.7))}


# Each effect with the parameter that its size multiplies
EFFECTS: Mapping[str, tuple[str, Callable[[Setting], dict[str, float]]]] = {
    "cogging": ("amplitude", lambda s: _wave(s, 18, 96, 1.0)),
    "imbalance": ("amplitude", _imbalance),
    "quadratic_drag": ("coefficient", lambda s: {"coefficient": s.sign() / rms(s.v * s.v)}),
    "coulomb_asymmetry": ("asymmetry", lambda s: {"asymmetry": s.sign() / s.coulomb}),
    "viscous_asymmetry": ("asymmetry", lambda s: {"asymmetry": s.sign() / rms(s.v)}),
    "position_dependent_friction": ("amplitude", lambda s: _wave(s, 1, 3, s.coulomb)),
    "torque_bias": ("bias", lambda s: {"bias": s.sign()}),
    "load_step": ("step", _step),
}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def names() -> list[str]:
    """BELIEVED-for-TRUE of every pair, and the same with an effect."""
    pairs = [f"{believed}-for-{true}" for true in laws() for believed in laws()]
    return [*pairs, *(f"{pair}-and-effect" for pair in pairs)]


def world(name: str, seed: int = 0) -> Trial:
    """The law world of that name; an effect beside the pair is drawn by the seed."""
    pair, _, beside = name.partition("-and-")
    believed, _, friction = pair.partition("-for-")
    rng = rng_of(name, seed)
    environment = draw_environment(rng, STRETCH)
    reference = environment.reference - environment.reference.mean()
    drawn = draw(friction, rng)
    drive = replace(drawn.drive, limit=math.inf)  # fast motion takes more than the 1 kN m it is drawn with
    axis = replace(drawn, effects=known_load(friction, reference), drive=drive)
    concealed = (drawn_effect(rng, axis, environment),) if beside else ()
    complete = replace(axis, effects=(*axis.effects, *concealed))
    recording = closed_loop(complete, environment, int(rng.integers(2**31)))
    file = AxisFile(belief(rng, axis, believed), signals_of(recording))
    note = f"{friction} friction, believed {believed}" + "".join(
        f"; {item.term.id} is missing" for item in concealed
    )
    details = {
        "inertia": axis.inertia,
        "friction": dict(axis.friction.values),
        "effect_parameters": {item.term.id: dict(item.values) for item in concealed},
    }
    right = expected(believed, friction, concealed, axis.drive.noise)
    true = replace(complete, actuation_delay=ACTUATION_DELAY)
    return Trial(name, recording, file, right, note, details, true)


def expected(believed: str, true: str, concealed: tuple[Instance, ...], noise: float) -> Expected:
    """What the believed law lacks of the true one, and the effects beside it.

    Nothing, where the believed law contains the true one. Otherwise the features that it does not have; where
    both have one in different forms, the feature's name is tolerated, since the believed form of it is wrong.
    Where only the form is wrong, the verdict is free.
    """
    effects = [(item.term.id,) for item in concealed]
    if true == believed or true in CONTAINS[believed]:
        return Expected(tuple(effects), noise)
    here, there = law(believed).features, law(true).features
    effects += [(name,) for feature, name in LACKS.items() if feature in there - here]
    tolerated = {name for feature, name in LACKS.items() if feature in there & here}
    if FALLS_OTHERWISE & {believed, true}:
        tolerated.add("stribeck")
    if true == "bam":
        effects.append((LOADED,))
    named = {ids[0] for ids in effects}
    return Expected(tuple(effects), noise, frozenset(tolerated) - named, partial=not named)


def known_load(true: str, reference: np.ndarray) -> tuple[Instance, ...]:
    """A known spring where friction depends on the load: a load that never changes would not tell its share."""
    if not any(p.name == "load" for p in law(true).parameters):
        return ()
    return (instance(effect("cable_wrap"), {"stiffness": LOAD / float(np.abs(reference).max())}),)


def drawn_effect(rng: np.random.Generator, axis: Axis, environment: Environment) -> Instance:
    """An effect of a size drawn between SIZES."""
    name = str(rng.choice(list(EFFECTS)))
    scaled, draw_values = EFFECTS[name]
    size = axis.drive.noise * math.exp(rng.uniform(*np.log(SIZES)))
    q = environment.reference - environment.reference.mean()
    values = draw_values(Setting(rng, q, environment.reference_velocity, axis.dry_level))
    return instance(effect(name), values | {scaled: size * values[scaled]})


def belief(rng: np.random.Generator, axis: Axis, name: str) -> Axis:
    """The axis as somebody believes it: another law, values up to BELIEF off, those that the true law lacks as on such axes."""
    term = law(name)

    def off(value: float) -> float:
        return value * (1.0 + BELIEF * float(rng.uniform(-1.0, 1.0)))

    values: dict[str, Any] = {}
    true = {p.name: p for p in axis.friction.term.parameters}
    for parameter in term.parameters:
        key = parameter.name
        if parameter.role is Role.FIXED or (key not in true and key not in RANGES):
            continue
        if key in true and true[key].role is not Role.FIXED:
            values[key] = off(axis.friction.values[key])
        elif key == "static":
            values[key] = axis.dry_level * rng.uniform(*RANGES[key])
        elif key == "damping":
            values[key] = rng.uniform(*RANGES[key]) * 2.0 * math.sqrt(values["stiffness"] * axis.inertia)
        else:
            values[key] = rng.uniform(*RANGES[key])
    if "static" in values:
        values["static"] = max(values["static"], values["coulomb"])
    friction = instance(term, values)
    return Axis("azimuth", off(axis.inertia), friction, axis.effects, actuation_delay=ACTUATION_DELAY)


def closed_loop(axis: Axis, environment: Environment, seed: int) -> Recording:
    """The axis under a cascade of loops like that of the concealed worlds; the logged torque acts until the next sample."""
    reference = environment.reference - environment.reference.mean()
    plant = Simulator(axis, PERIOD, seed, float(reference[0]))
    speed_gain, out, integral = 62.8 * axis.inertia, np.empty((len(reference), 3)), 0.0
    for k, (target, speed) in enumerate(
        zip(reference.tolist(), environment.reference_velocity.tolist(), strict=True)
    ):
        position, velocity = plant.measured_position, plant.measured_velocity
        error = speed + 10.0 * (target - position) - velocity
        integral += 6.0 * error * PERIOD
        command = speed_gain * (error + integral)
        out[k] = position, velocity, command
        plant.step(command)
    t = np.arange(len(reference)) * PERIOD
    others = {"elevation_velocity": environment.elevation_velocity, "wind_speed": environment.wind}
    return Recording(
        np.asarray(t, dtype=np.float64),
        out[:, 0],
        out[:, 2],
        velocity=out[:, 1],
        temperature=environment.temperature,
        exogenous=others,
        source="world",
    )
