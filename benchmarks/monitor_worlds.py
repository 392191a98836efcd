"""What the benchmark `monitor` watches: an axis that moves at random through the day, models of it, and changes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tcs_friction.config import AxisFile, load_axis, shipped
from tcs_friction.control.loop import LoopConfig, LoopRun, simulate_loop
from tcs_friction.monitor.residual import COLUMNS, evaluator, follow, interrupt, ticks_per_block
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

Array = NDArray[np.float64]
Values = dict[str, float]

PERIOD = LoopConfig().period
SEGMENT = 600.0  # s between two motions
TRAVEL = 0.25  # rad either way
FADE = 4.0  # s in which a motion begins and ends
COMPONENTS = 4
PERIODS = (20.0, 200.0)  # s, of the sines
SPEEDS = (2e-3, 2e-2)  # rad/s, of each sine
MEAN, DAY, WEATHER = 14.0, 8.0, 1.0  # degC: of the day, amplitude of its sine, and of that of a segment
OFF = 0.02
DEVIATIONS = 5.0  # of a matched filter in RECORDING seconds: the limit of detection
RECORDING = 60.0  # s
SLOW = 60.0  # s, time constant of a slow change
BUMP_WIDTH = 0.02  # rad
ORDERS = (90.0, 300.0)  # 1/turn, of a new cogging line


@dataclass(frozen=True)
class Course:
    """A motion that begins and ends at rest: a sum of sines, faded in and out."""

    centre: float  # rad
    amplitudes: Array  # rad
    frequencies: Array  # rad/s
    phases: Array
    duration: float = SEGMENT

    def over(self, times: ArrayLike) -> Array:
        """Position, velocity and acceleration (n, 3)."""
        t = np.asarray(times, dtype=np.float64)
        edge = np.clip(np.minimum(t, self.duration - t) / FADE, 0.0, 1.0)
        fade = edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2)
        q = self.centre + fade * (np.sin(self.frequencies * t[:, None] + self.phases) @ self.amplitudes)
        v = np.gradient(q, t)
        return np.column_stack([q, v, np.gradient(v, t)])


def draw_course(rng: np.random.Generator) -> Course:
    """A motion within the travel, at speeds of its own."""
    frequencies = 2.0 * np.pi / _between(rng, PERIODS)
    amplitudes = _between(rng, SPEEDS) / frequencies
    amplitudes *= min(1.0, TRAVEL / amplitudes.sum())
    room = max(TRAVEL - amplitudes.sum(), 0.0)
    return Course(rng.uniform(-room, room), amplitudes, frequencies, rng.uniform(0.0, 2.0 * np.pi, COMPONENTS))


def _between(rng: np.random.Generator, limits: tuple[float, float]) -> Array:
    """COMPONENTS numbers whose logarithms are evenly spread."""
    return np.asarray(np.exp(rng.uniform(math.log(limits[0]), math.log(limits[1]), COMPONENTS)))


def temperature_over(rng: np.random.Generator, begin: float, count: int) -> Array:
    """degC (n,) from `begin` (s) on: through the day, and a little up and down in the segment."""
    t = PERIOD * np.arange(count)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    weather = WEATHER * (np.sin(2.0 * np.pi * t / SEGMENT + phase) - math.sin(phase))
    return np.asarray(MEAN + DAY * np.sin(2.0 * np.pi * (begin + t) / 86400.0) + weather)


@dataclass(frozen=True)
class World:
    """An axis under its controller; `seed` is of all its motions and noise."""

    file: AxisFile
    axis: Axis
    seed: int

    def run(self, number: int, begin: float, axis: Axis | None = None) -> tuple[LoopRun, Array]:
        """Segment `number`, which begins at a time of the day (s), and its temperature (n,). `axis`: a changed one."""
        assert self.file.control is not None
        rng = np.random.default_rng((self.seed, number))
        course = draw_course(rng)
        temperature = temperature_over(rng, begin, round(course.duration / PERIOD) + 1)
        controller, noise = self.file.control.controller, int(rng.integers(2**31))
        run = simulate_loop(axis or self.axis, course, controller, LoopConfig(), seed=noise, temperature=temperature)
        return run, temperature


def world(seed: int) -> World:
    """The shipped axis with friction that follows the temperature."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    values = {"dry": -0.003, "viscous": -0.01, "reference_temperature": 20.0}
    return World(file, file.axis.with_effect(instance(effect("temperature_dependent_friction"), values)), seed)


