"""Worlds with concealed effects: a recording, what somebody believes about the axis, and the sealed truth."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from benchmarks.concealed_effects import EFFECTS, OUTSIDE, Effect, Setting, compatible
from benchmarks.concealed_motion import draw_environment
from benchmarks.concealed_physics import PERIOD, SUBSTEPS, Encoder, Environment, Physics, simulate
from tcs_friction.config import AxisFile, save_axis, write_whole
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.write import write_recording

DRAFT_SUBSTEPS = 10  # of the runs that only find an effect's size
UNSTABLE = 10.0  # times the highest torque without effects, that no stable controller asks for
SMOOTHING = (
    0.004  # s, of the torque whose rms is an effect's size: nothing above 40 Hz is seen as acceleration
)

FRICTION = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous")
SIGNALS = {
    "position": {"topic": "/joint_states", "field": "position", "joint": "azimuth"},
    "velocity": {"topic": "/joint_states", "field": "velocity", "joint": "azimuth"},
    "torque": {"topic": "/joint_states", "field": "effort", "joint": "azimuth"},
    "temperature": {"topic": "/temperature", "field": "temperature"},
    "exogenous": {
        "elevation_velocity": {"topic": "/joint_states", "field": "velocity", "joint": "elevation"},
        "wind_speed": {"topic": "/wind", "field": "vector.x"},
    },
}


@dataclass(frozen=True)
class Truth:
    """What was concealed. `torque_rms`: of each effect alone, N m; `effect_torque_rms` of all together."""

    effects: tuple[str, ...]
    parameters: dict[str, dict[str, float]]
    torque_rms: dict[str, float]
    effect_torque_rms: float
    noise_floor: float
    inertia: float
    friction: dict[str, float]


@dataclass(frozen=True)
class World:
    """One concealed world. `effect_torque` (n,): exact torque of all effects, N m; what an oracle seeks."""

    recording: Recording
    believed: AxisFile
    truth: Truth
    physics: Physics
    effect_torque: Column = field(repr=False)

    def recorded_again(self, rng: np.random.Generator) -> Recording:
        """The same axis on another day: another motion, weather and noise."""
        environment = draw_environment(rng, 1.0)
        return _recording(environment, simulate(self.physics, environment, Encoder(), SUBSTEPS))


def draw_world(
    rng: np.random.Generator, effects: Sequence[str] | int, size: float = 4.0, stretch: float = 1.0
) -> World:
    """A world with the named effects, or so many at random, each `size` times the noise floor's torque rms.

    `stretch` scales the recording's length; 1 is about 340 s. An effect that cannot have the size (it would
    need an inertia ratio above a half, say) comes as near as it can; the truth says what became of it. Effects with which the
    controller is unstable are drawn again.
    """
    chosen = tuple(effects) if not isinstance(effects, int) else draw_effects(rng, effects)
    environment = draw_environment(rng, stretch)
    physics = plain = draw_axis(rng)
    values: dict[str, dict[str, float]] = {}
    rms: dict[str, float] = {}
    for name in chosen:
        values[name], rms[name] = _sized(
            Setting(rng, physics, environment), EFFECTS[name], size * physics.torque_noise
        )
    for name in chosen:
        physics = applied(physics, values[name])
    out = simulate(physics, environment, Encoder(), SUBSTEPS)
    without = simulate(plain, environment, Encoder(), DRAFT_SUBSTEPS)
    if np.abs(out[:, 2]).max() > UNSTABLE * np.abs(without[:, 2]).max():
        return draw_world(rng, effects, size, stretch)
    torque = effect_torque(physics, out)
    truth = Truth(
        chosen,
        {name: _named(EFFECTS[name], physics) for name in chosen},
        rms,
        _rms(torque),
        physics.torque_noise,
        physics.inertia,
        {name: getattr(physics, name) for name in FRICTION},
    )
    return World(_recording(environment, out), believe(rng, physics), truth, physics, torque)


def draw_effects(rng: np.random.Generator, count: int) -> tuple[str, ...]:
    """So many different effects of the vocabulary that can go together."""
    known = [name for name in EFFECTS if name not in OUTSIDE]
    while True:
        chosen = tuple(str(name) for name in rng.choice(known, count, replace=False))
        if compatible(chosen):
            return chosen


def draw_axis(rng: np.random.Generator) -> Physics:
    """A telescope's azimuth axis without any effect."""
    coulomb = rng.uniform(60.0, 105.0)
    inertia = rng.uniform(800.0, 1300.0)
    stiffness = rng.uniform(2.2e5, 4.2e5)
    return Physics(
        inertia=inertia,
        coulomb=coulomb,
        static=coulomb * rng.uniform(1.22, 1.58),
        stribeck_velocity=rng.uniform(4.8e-4, 8.5e-4),
        stiffness=stiffness,
        damping=rng.uniform(0.4, 0.9) * 2.0 * math.sqrt(stiffness * inertia),
        viscous=rng.uniform(350.0, 650.0),
        torque_noise=rng.uniform(0.2, 0.33),
    )


