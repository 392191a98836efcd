"""What a global search minimises: half the squared torque errors (eq. 5) of candidates in a box around what the data can mean."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.signal import butter, lfilter_zi

from tcs_friction.conditioning.motion import FILTER_ORDER, Motion, coarse, unsure_start
from tcs_friction.identify import kernels
from tcs_friction.identify.models import LoadedModel, first_directions, general_model
from tcs_friction.identify.problem import Problem, thinning
from tcs_friction.physics.terms import Parameter, Role

SEARCH_POINTS = 6000  # a global search looks at about so many
SHAPE_POINTS = 1500  # one whose result is refined, at so many
FASTEST_DROP = 1.5  # times the top speed: a Stribeck velocity above cannot be told from viscous friction
OBSERVER_ORDER = 3  # of the filter Q
FINEST = 1e-5  # of the travel: deflection of a bristle, unless the position's noise lets a finer one show
FAR = 1e30  # travel that saturates any bristle


@dataclass(frozen=True, eq=False)
class Box:
    """The search box. names; lower and upper (d,); logarithmic (d,): searched by order of magnitude."""

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    logarithmic: np.ndarray

    def values(self, position: np.ndarray) -> np.ndarray:
        """(m, d) or (d,) in the unit box -> values."""
        safe = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper, 1.0) / safe
        return np.where(
            self.logarithmic, safe * ratio**position, self.lower + (self.upper - self.lower) * position
        )

    def position(self, values: np.ndarray) -> np.ndarray:
        """(m, d) or (d,) values -> the unit box, clipped."""
        safe = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper / np.maximum(self.lower, 1e-300), np.e)
        positive = np.maximum(np.where(self.logarithmic, values, 1.0), 1e-300)
        span = np.where(self.upper > self.lower, self.upper - self.lower, 1.0)
        return np.clip(
            np.where(self.logarithmic, np.log(positive / safe) / np.log(ratio), (values - self.lower) / span),
            0.0,
            1.0,
        )


class SearchCost(Protocol):
    """A cost over the unit box of `box`, and the whole vector of unknowns that a position stands for."""

    box: Box

    def __call__(self, position: np.ndarray) -> np.ndarray: ...

    def unknowns(self, position: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Points:
    """A motion thinned for searching, each (n,): the travel between kept samples is summed, so that bristles see all of it."""

    velocity: np.ndarray
    travel: np.ndarray
    carry: np.ndarray
    acceleration: np.ndarray
    target: np.ndarray
    weight: np.ndarray

    def late(self, samples: int) -> Points:
        """The same with target and weight so many samples later: as they were before the filter's lag was taken out."""
        first = np.flatnonzero(self.carry == 0.0)
        index = np.arange(len(self.target)) - samples
        inside = index >= first[np.searchsorted(first, np.arange(len(index)), side="right") - 1]
        index = np.maximum(index, 0)
        return replace(self, target=self.target[index], weight=np.where(inside, self.weight[index], 0.0))


def kernel_filter(order: int, bandwidth: float, rate: float) -> np.ndarray:
    """(OBSERVER,) a Butterworth low pass of order 3 or 4, as `kernels.squared_errors` reads it; Hz, samples/s."""
    b, a = butter(order, bandwidth, fs=rate)
    rest, none = lfilter_zi(b, a), np.zeros(4 - order)
    return np.concatenate([b, none, a[1:], none, rest, none])


def thinned(problem: Problem, points: int = SEARCH_POINTS) -> Points:
    """At most about `points` samples, but at least four per cycle of the motion's bandwidth."""
    motion = problem.motion
    stride = search_stride(motion, points)
    moved = np.cumsum(motion.travel)
    kept = [np.arange(part.start, part.stop, stride) for part in motion.stretches]
    index = np.concatenate(kept)
    first = np.cumsum([0, *(len(k) for k in kept[:-1])])
    travel = np.diff(moved[index], prepend=moved[index[0]])
    carry = np.ones(len(index))
    carry[first] = 0.0
    travel[first] = first_directions(problem.axis, motion) * FAR
    weight = _weights_at(problem, index)
    weight[unsure_start(motion)[index]] = 0.0
    velocity, acceleration = motion.velocity[index], motion.acceleration[index]
    return Points(velocity, travel, carry, acceleration, problem.rotor[index], weight)


