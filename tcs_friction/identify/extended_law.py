"""The search for a law that extends LuGre's by a free curve over the speed, and whether the data show that curve.

With a wrong curve LuGre's own best values may be far from those of the extended law, and its cost has many minima. The search
starts from LuGre's fits at Stribeck velocities all over their range. LuGre's curve is kept unless the free one explains more than
its further parameters do by chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from tcs_friction.errors import InputError
from tcs_friction.identify import pso_ga
from tcs_friction.identify.conclusions import refit
from tcs_friction.identify.cost import ShapeCost
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.problem import Problem
from tcs_friction.identify.pso_ga import Generation, SearchResult
from tcs_friction.identify.refine import Refined, Space
from tcs_friction.identify.uncertainty import independent_samples
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.friction.lugre import USUAL_STATIC

VELOCITIES_APART = 2.0  # factor between the Stribeck velocities of the starts
GOING_ON, FIRST_STEPS, MORE_STEPS = 3, 3, 15  # starts that go on after the first steps; steps
GAIN = 1e-3  # of the cost: a step that gains less ends a fit
CHANCE = 1e-3  # probability that a free curve explains so much where LuGre's is true


def search_extended(
    cost: ShapeCost, simpler: Problem, problem: Problem, space: Space, seed: int, settings: SwarmOptions, loss: str,
    progress: Callable[[Generation], None], cancel: Callable[[], bool],
) -> tuple[SearchResult, np.ndarray, Mapping[int, str]]:  # fmt: skip
    """The search that led to the best fit, unknowns (p,), and the unknowns that the data do not show, with the reason.

    cost, simpler: of LuGre's law in the same data. problem, space: of the law that extends it.
    """
    names, law = simpler.names, problem.axis.friction.term
    further = [k for k, p in enumerate(law.parameters) if p.name not in names]
    plain = space.holding(np.isin(np.arange(len(space.free)), further))

    def extended(position: np.ndarray) -> np.ndarray:
        known = cost.unknowns(position)
        values = dict(zip(names, known.tolist(), strict=True))
        own = [values.get(p.name, p.default) for p in law.parameters]
        return np.array([*own, *known[simpler.law_size :]], dtype=float)

    found = pso_ga.search(cost, len(cost.box.lower), seed, settings, progress=progress, cancel=cancel)
    without = refit(problem, extended(found.position), plain, loss, MORE_STEPS, GAIN)
    ends = [(found, refit(problem, without.unknowns, space, loss, FIRST_STEPS))]
    for number, rest in enumerate(_usual_shapes(cost)):
        if found.outcome is Outcome.CANCELLED:
            break

        def with_rest(distances: np.ndarray, rest: Sequence[float] = rest) -> np.ndarray:
            return cost(np.column_stack([distances, np.tile(rest, (len(distances), 1))]))

        try:
            found = pso_ga.search(with_rest, 1, (seed, number), settings, progress=progress, cancel=cancel)
        except InputError:
            continue  # no bristle has a cost at this Stribeck velocity
        start = extended(np.append(found.position, rest))
        ends.append((found, refit(problem, start, space, loss, FIRST_STEPS)))
    best = sorted(ends, key=lambda end: end[1].cost)[:GOING_ON]
    more = [(one, refit(problem, end.unknowns, space, loss, MORE_STEPS, GAIN)) for one, end in best]
    winner, refined = min(more, key=lambda end: end[1].cost)
    evaluations = sum(one.evaluations for one, _ in ends) + sum(end.evaluations for _, end in [*ends, *more])
    winner = replace(winner, evaluations=evaluations + without.evaluations, outcome=found.outcome)
    if _by_chance(without, refined, len(further)):
        reason = f"{law.extends} explains as much without it"
        return winner, without.unknowns, dict.fromkeys(further, reason)
    return winner, refined.unknowns, {}


def _usual_shapes(cost: ShapeCost) -> list[list[float]]:
    """LuGre's usual static friction and Stribeck velocities all over their range, as places in the cost's box."""
    _, ratio, velocity = np.log(cost.box.upper / cost.box.lower)
    usual = math.log(USUAL_STATIC / cost.box.lower[1]) / ratio
    count = 1 + math.ceil(velocity / math.log(VELOCITIES_APART))
    return [[usual, float(share)] for share in np.linspace(0.0, 1.0, count)]


def _by_chance(without: Refined, refined: Refined, further: int) -> bool:
    """Whether further parameters lower the cost by no more than they do where they are not needed (likelihood ratio)."""
    counted = refined.weights > 0.0
    samples = independent_samples(refined.residual[counted])
    ratio = samples * math.log(max(without.cost / max(refined.cost, 1e-300), 1.0))
    return ratio < float(chi2.ppf(1.0 - CHANCE, further))
