"""Worlds on MuJoCo: what is missing in the belief is made by a physics engine that nobody here wrote.

Two classes of axis, a telescope's of some 1e3 kg m^2 and a robot joint of some 1 kg m^2, in closed loop. Friction is the engine's
LuGre, or its dry and viscous friction; somebody believes inertia and friction up to 10 % off. A name says class and what is
missing, `telescope-spring`; several names joined by a plus are missing together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from benchmarks.concealed_score import Expected
from benchmarks.mujoco_axis import Loop, Model, Unstable, run
from benchmarks.mujoco_effects import EFFECTS, Setting, Truth
from benchmarks.mujoco_motion import (
    Motion,
    robot_experiment,
    robot_shift,
    telescope_experiment,
    telescope_night,
)
from benchmarks.mujoco_surroundings import SURROUNDINGS
from benchmarks.trials import Trial, rng_of, signals_of
from tcs_friction.config import AxisFile
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance

BELIEF = 0.1  # largest relative error of believed numbers
SIZES = (3.0, 8.0)  # torque rms of an effect over that of the noise
TRIALS = 5  # draws of an effect until one can be built and controlled
TELESCOPE, ROBOT = "telescope", "robot"
PERIOD = {TELESCOPE: 0.002, ROBOT: 0.001}  # s
SUBSTEPS = {TELESCOPE: 20, ROBOT: 10}

# What is believed where the belief lacks nothing, and where it lacks a part of the law
BASES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "nothing": ("lugre", ()),
    "nothing-dry": ("coulomb_viscous", ()),
    "nothing-known-gravity": ("lugre", ()),
    "nothing-away": ("lugre", ()),
    "nothing-ordinary": ("lugre", ()),
    "bristles": ("stribeck_static", ("presliding",)),
    "bristles-and-drop": ("coulomb_viscous", ("stribeck", "presliding")),
}
PARTS = {**EFFECTS, **SURROUNDINGS}
TELESCOPE_ONLY = ("wind",)
TOGETHER = (
    "telescope-gravity+cogging",
    "telescope-spring+coupling",
    "telescope-mode+drag",
    "telescope-wind+load-step",
    "robot-gravity+cogging",
    "robot-spring+drag",
    "robot-mode+gravity",
    "robot-coupling+bias",
    "robot-cogging+dry",
    "robot-gravity+dry",
)


def names() -> list[str]:
    """All worlds: about fifty."""
    single = [*BASES, *EFFECTS, *SURROUNDINGS]
    classes = {TELESCOPE: single, ROBOT: [name for name in single if name not in TELESCOPE_ONLY]}
    return [f"{of}-{name}" for of, listed in classes.items() for name in listed] + list(TOGETHER)


def world(name: str, seed: int = 0, refine: int = 1) -> Trial:
    """The world of that name. `refine` divides the engine's step and changes nothing else."""
    for trial in range(TRIALS):
        try:
            return _drawn(name, np.random.default_rng([*_seeds(name, seed), trial]), refine)
        except (Unstable, ValueError):
            continue
    raise RuntimeError(f"{name}: no draw of {TRIALS} could be built and controlled")


def _seeds(name: str, seed: int) -> list[int]:
    return [int(x) for x in rng_of(name, seed).integers(2**31, size=2)]


def _drawn(name: str, rng: np.random.Generator, refine: int) -> Trial:
    of, _, rest = name.partition("-")
    parts = rest.split("+")
    dry = "nothing-dry" in parts or "dry" in parts
    s = draw(rng, of == TELESCOPE, rest == "nothing-ordinary", dry)
    truths = [PARTS[part](s) for part in parts if part in PARTS]
    lawful, lacking = BASES.get(rest, ("coulomb_viscous" if dry else "lugre", ()))
    known: dict[str, float] | None = None
    if rest == "nothing-known-gravity":
        EFFECTS["gravity"](s)
        known = {"amplitude": s.details["amplitude"], "phase": s.details["phase"]}
    away = s.between(0.5, 2.0) * (0.002 if s.telescope else 0.02) if rest == "nothing-away" else 0.0
    recording = run(s.model, s.motion, s.loop, rng, away, s.exogenous, refine=refine)
    file = AxisFile(believe(rng, s, lawful, known), signals_of(recording))
    missing = tuple(truth.note for truth in truths) + lacking
    details = {"inertia": s.inertia, "friction": dict(s.friction), "parts": s.details, "loop": asdict(s.loop)}
    note = f"MuJoCo, {of}: {'; '.join(missing) or 'nothing is missing'}"
    return Trial(name, recording, file, _expected(truths, lacking, s.floor), note, details)