def model_off(axis: Axis) -> Axis:
    """The axis with every number of its terms 2 % off, up and down in turns, and without its cogging."""
    signs = iter((1.0, -1.0) * 20)

    def off(item: Any) -> Any:
        kept = "reference_temperature"
        return item.replace(**{n: x if n == kept else x * (1.0 + next(signs) * OFF) for n, x in item.values.items()})

    effects = tuple(off(item) for item in axis.effects if item.term.id != "cogging")
    return replace(axis, inertia=axis.inertia * (1.0 + OFF), friction=off(axis.friction), effects=effects)


class Follower:
    """A model that follows runs one after the other."""

    def __init__(self, axis: Axis) -> None:
        self.axis = axis
        self._evaluator = evaluator(axis, PERIOD)

    def blocks(self, run: LoopRun, temperature: Array) -> Array:
        """The blocks (n, COLUMNS) of a run; temperature (n,)."""
        interrupt(self._evaluator)
        out = np.empty((len(run.t) // ticks_per_block(PERIOD) + 1, COLUMNS))
        count = follow(self._evaluator, run.position, run.torque, temperature[:, None].copy(), out)
        return out[:count]


@dataclass(frozen=True)
class Change:
    """A change of an axis. draw: what is random about it, in a run; torque: its (n,) for size 1; apply: it to an axis."""

    name: str
    draw: Callable[[np.random.Generator, LoopRun], Values]
    torque: Callable[[Axis, LoopRun, Values], Array]
    apply: Callable[[Axis, float, Values], Axis]


def _nothing(_: np.random.Generator, __: LoopRun) -> Values:
    return {}


def _place(rng: np.random.Generator, run: LoopRun) -> Values:
    seen = run.true_position[: round(RECORDING / PERIOD)]
    return {"centre": float(rng.uniform(*np.quantile(seen, (0.1, 0.9)))), "width": BUMP_WIDTH}


def _line(rng: np.random.Generator, _: LoopRun) -> Values:
    return {"order": float(rng.uniform(*ORDERS)), "phase": float(rng.uniform(0.0, 2.0 * np.pi))}


def _bump_torque(axis: Axis, run: LoopRun, values: Values) -> Array:
    distance = (run.true_position - values["centre"]) / values["width"]
    return np.asarray(axis.dry_level * np.sign(run.true_velocity) * np.exp(-(distance**2)))


def _more_coulomb(axis: Axis, size: float, _: Values) -> Axis:
    return axis.with_friction({name: axis.friction.values[name] + size for name in ("coulomb", "static")})


def _with(name: str) -> Callable[[Axis, float, Values], Axis]:
    return lambda axis, size, values: axis.with_effect(instance(effect(name), {"amplitude": size, **values}))


def _slowly(axis: Axis, size: float, _: Values) -> Axis:
    """Viscous friction that ends `size` times larger: it begins by that much too small, and rises."""
    slow = instance(effect("warmup_drift"), {"viscous": -size / (1.0 + size), "time_constant": SLOW})
    return axis.with_friction({"viscous": axis.friction.values["viscous"] * (1.0 + size)}).with_effect(slow)


CHANGES = (
    Change("more Coulomb friction", _nothing, lambda _, run, __: np.sign(run.true_velocity), _more_coulomb),
    Change("a bump", _place, _bump_torque, _with("local_friction_bump")),
    Change(
        "a new cogging line",
        _line,
        lambda _, run, values: np.cos(values["order"] * run.true_position + values["phase"]),
        _with("cogging"),
    ),
    Change(
        "slow lubricant change",
        _nothing,
        lambda axis, run, _: axis.friction.values["viscous"] * run.true_velocity * -np.expm1(-run.t / SLOW),
        _slowly,
    ),
)


def limit_of(axis: Axis, torque: Array) -> float:
    """The size at which a matched filter has DEVIATIONS standard deviations in RECORDING seconds; torque (n,) of size 1."""
    first = torque[: round(RECORDING / PERIOD)]
    return DEVIATIONS / math.sqrt(float(np.sum(first**2)) * PERIOD / noise_density(axis))


def noise_density(axis: Axis) -> float:
    """Two-sided power density of the torque noise far below its bandwidth, N^2 m^2/Hz."""
    return axis.drive.noise**2 / (math.pi * axis.drive.noise_bandwidth)
