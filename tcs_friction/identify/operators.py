"""The operators of the paper's PSO-GA, each beside its equation (sections 3.2 and 5.3), and their settings.

Positions and velocities live in the normalised search box, so that one velocity limit serves parameters of all sizes
(docs/paper-errata.md). What the paper leaves open is filled in with usual forms: walls that reflect (Robinson and Rahmat-Samii
2004; at walls that hold, a swarm in a narrow valley sticks), blend crossover BLX-0.5 (Eshelman and Schaffer 1993), mutation
to a new place in the box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from tcs_friction.errors import InputError

BLEND = 0.5  # by which a child's gene may lie beyond its parents', of the distance between them


@dataclass(frozen=True)
class SwarmOptions:
    """Settings of PSO-GA; the names in brackets are the paper's."""

    population: int = 60  # [N_PSO-GA]
    generations: int = 28  # [G_max] of the whole loop
    swarm_generations: int = 10  # [G_PSO] within each
    genetic_generations: int = 3  # [G_GA] within each
    local_factor: float = 1.3  # [c_1]
    global_factor: float = 1.75  # [c_2]
    greatest_weight: float = 0.9  # [W_max] inertia weight, eq. 12
    least_weight: float = 0.1  # [W_min]
    velocity_limit: float = 1.0  # [V_max = -V_min], of the normalised box
    crossover: float = 0.9  # [P_c]
    cost_tolerance: float = 0.0  # stop at this cost; 0: never
    stagnation: int = 80  # stop after so many generations of PSO or GA without gain
    stagnation_gain: float = 1e-4  # relative gain of cost that counts as one
    budget: int = 200_000  # cost evaluations at most

    def __post_init__(self) -> None:
        for field in fields(self):
            if not math.isfinite(getattr(self, field.name)):
                raise InputError(f"pso-ga: {field.name}", repr(getattr(self, field.name)), "a finite number")
        for name in ("population", "generations", "stagnation", "budget"):
            least = 4 if name == "population" else 1
            if getattr(self, name) < least:
                raise InputError(f"pso-ga: {name}", repr(getattr(self, name)), f"at least {least}")
        if (
            self.swarm_generations < 0
            or self.genetic_generations < 0
            or self.swarm_generations + self.genetic_generations < 1
        ):
            raise InputError("pso-ga: generations", "none of PSO nor of GA", "at least one of them")
        if not 0.0 <= self.crossover <= 1.0:
            raise InputError("pso-ga: crossover", repr(self.crossover), "0 to 1")
        if not self.velocity_limit > 0.0:
            raise InputError("pso-ga: velocity_limit", repr(self.velocity_limit), "a positive number")


PAPER = SwarmOptions(
    population=100, generations=300, swarm_generations=300, genetic_generations=200,
    stagnation=600, budget=10_000_000,
)  # fmt: skip
"""Section 5.3. The paper's population is its number of data points (4600), "to simplify the algorithm"; 100 is ours."""


def fitness(costs: np.ndarray) -> np.ndarray:
    """Eq. 6: F(x_m) = C_max - J_m, C_max = max J_m. A cost that is not finite has fitness 0."""
    finite = np.isfinite(costs)
    worst = costs[finite].max(initial=0.0)
    return np.where(finite, worst - np.where(finite, costs, 0.0), 0.0)


def inertia_weight(options: SwarmOptions, iteration: int) -> float:
    """Eq. 12: linearly decreasing weight, iteration 1 to G_PSO."""
    span = options.greatest_weight - options.least_weight
    return options.greatest_weight - span / options.swarm_generations * iteration