def search_stride(motion: Motion, points: int) -> int:
    """Which samples a search looks at: about `points`, but at least four per cycle of the motion's bandwidth."""
    stride = max(1, len(motion) // points)
    band = max(motion.bandwidth, motion.filtered)
    return min(stride, max(1, int(motion.rate / (4.0 * band)))) if band > 0.0 else stride


def _weights_at(problem: Problem, index: np.ndarray) -> np.ndarray:
    """Weights of the compared samples next to `index`; nothing counts where no compared sample is near (filtered ends)."""
    centres = problem.thin.centres
    nearest = np.clip(np.searchsorted(centres, index), 0, len(centres) - 1)
    near = np.abs(centres[nearest] - index) <= problem.thin.stride
    return np.where(near, problem.weights[nearest], 0.0)


@dataclass(frozen=True)
class Scales:
    """Sizes of things in the data, from which boxes follow.

    torque: N m, velocity: rad/s, slow: rad/s, the slowest, travel: rad, least: rad of travel that stands out of the noise.
    """

    torque: float
    velocity: float
    slow: float
    travel: float
    least: float


def scales(problem: Problem, inertia: float) -> Scales:
    """Robust sizes of the friction (torque less inertia), velocity and travel."""
    motion = problem.motion
    friction = problem.rotor - inertia * motion.acceleration
    friction = friction - np.median(friction) if motion.reverses else friction
    torque = max(float(np.quantile(np.abs(friction), 0.99)), 1e-12)
    velocity = max(float(np.abs(motion.velocity).max()), 1e-12)
    travel = max(float(np.ptp(motion.position)), 1e-12)
    noise = math.sqrt(motion.density * motion.bandwidth)
    least = max(min(noise, FINEST * travel), 1e-9 * travel) if noise > 0.0 else FINEST * travel
    return Scales(torque, velocity, max(motion.resolution, 1e-3 * velocity), travel, least)


def law_box(parameters: tuple[Parameter, ...], size: Scales) -> Box:
    """Where a search looks for a law's parameters: from their units and the sizes in the data, within their declared bounds."""
    ranges: Mapping[str, tuple[float, float, bool]] = {
        "N m": (0.1 * size.torque, 2.0 * size.torque, True),
        "rad/s": (size.slow, FASTEST_DROP * size.velocity, True),
        "rad": (1e-4 * size.travel, size.travel, True),
        "N m/rad": (0.3 * size.torque / size.travel, 3e3 * size.torque / size.travel, True),
        "N m s/rad": (0.0, size.torque / size.velocity, False),
        "damping": (0.01 * size.torque / size.velocity, 100.0 * size.torque / size.velocity, True),
    }
    return _bounded(parameters, ranges)


def widest(parameters: tuple[Parameter, ...], size: Scales) -> Box:
    """Bounds beyond which the data cannot tell one value from another; a parameter that they do not determine ends up there."""
    ranges: Mapping[str, tuple[float, float, bool]] = {
        "N m": (0.02 * size.torque, 5.0 * size.torque, True),
        "rad/s": (0.3 * size.slow, FASTEST_DROP * size.velocity, True),
        "rad": (0.1 * size.least, 3.0 * size.travel, True),
        "N m/rad": (0.1 * size.torque / size.travel, size.torque / size.least, True),
        "N m s/rad": (0.0, np.inf, False),
    }
    return _bounded(parameters, ranges)


def _bounded(parameters: tuple[Parameter, ...], ranges: Mapping[str, tuple[float, float, bool]]) -> Box:
    lower, upper, logarithmic = [], [], []
    for parameter in parameters:
        default = parameter.default if parameter.default is not None else 0.0
        fallback = (max(parameter.lower, default - 1.0), min(parameter.upper, default + 1.0), False)
        key = parameter.name if parameter.name in ranges else parameter.unit
        low, high, by_magnitude = ranges.get(key, fallback)
        lower.append(max(low, parameter.lower))
        upper.append(max(min(high, parameter.upper), lower[-1]))
        logarithmic.append(by_magnitude)
    return Box(tuple(p.name for p in parameters), np.array(lower), np.array(upper), np.array(logarithmic))


class ShapeCost:
    """LuGre by variable projection: only presliding distance, static/coulomb and Stribeck velocity are searched.

    Coulomb torque, damping, viscous coefficient, inertia and offset enter linearly and are solved for, none of
    the first four below zero.
    """

    def __init__(self, problem: Problem, free_inertia: bool, free_offset: bool, start: np.ndarray) -> None:
        self._points = thinned(problem, SHAPE_POINTS)
        self._used = np.array([True, True, True, free_inertia, free_offset])
        self._start = start
        known = 0.0 if free_inertia else start[problem.inertia_index]
        offset = 0.0 if free_offset else start[problem.offset_index]
        self._target = self._points.target - known * self._points.acceleration - offset
        self._power = float(self._points.weight @ self._target**2)
        size = scales(problem, float(start[problem.inertia_index]))
        lower = np.array([size.least, 1.0, size.slow])
        upper = np.array([size.travel, 6.0, FASTEST_DROP * size.velocity])
        self.box = Box(("distance", "ratio", "stribeck_velocity"), lower, upper, np.full(3, True))

    def _solved(self, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Linear coefficients (m, 5) and costs (m,)."""
        p = self._points
        sums = np.empty((len(shapes), kernels.GRAM))
        kernels.normal_equations(
            p.velocity,
            p.travel,
            p.carry,
            p.acceleration,
            self._target,
            p.weight,
            np.ascontiguousarray(shapes),
            sums,
        )
        gram = np.zeros((len(shapes), 5, 5))
        rows, columns = np.triu_indices(5)
        gram[:, rows, columns] = gram[:, columns, rows] = sums[:, :15]
        coefficients = _nonnegative(gram, sums[:, 15:], np.broadcast_to(self._used, (len(shapes), 5)))
        quadratic = np.einsum("mi,mij,mj->m", coefficients, gram, coefficients)
        costs = 0.5 * (self._power - 2.0 * np.einsum("mi,mi->m", coefficients, sums[:, 15:]) + quadratic)
        return coefficients, np.where(coefficients[:, 0] > 0.0, np.maximum(costs, 0.0), np.inf)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self._solved(self.box.values(position))[1]

    def unknowns(self, position: np.ndarray) -> np.ndarray:
        distance, ratio, stribeck = self.box.values(position)
        coulomb, damping, viscous, inertia, offset = self._solved(np.array([[distance, ratio, stribeck]]))[0][
            0
        ]
        result = self._start.copy()
        result[:6] = coulomb, ratio * coulomb, stribeck, coulomb / distance, damping, viscous
        if self._used[3] and inertia > 0.05 * self._start[6]:
            result[6] = inertia
        if self._used[4]:
            result[7] = offset
        return result


def _nonnegative(gram: np.ndarray, right: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Least-squares coefficients (m, 5); those of the first four columns that would be negative are held at zero."""
    size = np.sqrt(np.maximum(np.einsum("mii->mi", gram), 1e-300))
    scaled = gram / size[:, :, None] / size[:, None, :]
    used = used.copy()
    signed = np.array([True, True, True, True, False])
    solution = np.zeros_like(right)
    for _ in range(3):
        both = used[:, :, None] & used[:, None, :]
        system = np.where(both, scaled, 0.0) + np.eye(5) * np.where(used, 1e-12, 1.0)[:, :, None]
        solution = np.linalg.solve(system, np.where(used, right / size, 0.0)[:, :, None])[:, :, 0]
        negative = used & signed & (solution < 0.0)
        if not negative.any():
            break
        used &= ~negative
    return np.where(used & ~(signed & (solution < 0.0)), solution, 0.0) / size


class LuGreCost:
    """The paper's cost: all six LuGre parameters (and inertia and offset where they are free) are searched.

    Friction that an observer's filter or a recording's zero-phase low pass has passed is compared with friction that passes
    the same.
    """

    def __init__(
        self, problem: Problem, free_inertia: bool, free_offset: bool, start: np.ndarray, box: Box | None = None,
        points: int = SEARCH_POINTS,
    ) -> None:  # fmt: skip
        self._points, self._observer = thinned(problem, points), np.zeros(0)
        motion = problem.motion
        rate = motion.rate / search_stride(motion, points)
        if motion.filtered > 0.0:
            self._points = self._points.late(round(rate / (np.pi * motion.filtered)))
            self._observer = kernel_filter(OBSERVER_ORDER, motion.filtered, rate)
        if motion.bandwidth > 0.0:
            self._observer = kernel_filter(FILTER_ORDER, motion.bandwidth, rate)
        self._errors = kernels.smoothed_errors if motion.bandwidth > 0.0 else kernels.squared_errors
        self._start = start
        size = scales(problem, float(start[problem.inertia_index]))
        law = box or law_box(problem.axis.friction.term.parameters, size)
        names, lower, upper = list(law.names), list(law.lower), list(law.upper)
        logarithmic = list(law.logarithmic)
        if free_inertia:
            names.append("inertia")
            lower.append(0.2 * start[problem.inertia_index])
            upper.append(5.0 * start[problem.inertia_index])
            logarithmic.append(True)
        if free_offset:
            names.append("offset")
            lower.append(-size.torque)
            upper.append(size.torque)
            logarithmic.append(False)
        self.box = Box(tuple(names), np.array(lower), np.array(upper), np.array(logarithmic))
        self._columns = [problem.names.index(name) for name in names]

    @property
    def points(self) -> int:
        """How many are compared."""
        return len(self._points.target)

    def costs(self, candidates: np.ndarray) -> np.ndarray:
        """Eq. 5 for candidates (m, 8): law parameters, inertia, offset."""
        p, out = self._points, np.empty(len(candidates))
        self._errors(
            p.velocity,
            p.travel,
            p.carry,
            p.acceleration,
            p.target,
            p.weight,
            self._observer,
            np.ascontiguousarray(candidates),
            out,
        )
        return 0.5 * out

    def __call__(self, position: np.ndarray) -> np.ndarray:
        candidates = np.tile(self._start[:8], (len(position), 1))
        candidates[:, self._columns] = self.box.values(position)
        return self.costs(candidates)

    def unknowns(self, position: np.ndarray) -> np.ndarray:
        result = self._start.copy()
        result[self._columns] = self.box.values(position)
        return result


class AnyCost:
    """Any law: what the torque is proportional to is solved for with inertia and offset, other parameters are searched."""

    def __init__(self, problem: Problem, free_inertia: bool, free_offset: bool, start: np.ndarray) -> None:
        index, motion = coarse(problem.motion, search_stride(problem.motion, 2 * SEARCH_POINTS // 3))
        self._thin = thinning(motion)
        self._model = general_model(problem.axis, motion)
        self._start, self._problem = start, problem
        self._weight = _weights_at(problem, index[self._thin.centres])
        parameters = problem.axis.friction.term.parameters
        linear = [p.role is Role.LINEAR for p in parameters]
        self._searched = [
            k for k, one in enumerate(linear) if not one and parameters[k].role is not Role.FIXED
        ]
        self._linear = [k for k, one in enumerate(linear) if one]
        held = [] if free_inertia else [problem.inertia_index]
        held += [] if free_offset else [problem.offset_index]
        self._solved = [
            *self._linear,
            *(k for k in (problem.inertia_index, problem.offset_index) if k not in held),
        ]
        known = self._thin.apply(
            np.column_stack([motion.acceleration, np.ones(len(motion)), problem.rotor[index]])
        )
        self._fixed = {problem.inertia_index: known[:, 0], problem.offset_index: known[:, 1]}
        self._target = known[:, 2] - sum(start[k] * self._fixed[k] for k in held)
        self._rest = {problem.inertia_index: motion.acceleration, problem.offset_index: np.ones(len(motion))}
        self._held = sum((start[k] * self._rest[k] for k in held), np.zeros(len(motion)))
        size = scales(problem, float(start[problem.inertia_index]))
        self.box = law_box(tuple(parameters[k] for k in self._searched), size)

    def _smoothed(self, column: np.ndarray) -> np.ndarray:
        """(m,) of (n,)."""
        return self._thin.modelled(column[:, None])[:, 0]

    def _column(self, k: int, law: np.ndarray) -> np.ndarray:
        """(m,) torque by an unknown that is solved for; with friction that grows with the load, it depends on the law."""
        if isinstance(self._model, LoadedModel):
            if k in self._rest:
                return self._fixed[k] + self._smoothed(self._model.growth(law) * self._rest[k])
            return self._smoothed(self._model.column(k, law))
        if k not in self._fixed:
            self._fixed[k] = self._smoothed(self._model.column(k, law))
        return self._fixed[k]

    def _fit(self, position: np.ndarray) -> tuple[np.ndarray, float]:
        unknowns = self._start.copy()
        unknowns[self._searched] = self.box.values(position)
        law = unknowns[: self._problem.law_size].copy()
        law[self._linear] = 0.0
        torque = self._smoothed(self._model.torque(law, np.zeros(0), self._held))
        columns = [self._column(k, law) for k in self._solved]
        root = np.sqrt(self._weight)
        aim = root * (self._target - torque)
        if columns:
            design = root[:, None] * np.column_stack(columns)
            size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
            coefficients = np.linalg.lstsq(design / size, aim, rcond=1e-10)[0] / size
            signed = np.array([k != self._problem.offset_index for k in self._solved])
            coefficients = np.where(signed, np.maximum(coefficients, 0.0), coefficients)
            unknowns[self._solved] = coefficients
            aim = aim - design @ coefficients
        return unknowns, 0.5 * float(aim @ aim)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return np.array([self._fit(one)[1] for one in position])

    def unknowns(self, position: np.ndarray) -> np.ndarray:
        return self._fit(position)[0]
