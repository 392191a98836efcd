"""Misspecified worlds: the base of the belief is wrong in a way that no effect of the vocabulary mends, so every name is false.

A simulation of its own, with explicit steps of 25 us: friction by generalised Maxwell slip whose elements are drawn at random,
or by LuGre whose level wanders; a drive that clips or that sags with current; a logger that loses or repeats samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from benchmarks.concealed_motion import draw_environment
from benchmarks.concealed_physics import PERIOD, Encoder, Environment, Physics
from benchmarks.concealed_score import Expected
from benchmarks.trials import Trial, rng_of, signals_of
from benchmarks.worlds import FRICTION, draw_axis
from tcs_friction.config import AxisFile
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.clock import GAP_PERIODS
from tcs_friction.recording.recording import Recording

STRETCH = 0.35  # of the concealed worlds' motion, about 130 s
SUBSTEPS = 80
BELIEF = 0.1  # largest relative error of believed numbers
EACH = 6  # worlds of each kind


class Plant(NamedTuple):
    """What differs from an ordinary axis. No elements: LuGre."""

    levels: np.ndarray  # (m,) shares of the Stribeck level that the slip elements carry, together 1
    springs: np.ndarray  # (m,) N m/rad
    attraction: float  # N m/s, by which a slipping element approaches its level
    factor: np.ndarray  # (n,) on the friction level, per period
    limit: float  # N m, of the drive
    sag: float  # 1/(N m), share of the torque that is lost for each N m


@dataclass(frozen=True)
class Kind:
    """One kind of misspecified world. `settles`: a careful diagnosis can still say that nothing is missing."""

    note: str
    plant: Callable[[np.random.Generator, Physics, Environment], Plant]
    logger: Callable[[np.random.Generator, int], np.ndarray] | None = None
    settles: bool = False


def names() -> list[str]:
    """KIND-1 to KIND-6 of each kind."""
    return [f"{kind}-{i}" for kind in KINDS for i in range(1, EACH + 1)]


def world(name: str, seed: int = 0) -> Trial:
    """The misspecified world of that name."""
    rng = rng_of(name, seed)
    kind = KINDS[name.rpartition("-")[0]]
    environment = draw_environment(rng, STRETCH)
    physics = draw_axis(rng)
    plant = kind.plant(rng, physics, environment)
    out = simulate(physics, environment, Encoder(), plant, SUBSTEPS)
    recording = logged(environment, out, kind.logger(rng, len(out)) if kind.logger else None)
    file = AxisFile(believe(rng, physics), signals_of(recording))
    expected = Expected((), physics.torque_noise, partial=not kind.settles)
    details = {"inertia": physics.inertia, "friction": {key: getattr(physics, key) for key in FRICTION}}
    return Trial(name, recording, file, expected, kind.note, details | _told(plant))


def _told(plant: Plant) -> dict[str, Any]:
    numbers = {
        "levels": plant.levels.tolist(),
        "springs": plant.springs.tolist(),
        "attraction": plant.attraction,
    }
    wander = {"wander_rms": float(plant.factor.std())}
    return (numbers if len(plant.levels) else {}) | wander | {"limit": plant.limit, "sag": plant.sag}


def ordinary(environment: Environment) -> Plant:
    """An axis like any other."""
    none = np.zeros(0)
    return Plant(none, none, 0.0, np.ones(len(environment.reference)), 1e12, 0.0)


def slipping(rng: np.random.Generator, physics: Physics, environment: Environment) -> Plant:
    """8 to 16 unequal elements that slip after 0.2 to 3 bristle widths, with the attraction of Lampaert et al. (2003)."""
    count = int(rng.integers(8, 17))
    levels = rng.dirichlet(np.full(count, 1.5))
    width = physics.coulomb / physics.stiffness * np.exp(rng.uniform(math.log(0.2), math.log(3.0), count))
    springs = levels * physics.coulomb / width
    attraction = physics.coulomb * math.exp(rng.uniform(math.log(2.0), math.log(30.0)))
    return ordinary(environment)._replace(levels=levels, springs=springs, attraction=attraction)


def wandering(rng: np.random.Generator, _physics: Physics, environment: Environment) -> Plant:
    """A random walk of the friction level, 1.5 to 4 % rms over the recording."""
    steps = np.cumsum(rng.standard_normal(len(environment.reference)))
    steps -= steps.mean()
    return ordinary(environment)._replace(factor=1.0 + rng.uniform(0.015, 0.04) * steps / steps.std())


def highest(physics: Physics, environment: Environment) -> float:
    """Largest torque that following the reference takes, N m."""
    speed = environment.reference_velocity
    steady = physics.coulomb * np.sign(speed) + physics.viscous * speed
    return float(np.abs(physics.inertia * np.gradient(speed, PERIOD) + steady).max())


def clipping(rng: np.random.Generator, physics: Physics, environment: Environment) -> Plant:
    """A drive that gives 80 to 95 % of the highest torque; the command is logged as it was asked."""
    return ordinary(environment)._replace(limit=rng.uniform(0.8, 0.95) * highest(physics, environment))


def sagging(rng: np.random.Generator, physics: Physics, environment: Environment) -> Plant:
    """A torque constant that sags by 5 to 20 % at the highest torque: a magnetic circuit that saturates."""
    return ordinary(environment)._replace(sag=rng.uniform(0.05, 0.2) / highest(physics, environment))


def losing(rng: np.random.Generator, count: int) -> np.ndarray:
    """Samples that are logged: 2 % lost one by one, and ten to thirty gaps of 10 to 200 ms."""
    kept = rng.random(count) > 0.02
    for start in rng.integers(0, count, int(rng.integers(10, 31))):
        kept[start : start + int(rng.uniform(0.01, 0.2) / PERIOD)] = False
    kept[[0, -1]] = True
    return np.flatnonzero(kept)


def repeating(rng: np.random.Generator, count: int) -> np.ndarray:
    """For each stamp the sample that was logged: 3 % are that of the stamp before, in bursts of up to five."""
    index = np.arange(count)
    for start in rng.integers(1, count - 6, int(0.03 * count / 3.0)):
        index[start : start + int(rng.integers(1, 6))] = index[start - 1]
    return index


KINDS: Mapping[str, Kind] = {
    "slip-elements": Kind("friction by slip elements with nonlocal memory and attraction", slipping),
    "wandering-friction": Kind("friction whose level wanders", wandering),
    "clipping-drive": Kind("a drive that clips, its command logged", clipping),
    "sagging-constant": Kind("a torque constant that sags with current", sagging),
    "lost-samples": Kind("lost samples", lambda _r, _p, e: ordinary(e), losing, settles=True),
    "repeated-samples": Kind("repeated samples", lambda _r, _p, e: ordinary(e), repeating),
}


def logged(e: Environment, out: np.ndarray, index: np.ndarray | None) -> Recording:
    """What the logger wrote: stamps of their own for repeated samples, none for lost ones; cut where a reader of a bag cuts."""
    count = len(out)
    index = np.arange(count) if index is None else index
    stamps = np.arange(count) if len(index) == count else index
    others = {"elevation_velocity": e.elevation_velocity[stamps], "wind_speed": e.wind[stamps]}
    cuts = [0, *(np.flatnonzero(np.diff(stamps) > GAP_PERIODS) + 1).tolist(), len(stamps)]
    return Recording(
        np.asarray(stamps * PERIOD, dtype=np.float64),
        out[index, 0],
        out[index, 2],
        velocity=out[index, 1],
        temperature=e.temperature[stamps],
        exogenous=others,
        segments=tuple(slice(a, b) for a, b in pairwise(cuts) if b - a >= 2),
        source="world",
    )


def believe(rng: np.random.Generator, physics: Physics) -> Axis:
    """LuGre with every number up to BELIEF off."""

    def off(value: float) -> float:
        return value * (1.0 + BELIEF * float(rng.uniform(-1.0, 1.0)))

    values = {key: off(getattr(physics, key)) for key in FRICTION}
    values["static"] = max(values["static"], values["coulomb"])
    return Axis("azimuth", off(physics.inertia), instance(law("lugre"), values), actuation_delay=0.5 * PERIOD)


@njit(cache=True, error_model="numpy")
def simulate(p: Any, e: Any, encoder: Any, plant: Any, substeps: int) -> Any:
    """Closed loop over the whole reference; (n, 3): measured position (rad) and velocity (rad/s), torque command (N m)."""
    count, elements = len(e.reference), len(plant.levels)
    out, force, slips = np.zeros((count, 3)), np.zeros(elements), np.zeros(elements)
    h = PERIOD / substeps
    q, v, z = e.reference[0], 0.0, 0.0
    before, measured_velocity, integral = q, 0.0, 0.0
    gain = 1.0 - math.exp(-2.0 * math.pi * encoder.velocity_bandwidth * PERIOD)
    for k in range(count):
        measured = encoder.resolution * math.floor((q + e.encoder_noise[k]) / encoder.resolution + 0.5)
        if k > 0:
            measured_velocity += gain * ((measured - before) / PERIOD - measured_velocity)
        before = measured
        wanted = e.reference_velocity[k] + 10.0 * (e.reference[k] - measured)
        further = integral + 6.0 * (wanted - measured_velocity) * PERIOD
        command = 62.8 * p.inertia * (wanted - measured_velocity + further)
        motor = min(max(command, -plant.limit), plant.limit)
        if motor == command:  # the integral rests while the drive is at its limit
            integral = further
        out[k, 0], out[k, 1], out[k, 2] = measured, measured_velocity, command
        motor /= 1.0 + plant.sag * abs(motor)
        noise = p.torque_noise * e.torque_noise[k]
        for _ in range(substeps):
            ratio = v / p.stribeck_velocity
            level = plant.factor[k] * (p.coulomb + (p.static - p.coulomb) * math.exp(-ratio * ratio))
            friction = p.viscous * v
            if elements == 0:
                dz = v - p.stiffness * abs(v) / level * z
                friction += p.stiffness * z + p.damping * dz
                z += h * dz
            else:
                friction += p.damping * v * math.exp(-ratio * ratio)
                for i in range(elements):
                    step_elements(force, slips, plant, i, v, level, h)
                    friction += force[i]
            v += h * (motor + noise - friction) / p.inertia
            q += h * v
    return out


@njit(cache=True, error_model="numpy")
def step_elements(force: Any, slips: Any, plant: Any, i: int, v: float, level: float, h: float) -> None:
    """One element sticks as a spring until its share of the level, slips towards it, sticks again at a reversal."""
    share = plant.levels[i] * level
    direction = 1.0 if v >= 0.0 else -1.0
    if slips[i] != 0.0 and slips[i] != direction:
        slips[i] = 0.0
    if slips[i] == 0.0:
        force[i] += plant.springs[i] * v * h
        if force[i] * direction >= share:
            slips[i] = direction
            force[i] = direction * share
    else:
        force[i] += h * plant.attraction * plant.levels[i] * (direction - force[i] / share)