def fly(
    position: np.ndarray, velocity: np.ndarray, own_best: np.ndarray, best: np.ndarray,
    weight: float, options: SwarmOptions, random: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Eqs. 7 and 8 with the velocity limit; the walls of the box reflect. Shapes (m, d), best (d,)."""
    r1, r2 = random.random(position.shape), random.random(position.shape)
    pull = options.local_factor * r1 * (own_best - position) + options.global_factor * r2 * (best - position)
    velocity = np.clip(weight * velocity + pull, -options.velocity_limit, options.velocity_limit)
    moved = position + velocity
    inside = (moved >= 0.0) & (moved <= 1.0)
    return reflected(moved), np.where(inside, velocity, -velocity)


def reflected(position: np.ndarray) -> np.ndarray:
    """What is beyond a wall of the unit box as far inside it."""
    inside = np.where(position < 0.0, -position, np.where(position > 1.0, 2.0 - position, position))
    return np.clip(inside, 0.0, 1.0)


def split(costs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step 8: indices of the particles fitter than the mean, best first, and of the rest."""
    order = np.argsort(costs, kind="stable")
    value = fitness(costs)[order]
    better = value > value.mean()
    return order[better], order[~better]


def roulette(costs: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Reproduction, eqs. 13 and 14: indices (count,) drawn with probability F(x_n) / sum F; equal chances if all F are 0."""
    value = fitness(costs)
    total = value.sum()
    probability = value / total if total > 0.0 else np.full(len(costs), 1.0 / len(costs))
    cumulative = np.cumsum(probability)
    return np.minimum(
        np.searchsorted(cumulative, random.random(count) * cumulative[-1], side="right"), len(costs) - 1
    )


def cross(parents: np.ndarray, probability: float, random: np.random.Generator) -> np.ndarray:
    """Blend crossover of neighbours (real coding): each pair, with that probability, gives way to two children, whose genes
    lie between the parents' or up to BLEND of their distance beyond."""
    children = parents.copy()
    pairs = len(parents) // 2
    first, second = parents[: 2 * pairs : 2], parents[1 : 2 * pairs : 2]
    share = random.uniform(-BLEND, 1.0 + BLEND, first.shape)
    chosen = (random.random(pairs) < probability)[:, None]
    children[: 2 * pairs : 2] = np.where(chosen, share * first + (1.0 - share) * second, first)
    children[1 : 2 * pairs : 2] = np.where(chosen, share * second + (1.0 - share) * first, second)
    return reflected(children)


def mutation_probability(rank: np.ndarray, count: int) -> np.ndarray:
    """Eq. 15: P_m = 0.1 - 0.01 i / N_GA; i is the individual's number among N_GA, fittest last."""
    return np.asarray(0.1 - 0.01 * rank / count)


def mutate(children: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Each gene, with its individual's probability of eq. 15, is drawn anew from the box."""
    count = len(children)
    probability = mutation_probability(np.arange(1, count + 1), count)[:, None]
    hit = random.random(children.shape) < probability
    return np.where(hit, random.random(children.shape), children)


def starting_velocity(
    position: np.ndarray, better: int, done: float, options: SwarmOptions, random: np.random.Generator
) -> np.ndarray:
    """(m, d) of particles (m, d) of which the first so many are generation II1, when a share `done` of the loop is over.

    Half the way from one to another of the same generation; or, all but that share of II2, at random.
    """
    at_random = options.velocity_limit * random.uniform(-1.0, 1.0, position.shape)
    apart = np.vstack([_apart(part, random) for part in (position[:better], position[better:])])
    sets_out = (np.arange(len(position)) >= better) & (random.random(len(position)) >= done)
    limited = np.clip(apart, -options.velocity_limit, options.velocity_limit)
    return np.where(sets_out[:, None], at_random, limited)


def _apart(position: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(m, d) half the ways between pairs drawn from these particles."""
    return np.asarray(0.5 * (random.permutation(position) - random.permutation(position)))


def alone(options: SwarmOptions, part: str) -> SwarmOptions:
    """`pso` or `ga` alone with as many generations as the whole would have, in one stretch."""
    total = options.generations * (options.swarm_generations + options.genetic_generations)
    if part == "pso":
        return replace(options, generations=1, swarm_generations=total, genetic_generations=0)
    if part == "ga":
        return replace(options, generations=1, swarm_generations=0, genetic_generations=total)
    raise InputError("pso-ga: part", repr(part), "pso or ga")
