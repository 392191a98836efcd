"""Friction laws side by side, roughly: which is worth the whole fit.

All laws see the same windows of the recordings and start from one search, that of LuGre's shapes, which costs least of all: its
Coulomb and static torque, Stribeck velocity, stiffness and viscous coefficient are those of the other laws, as far as they
have them. Each is refined on the samples that train, and judged by those that are held out, as the whole fit is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

from tcs_friction.conditioning.motion import Motion, unsure_start, windows
from tcs_friction.errors import InputError
from tcs_friction.identify import pso_ga
from tcs_friction.identify.conclusions import refit, rms, training_mask
from tcs_friction.identify.cost import ShapeCost
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.problem import pose
from tcs_friction.identify.result import finite
from tcs_friction.identify.start import believed_start, space_of, with_sliding_states
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance

SHAPES = "lugre"  # the law whose search starts all
SEARCH = SwarmOptions(population=48, generations=1, swarm_generations=24, genetic_generations=0, velocity_limit=0.1)
SAMPLES, WINDOWS = 16_000, 8  # that are looked at, and the windows of a recording that has more
STEPS, GAIN = 25, 1e-3  # of each fit: steps, and the relative gain that ends it
BLOCKS = 16  # of the held-out samples, whose mean squares are compared
CHANCE = 0.05  # probability, from which a preference may be one of chance


@dataclass(frozen=True, eq=False)
class RoughFit:
    """One law. residual: (m,) N m, on samples that all laws explain. training: (m,) bool, which of them were fitted.

    free: numbers that were fitted. seconds: that it took.
    """

    law: str
    residual: np.ndarray
    training: np.ndarray
    free: int
    seconds: float

    @property
    def held_out(self) -> float:
        """rms on held-out samples, N m; NaN without any."""
        return rms(self.residual[~self.training])

    def as_good(self, other: RoughFit) -> bool:
        """Whether blocks of held-out samples prefer neither law by Wilcoxon's signed ranks (1945), or are too few."""
        more = (self.residual**2 - other.residual**2)[~self.training]
        if len(more) < BLOCKS or not more.any():
            return True
        means = [float(np.mean(block)) for block in np.array_split(more, BLOCKS)]
        return bool(wilcoxon(means).pvalue > CHANCE)

    def to_mapping(self) -> dict[str, Any]:
        """As in `identification.json` under `laws`."""
        train = rms(self.residual[self.training])
        return {"law": self.law, "rmse": {"train": finite(train), "held_out": finite(self.held_out)}, "seconds": self.seconds}


def compare_roughly(
    motion: Motion, axis: Axis, names: Sequence[str], progress: Callable[[str], None] = lambda _: None
) -> tuple[tuple[RoughFit, ...], Mapping[str, str]]:
    """The named laws fitted to a motion, best first (NaN last), and why others cannot be. Raises InputError where none can."""
    motion = replace(windows(motion, SAMPLES, SAMPLES // WINDOWS), grids=())
    found: dict[str, RoughFit] = {}
    explained: list[np.ndarray] = []
    failed: dict[str, InputError] = {}
    progress(SHAPES)
    starts = [_searched(motion, axis)]
    for name in names:
        progress(name)
        try:
            found[name], known, ended = _fitted(motion, starts, name)
        except InputError as error:
            failed[name] = error
            continue
        explained.append(known)
        starts.append(ended)
    if not found:
        raise next(iter(failed.values()))
    common = np.all(explained, axis=0)
    judged = [replace(one, residual=one.residual[common], training=one.training[common]) for one in found.values()]
    judged.sort(key=lambda one: (math.isnan(one.held_out), one.held_out))
    return tuple(judged), {name: str(error) for name, error in failed.items()}


def _searched(motion: Motion, axis: Axis) -> Axis:
    """The axis with LuGre friction and inertia as a search over its shapes finds them; as it is where nothing can be compared."""
    problem = pose(_with_law(axis, SHAPES), motion)
    cost = ShapeCost(problem, True, True, believed_start(problem))
    try:
        found = pso_ga.search(cost, len(cost.box.lower), 0, SEARCH)
    except InputError:
        return axis
    return _ended(problem.axis, cost.unknowns(found.position))


def _with_law(axis: Axis, name: str) -> Axis:
    """The axis with the named law, whose parameters have the values of those by the same names, else their defaults."""
    term, known = law(name), axis.friction.values
    values = {
        p.name: known.get(p.name, p.default if p.default is not None else max(p.lower, min(1.0, p.upper)))
        for p in term.parameters
    }
    return replace(axis, friction=instance(term, values))


def _fitted(motion: Motion, starts: Sequence[Axis], name: str) -> tuple[RoughFit, np.ndarray, Axis]:
    """A law's fit from the best start to all compared samples; which of them it explains, (m,); and where it ended.

    What was before a window nobody knows: its bristles begin as in sliding, and its start does not count.
    """
    began = time.perf_counter()
    problems = [pose(_with_law(start, name), motion) for start in starts]
    training, sure = training_mask(problems[0]), ~unsure_start(motion)[problems[0].thin.centres]
    problems = [one.masked(training & sure) for one in problems]
    unknowns = [with_sliding_states(one, believed_start(one)) for one in problems]
    costs = [float(one.weights @ (one.target - one.torque(x)) ** 2) for one, x in zip(problems, unknowns, strict=True)]
    best = int(np.argmin(costs))
    problem = problems[best]
    space = space_of(problem, True, True, False)
    space = space.holding(np.arange(len(space.free)) > problem.offset_index)
    fit = refit(problem, unknowns[best], space, "squares", STEPS, GAIN)
    residual, explained = problem.unexplained(fit), problem.explained & sure
    count, seconds = int(np.count_nonzero(space.free)), time.perf_counter() - began
    return RoughFit(name, residual, training, count, seconds), explained, _ended(problem.axis, fit.unknowns)


def _ended(axis: Axis, unknowns: np.ndarray) -> Axis:
    """The axis with the law's values and the inertia that unknowns (p,) begin with, within their bounds."""
    term = axis.friction.term
    values = {p.name: float(np.clip(x, p.lower, p.upper)) for p, x in zip(term.parameters, unknowns, strict=False)}
    return replace(axis, friction=instance(term, values), inertia=float(unknowns[len(term.parameters)]))