def _expected(truths: list[Truth], lacking: tuple[str, ...], floor: float) -> Expected:
    return Expected(
        tuple((name,) for name in lacking) + tuple(ids for truth in truths for ids in truth.effects),
        floor,
        frozenset().union(*(truth.tolerated for truth in truths)),
        any(truth.outside for truth in truths),
        any(truth.partial for truth in truths),
    )


def draw(rng: np.random.Generator, telescope: bool, ordinary: bool, dry: bool) -> Setting:
    """An axis of the class without any effect, and the motion that it is asked for."""
    period, substeps = PERIOD[TELESCOPE if telescope else ROBOT], SUBSTEPS[TELESCOPE if telescope else ROBOT]
    if telescope:
        inertia, coulomb = rng.uniform(800.0, 1300.0), rng.uniform(60.0, 105.0)
        stiffness, viscous, stribeck = (
            rng.uniform(2.2e5, 4.2e5),
            rng.uniform(350.0, 650.0),
            rng.uniform(4.8e-4, 8.5e-4),
        )
        floor = rng.uniform(0.2, 0.33)
        motion = (telescope_night if ordinary else telescope_experiment)(rng, period)
        gains, resolution, seen = (62.8, 10.0, 6.0), math.radians(0.002 / 3600.0), math.radians(0.01 / 3600.0)
    else:
        inertia, coulomb = math.exp(rng.uniform(math.log(0.3), math.log(3.0))), 0.0
        coulomb = inertia**0.7 * rng.uniform(4.0, 8.0)
        stiffness, viscous = coulomb / rng.uniform(3e-4, 1.2e-3), coulomb * rng.uniform(0.3, 0.8)
        stribeck, floor = rng.uniform(0.01, 0.04), coulomb * rng.uniform(0.008, 0.015)
        motion = (robot_shift if ordinary else robot_experiment)(rng, period)
        gains, resolution, seen = (75.0, 15.0, 8.0), 2.0 * math.pi / 2**23, 5e-7
    friction = {
        "coulomb": coulomb,
        "static": coulomb * rng.uniform(1.22, 1.58),
        "stribeck_velocity": stribeck,
        "stiffness": stiffness,
        "damping": rng.uniform(0.4, 0.9) * 2.0 * math.sqrt(stiffness * inertia),
        "viscous": viscous,
    }
    loop = Loop(substeps, gains[0] * inertia, gains[1], gains[2], resolution, seen, floor, 30.0 * coulomb)
    size = math.exp(rng.uniform(*np.log(SIZES)))
    model = Model(inertia)
    model.actuators.append(_dry(model, friction) if dry else _lugre(friction))
    return Setting(rng, telescope, inertia, floor, size, _shifted(rng, motion), loop, model, friction)


def _shifted(rng: np.random.Generator, motion: Motion) -> Motion:
    """The encoder's zero is anywhere near the travel's middle."""
    by = rng.uniform(-0.1, 0.1) * float(np.ptp(motion.position))
    return Motion(motion.period, motion.position + by, motion.velocity, motion.acceleration)


def _lugre(friction: Mapping[str, float]) -> str:
    values = " ".join(
        f"{friction[k]:.9g}" for k in ("stiffness", "damping", "coulomb", "static", "stribeck_velocity")
    )
    return (
        '<dcmotor name="friction" joint="axis" motorconst="1e-9" resistance="1" input="none" '
        f'lugre="{values}" damping="{friction["viscous"]:.9g} 0 0"/>'
    )


def _dry(model: Model, friction: Mapping[str, float]) -> str:
    """The engine's dry friction is a soft constraint; it is made as hard as the step allows."""
    model.hinge |= {
        "frictionloss": f"{friction['coulomb']:.9g}",
        "solreffriction": "4e-4 1",
        "solimpfriction": "0.999 0.9999 1e-6",
    }
    return f'<general name="friction" joint="axis" gainprm="0" damping="{friction["viscous"]:.9g} 0 0"/>'


def believe(rng: np.random.Generator, s: Setting, name: str, known: Mapping[str, float] | None) -> Axis:
    """The axis as somebody believes it, every number up to BELIEF off."""

    def off(value: float) -> float:
        return value * (1.0 + BELIEF * float(rng.uniform(-1.0, 1.0)))

    term = law(name)
    declared = {p.name for p in term.parameters}
    values = {key: off(value) for key, value in s.friction.items()}
    values["static"] = max(values["static"], values["coulomb"])
    friction = instance(term, {key: value for key, value in values.items() if key in declared})
    effects: tuple[Instance, ...] = ()
    if known is not None:
        phase = known["phase"] + BELIEF * float(rng.uniform(-1.0, 1.0))
        effects = (instance(effect("imbalance"), {"amplitude": off(known["amplitude"]), "phase": phase}),)
    return Axis("azimuth", off(s.inertia), friction, effects, actuation_delay=0.5 * s.motion.period)