def applied(physics: Physics, values: dict[str, float]) -> Physics:
    """The axis with an effect's values; `drop` is static above coulomb."""
    fields = dict(values)
    if "drop" in fields:
        fields["static"] = physics.coulomb + fields.pop("drop")
    return physics._replace(**fields)


def effect_torque(physics: Physics, out: Column) -> Column:
    """Torque (n,) that the effects alone explain, as far down in time as accelerations are seen, N m."""
    torque = out[:, 3]
    if physics.encoder_error != 0.0:
        error = physics.encoder_error * np.sin(physics.encoder_order * out[:, 0] + physics.encoder_phase)
        rate = np.gradient(gaussian_filter1d(error, SMOOTHING / PERIOD), PERIOD)
        torque = torque + physics.inertia * np.gradient(rate, PERIOD) + physics.viscous * rate
    return np.asarray(gaussian_filter1d(torque, SMOOTHING / PERIOD), dtype=np.float64)


def _sized(setting: Setting, effect: Effect, wanted: float) -> tuple[dict[str, float], float]:
    """An effect's values such that its torque has the wanted rms (N m), and the rms it has."""
    values = effect.draw(setting)
    rms = 0.0
    for _ in range(effect.rounds):
        physics = applied(setting.physics, values)
        rms = _rms(effect_torque(physics, simulate(physics, setting.environment, Encoder(), DRAFT_SUBSTEPS)))
        if not effect.scaled:
            break
        factor = wanted / rms
        lead = next(name for name in effect.scaled if name in values)
        limited = float(np.clip(values[lead] * factor, *effect.limits))
        factor = limited / values[lead]
        rms *= factor
        values |= {name: values[name] * factor for name in effect.scaled if name in values}
    return values, rms


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _named(effect: Effect, physics: Physics) -> dict[str, float]:
    return {name: float(getattr(physics, source)) for name, source in effect.names.items()}


def _recording(e: Environment, out: Column) -> Recording:
    t = np.arange(len(out), dtype=np.float64) * PERIOD
    return Recording(
        t,
        out[:, 0],
        out[:, 2],
        velocity=out[:, 1],
        temperature=e.temperature,
        exogenous={"elevation_velocity": e.elevation_velocity, "wind_speed": e.wind},
        source="world",
    )


def believe(rng: np.random.Generator, physics: Physics) -> AxisFile:
    """What somebody believes: values a few per cent off, no effects, the law less what is concealed in it."""
    names = {
        (1.0, 1.0): "lugre",
        (1.0, 0.0): "stribeck_static",
        (0.0, 1.0): "dahl_viscous",
        (0.0, 0.0): "coulomb_viscous",
    }
    term = law(names[physics.believed_drop, physics.believed_bristle])
    declared = {parameter.name for parameter in term.parameters}
    values = {name: getattr(physics, name) * (1.0 + 0.03 * rng.standard_normal()) for name in FRICTION}
    values["static"] = max(values["static"], values["coulomb"])
    friction = instance(term, {name: value for name, value in values.items() if name in declared})
    inertia = physics.inertia * (1.0 + 0.01 * rng.standard_normal())
    axis = Axis("azimuth", inertia, friction, actuation_delay=0.5 * PERIOD)
    return AxisFile(axis, SignalMap.from_mapping(SIGNALS, "world"))


def write_world(world: World, folder: Path, sealed: Path) -> None:
    """Bag and believed axis into `folder`, the truth into `sealed`; neither names the other."""
    signals = world.believed.signals
    assert signals is not None
    folder.mkdir(parents=True, exist_ok=True)
    write_recording(folder / "recording", world.recording, signals)
    save_axis(folder / "axis.yaml", world.believed)
    write_whole(sealed / "truth.json", json.dumps(_plain(world.truth), indent=1))


def _plain(truth: Truth) -> dict[str, Any]:
    return asdict(truth)
