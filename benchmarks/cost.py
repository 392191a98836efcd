"""The cost of LuGre identification over a population: this package's compiled loops beside NumPy vectorised over the population.

Both simulate the bristle of every candidate over the points of two speed crossings and sum the squared errors; the
costs are compared. Counted are point-particle evaluations: points times candidates.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import crossings
from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError
from tcs_friction.identify.cost import Points, ShapeCost, thinned
from tcs_friction.identify.start import believed_start

POPULATION = 256
REPETITIONS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--population", type=positive, default=POPULATION, help="candidates")
    parser.add_argument("--points", type=positive, default=crossings.POINTS, help="points each way")


def numpy_costs(points: Points, population: np.ndarray) -> np.ndarray:
    """Half the squared errors (m,) of candidates (m, 8), one time step after the other for all of them at once."""
    coulomb, static, stribeck, stiffness, damping, viscous, inertia, offset = population.T
    bristle, total = np.zeros(len(population)), np.zeros(len(population))
    before = coulomb
    columns = (
        points.velocity,
        points.travel,
        points.carry,
        points.acceleration,
        points.target,
        points.weight,
    )
    for v, travel, carry, acceleration, target, weight in zip(*columns, strict=True):
        level = coulomb + (static - coulomb) * np.exp(-((v / stribeck) ** 2))
        before = level + carry * (before - level)
        widths = stiffness * abs(travel) * 2.0 / (before + level)
        decay = np.exp(-widths)
        mean = -np.expm1(-widths) / np.maximum(widths, 1e-300) if travel else np.ones_like(widths)
        slide = np.copysign(1.0, travel) * (before * (mean - decay) + level * (1.0 - mean))
        bristle = carry * bristle * decay + slide
        before = level
        torque = bristle + damping * (v - abs(v) / level * bristle) + viscous * v
        total += weight * (torque + inertia * acceleration + offset - target) ** 2
    return 0.5 * total


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    posed = crossings.problem(points=arguments.points)
    cost = crossings.lugre_cost(posed)
    position = np.random.default_rng(0).random((arguments.population, len(cost.box.lower)))
    candidates = np.tile(believed_start(posed)[:8], (len(position), 1))
    candidates[:, :6] = cost.box.values(position)
    points = thinned(posed, len(posed.motion))
    work = len(points.velocity) * len(candidates)
    ours = _fastest(lambda: cost.costs(candidates), REPETITIONS)
    theirs = _fastest(lambda: numpy_costs(points, candidates), 1)
    worst = float(np.max(np.abs(cost.costs(candidates) / numpy_costs(points, candidates) - 1.0)))
    if worst > 1e-6:
        raise JobError("bench cost", f"the two differ by {worst:.1g}", "the same costs")
    shape = ShapeCost(posed, False, False, believed_start(posed))
    shapes = np.random.default_rng(0).random((arguments.population, 3))
    count = len(thinned(posed).velocity) * len(shapes)
    projected = _fastest(lambda: shape(shapes), REPETITIONS)
    unit = "million points/s"
    return [
        _row("LuGre cost, compiled", work / ours / 1e6, unit, work / theirs / 1e6),
        _row(
            "LuGre cost with the linear part solved for", count / projected / 1e6, unit, work / theirs / 1e6
        ),
        {
            "name": "largest relative difference of costs",
            "value": worst,
            "unit": "1",
            "beside": None,
            "ratio": None,
        },
    ]


def _row(name: str, value: float, unit: str, beside: float) -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": value / beside}


def _fastest(call: Callable[[], object], repetitions: int) -> float:
    """Seconds of the fastest of some calls after a first one."""
    call()
    best = float("inf")
    for _ in range(repetitions):
        began = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - began)
    return best
