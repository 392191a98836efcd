"""Friction laws as a fit sees them: torque over a whole motion and its derivatives by the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tcs_friction.conditioning.motion import Motion
from tcs_friction.identify import kernels
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Place, Role

PROLOGUE = (
    24  # samples of steady motion that bring a law's memory to sliding before a stretch that starts in motion
)

STEP = 1e-3  # relative, of central differences: torque that jumps moves in steps of samples, which shorter ones would show
FORGOTTEN = 1e-4  # of the torque's range: less of it depends on what was before a stretch

LEAST_PASSED = 1e-3  # of a torque at the rotor, by friction that grows with it: with none left the axis would lock itself
SLIDING = 0.5  # of the usual torque, at least, in a stretch that starts with sliding friction


class Model(Protocol):
    """A law over one Motion. Parameters are the law's own, in the order of its declaration.

    rest: N m (n,) that inertia and offset require, for friction that grows with the load.
    """

    def torque(self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        """(n,) N m of friction (and effects that depend on it)."""

    def derivatives(
        self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Torque (n,), its derivatives (n, p), and that by the stretch's own initial bristle torque (n,) or None."""


@dataclass(frozen=True, eq=False)
class Background:
    """What is known before the fit, each (n,): torque applied at the rotor, opposing torque of believed effects."""

    rotor: np.ndarray
    opposing: np.ndarray


def background(axis: Axis, motion: Motion) -> Background:
    """Evaluate the axis' effects that do not depend on the friction law."""
    kept = tuple(item for item in axis.effects if item.term.place is not Place.SCALE)
    out = evaluated(replace(axis, effects=kept), motion)
    return Background(out[:, compiled.ROTOR].copy(), out[:, compiled.OPPOSED].copy())


def depends_on_law(axis: Axis) -> bool:
    """Whether the axis has effects that scale its friction, so that they have to be evaluated with it."""
    return any(item.term.place in (Place.SCALE, Place.SENSOR) for item in axis.effects)


def evaluated(axis: Axis, motion: Motion) -> np.ndarray:
    """`machine.evaluate` (n, 8) over every stretch on its own; one that starts sliding starts with a bristle that is."""
    return Walk(axis, motion).run()


class Walk:
    """An axis that walks through a motion again and again, with other values of its friction law."""

    def __init__(self, axis: Axis, motion: Motion) -> None:
        names = tuple(sorted(motion.exogenous))
        temperature = motion.temperature if motion.temperature is not None else np.full(len(motion), 20.0)
        self._signals = np.ascontiguousarray(
            np.vstack([temperature, *(motion.exogenous[name] for name in names)])
        )
        self.motion = motion
        self._ways = first_directions(axis, motion)
        self._machine = compiled.build(axis, 1.0 / motion.rate, 1, names)
        live = (self._machine.states, self._machine.body, self._machine.motion)
        self._fresh = [(array, array.copy()) for array in live]
        law = [item.term.place for item in axis.terms].index(Place.LAW)
        start = self._machine.parameter_ends[law]
        self._law = self._machine.parameters[start : start + len(axis.friction.term.parameters)]
        self._out = np.empty((len(motion), 8))

    def run(
        self,
        values: np.ndarray | None = None,
        ways: np.ndarray | None = None,
        torque: np.ndarray | None = None,
    ) -> np.ndarray:
        """(n, 8), valid until the next run; `values` of the law in the order of its declaration.

        ways (s,): 1 or -1 for stretches before which the axis slid that way, 0 for others; by default as the recording has it.
        torque (n,): N m of the drive, by default as logged.
        """
        motion, machine = self.motion, self._machine
        torque = motion.torque if torque is None else torque
        if values is not None:
            self._law[:] = values
        for part, way in zip(motion.stretches, self._ways if ways is None else ways, strict=True):
            for array, fresh in self._fresh:
                array[:] = fresh
            if way:
                _slide(machine, motion, part.start, way, self._signals)
            compiled.evaluate(
                machine, motion.t[part], motion.position[part], motion.velocity[part],
                motion.acceleration[part], torque[part], self._signals[:, part], motion.resolution,
                self._out[part],
            )  # fmt: skip
        return self._out


def start_sliding(axis: Axis, motion: Motion) -> np.ndarray:
    """(s,) Whether each stretch starts in motion against a torque as large as usual; less says that it has only just set off."""
    starts = motion.bounds[:-1]
    friction = motion.torque - axis.inertia * motion.acceleration
    usual = float(np.median(np.abs(friction)))
    speed = motion.velocity[starts]
    return np.asarray(
        (np.abs(speed) > motion.resolution) & (friction[starts] * np.sign(speed) > SLIDING * usual)
    )


def first_directions(axis: Axis, motion: Motion) -> np.ndarray:
    """(s,) 1 or -1 for a stretch that starts sliding that way, 0 for one that does not."""
    return np.sign(motion.velocity[motion.bounds[:-1]]) * start_sliding(axis, motion)


def _slide(machine: compiled.Machine, motion: Motion, start: int, way: float, signals: np.ndarray) -> None:
    """Run steady motion up to the stretch's first position, that way and long enough for any bristle to saturate.

    Its speed is that of the stretch's start, if that is known.
    """
    velocity = way * max(abs(motion.velocity[start]), motion.resolution)
    distance = 4.0 * max(float(np.ptp(motion.position)), abs(velocity) / motion.rate)
    t = motion.t[start] + np.linspace(-distance / abs(velocity), -1e-9, PROLOGUE)
    position = motion.position[start] + (t - motion.t[start]) * velocity
    same = np.full(PROLOGUE, 1.0)
    scratch = np.empty((PROLOGUE, 8))
    held = np.ascontiguousarray(np.repeat(signals[:, start : start + 1], PROLOGUE, axis=1))
    compiled.evaluate(
        machine,
        t,
        position,
        velocity * same,
        0.0 * same,
        motion.torque[start] * same,
        held,
        motion.resolution,
        scratch,
    )


class LuGreModel:
    """LuGre with exact derivatives. The initial bristle torque of each stretch is an input."""

    def __init__(self, motion: Motion) -> None:
        self._velocity = np.ascontiguousarray(motion.velocity)
        self._travel = motion.travel
        self._bounds = motion.bounds

    def as_lugre(self, values: np.ndarray) -> np.ndarray:
        """LuGre's six parameters that this law's stand for."""
        return values

    def _run(self, values: np.ndarray, initial: np.ndarray) -> np.ndarray:
        out = np.empty((len(self._velocity), 8))
        kernels.sensitivities(self._velocity, self._travel, self._bounds, self.as_lugre(values), initial, out)
        return out

    def torque(self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:  # noqa: ARG002
        return self._run(values, initial)[:, 0]

    def derivatives(
        self,
        values: np.ndarray,
        initial: np.ndarray,
        rest: np.ndarray | float = 0.0,  # noqa: ARG002
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        out = self._run(values, initial)
        return out[:, 0], out[:, 1:7], out[:, 7]


class DahlModel(LuGreModel):
    """Dahl with viscous friction is LuGre without Stribeck drop and bristle damping: coulomb, stiffness, viscous."""

    def as_lugre(self, values: np.ndarray) -> np.ndarray:
        return np.array([values[0], values[0], 1.0, values[1], 0.0, values[2]])

    def derivatives(
        self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        torque, slopes, first = super().derivatives(values, initial, rest)
        return torque, np.column_stack([slopes[:, 0] + slopes[:, 1], slopes[:, 3], slopes[:, 5]]), first


class AnyModel:
    """Any law with the effects that act on it, through the axis' own evaluation; derivatives by differences."""

    def __init__(self, axis: Axis, motion: Motion) -> None:
        acting = (Place.DRIVE, Place.SCALE, Place.SENSOR)
        kept = tuple(item for item in axis.effects if item.term.place in acting)
        self._walk = Walk(replace(axis, effects=kept), motion)
        self._acceleration = motion.acceleration
        parameters = axis.friction.term.parameters
        self._bounds = np.array([(p.lower, p.upper) for p in parameters]).T
        gain = float(np.ptp(motion.torque)) / max(float(np.abs(motion.velocity).max()), 1e-300)
        self._least = np.array([1e-6 * gain if p.unit == "N m s/rad" else 1e-14 for p in parameters])
        self._linear = [k for k, p in enumerate(parameters) if p.role is Role.LINEAR]
        self._columns: dict[int, np.ndarray] = {}  # of what the torque is proportional to

    def torque(self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:  # noqa: ARG002
        return self.loaded(values, self._walk.motion.torque)

    def loaded(self, values: np.ndarray, load: np.ndarray) -> np.ndarray:
        """(n,) N m of friction under this torque (n,) of the drive."""
        out = self._walk.run(np.clip(values, *self._bounds), torque=load)
        moving: np.ndarray = out[:, compiled.REQUIRED] - out[:, compiled.OPPOSED]
        return moving - out[:, compiled.MOVED] * self._acceleration

    def bare(self, values: np.ndarray) -> np.ndarray:
        """(n,) N m of friction that no load adds to."""
        return self.loaded(values, self._walk.motion.torque)

    def level(self, values: np.ndarray) -> np.ndarray:
        """(n,) dry friction that is available."""
        return self._walk.run(np.clip(values, *self._bounds))[:, compiled.AVAILABLE].copy()

    def unsure(self, values: np.ndarray) -> np.ndarray:
        """(n,) Whether the torque depends on which way the axis slid before a stretch, in at most its first fifth."""
        law, stretches = np.clip(values, *self._bounds), self._walk.motion.stretches
        one, other = (
            self._walk.run(law, np.full(len(stretches), way))[:, compiled.REQUIRED].copy()
            for way in (1.0, -1.0)
        )
        result = np.zeros(len(one), dtype=bool)
        for part in stretches:
            first = slice(part.start, part.start + (part.stop - part.start) // 5)
            apart = np.flatnonzero(np.abs(one[first] - other[first]) > FORGOTTEN * np.ptp(one))
            result[part.start : part.start + (apart[-1] + 1 if len(apart) else 0)] = True
        return result

    def column(self, k: int, values: np.ndarray) -> np.ndarray:
        """(n,) derivative by a parameter that the torque is proportional to, whatever the others are."""
        if k not in self._columns:
            unit, none = values.copy(), values.copy()
            none[k], unit[k] = 0.0, 1e6 * self._least[k]
            self._columns[k] = (self.bare(unit) - self.bare(none)) / unit[k]
        return self._columns[k]

    def derivatives(
        self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        torque = self.torque(values, initial, rest)
        slopes = np.empty((len(torque), len(values)))
        for k in range(len(values)):
            if k in self._linear:
                slopes[:, k] = self.column(k, values)
                continue
            step = max(STEP * abs(values[k]), self._least[k])
            high, low = values.copy(), values.copy()
            high[k], low[k] = (
                min(values[k] + step, self._bounds[1][k]),
                max(values[k] - step, self._bounds[0][k]),
            )
            apart = self.torque(high, initial, rest) - self.torque(low, initial, rest)
            slopes[:, k] = apart / (high[k] - low[k])
        return torque, slopes, None


class LoadedModel(AnyModel):
    """A law that is affine in the torque u at the rotor, F(u) = F(0) + share u, as friction growing with the load is.

    The torque that a motion requires then follows without the logged one, whose noise would be on both sides of a comparison
    and look like friction: u = (rest + F(0)) / (1 - share), with rest = inertia, offset and believed opposing torques. Of the
    logged torque only the sign is used, through the share.
    """

    def __init__(self, axis: Axis, motion: Motion) -> None:
        known = background(axis, motion)
        effects = tuple(item for item in axis.effects if item.term.place is not Place.DRIVE)
        axis = replace(axis, effects=effects)
        super().__init__(axis, replace(motion, torque=known.rotor))
        self._rotor, self._opposing = known.rotor, known.opposing
        self._nothing = np.zeros(len(motion))
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None

    def torque(self, values: np.ndarray, initial: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:  # noqa: ARG002
        bare, growth = self._parts(values)
        return np.asarray(bare + growth * (bare + rest + self._opposing))

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(n,) by how much friction grows with each N m that inertia and offset require: share / (1 - share)."""
        return self._parts(values)[1]

    def _parts(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F(0) (n,) and the growth (n,); those of the last values are remembered."""
        if self._last is None or not np.array_equal(self._last[0], values):
            bare = self.bare(values)
            grown = self.loaded(values, self._rotor) - bare
            share = np.divide(grown, self._rotor, out=np.zeros(len(grown)), where=self._rotor != 0.0)
            self._last = values.copy(), (bare, 1.0 / np.maximum(1.0 - share, LEAST_PASSED) - 1.0)
        return self._last[1]

    def bare(self, values: np.ndarray) -> np.ndarray:
        return self.loaded(values, self._nothing)

    def column(self, k: int, values: np.ndarray) -> np.ndarray:
        return np.asarray((1.0 + self.growth(values)) * super().column(k, values))


def reads_load(axis: Axis) -> bool:
    """Whether the friction law depends on the torque at the rotor."""
    return "torque" in axis.friction.term.reads


def general_model(axis: Axis, motion: Motion) -> AnyModel:
    """The model of any law."""
    return LoadedModel(axis, motion) if reads_load(axis) and not motion.measured else AnyModel(axis, motion)


def model_for(axis: Axis, motion: Motion) -> Model:
    """The fastest model of the axis' law."""
    law = axis.friction.term.id
    if law == "lugre" and not depends_on_law(axis):
        return LuGreModel(motion)
    if law == "dahl_viscous" and not depends_on_law(axis):
        return DahlModel(motion)
    return general_model(axis, motion)
