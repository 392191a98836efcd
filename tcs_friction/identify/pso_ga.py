"""The paper's PSO-GA: a particle swarm whose worse half is evolved genetically, generation after generation.

Steps 1 to 14 of the paper (section 3.2), with the errata of docs/paper-errata.md: step 10 reads `if K > G_GA`. The operators are
in `operators.py`. A swarm hands on where its particles were best. What velocity a particle has when the next swarm begins, the
paper leaves open. Those of generation II1 fly on at the size of their own spread; of those that the GA made, some do so too,
others set out like new ones, fewer and fewer as the loop goes on, as the weight falls within a swarm (eq. 12). If all set out
like new ones, every swarm forgets how near the one before had come; if none do, all settle in the first valley. PSO and GA alone
are the same pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.identify.operators import (
    SwarmOptions,
    cross,
    fly,
    inertia_weight,
    mutate,
    roulette,
    split,
    starting_velocity,
)
from tcs_friction.numerics.outcome import Outcome

Cost = Callable[[np.ndarray], np.ndarray]  # positions (m, d) in the unit box -> costs (m,)


@dataclass(frozen=True)
class Generation:
    """Progress: how many generations are done, best cost so far, evaluations, share of the planned generations."""

    number: int
    cost: float
    evaluations: int
    share: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """position (d,) in the unit box, its cost, best cost (g,) per generation, evaluations, how it ended.

    evaluated (g,): evaluations until the end of each generation.
    """

    position: np.ndarray
    cost: float
    history: np.ndarray
    evaluations: int
    outcome: Outcome
    evaluated: np.ndarray


@dataclass
class _Search:
    """What all generations share: best particle, evaluations, when to stop."""

    cost: Cost
    options: SwarmOptions
    random: np.random.Generator
    progress: Callable[[Generation], None]
    cancel: Callable[[], bool]
    planned: int
    best: np.ndarray = field(default_factory=lambda: np.zeros(0))
    best_cost: float = np.inf
    evaluations: int = 0
    history: list[float] = field(default_factory=list)
    evaluated: list[int] = field(default_factory=list)
    last_gain: int = 0
    gained_cost: float = np.inf
    outcome: Outcome | None = None

    def evaluate(self, positions: np.ndarray) -> np.ndarray:
        costs = self.cost(positions)
        self.evaluations += len(positions)
        leader = int(np.nanargmin(costs)) if np.isfinite(costs).any() else 0
        if costs[leader] < self.best_cost:
            self.best_cost, self.best = float(costs[leader]), positions[leader].copy()
        return costs

    def generation_done(self) -> bool:
        """Book one generation; True when it is time to stop."""
        self.history.append(self.best_cost)
        self.evaluated.append(self.evaluations)
        if not self.best_cost > self.gained_cost * (1.0 - self.options.stagnation_gain):
            self.gained_cost, self.last_gain = self.best_cost, len(self.history)
        number = len(self.history)
        self.progress(Generation(number, self.best_cost, self.evaluations, min(1.0, number / self.planned)))
        if self.best_cost <= self.options.cost_tolerance:
            self.outcome = Outcome.TOLERANCE
        elif self.cancel():
            self.outcome = Outcome.CANCELLED
        elif self.evaluations + self.options.population > self.options.budget:
            self.outcome = Outcome.BUDGET_SPENT
        elif number - self.last_gain >= self.options.stagnation:
            self.outcome = Outcome.STAGNATED
        return self.outcome is not None


def search(
    cost: Cost,
    dimensions: int,
    seed: int | Sequence[int],
    options: SwarmOptions | None = None,
    start: np.ndarray | None = None,
    progress: Callable[[Generation], None] = lambda _: None,
    cancel: Callable[[], bool] = lambda: False,
) -> SearchResult:
    """Minimise a cost over the unit box by PSO-GA. Same seed, same result.

    `start` (k, d): particles to begin with among the random ones. Raises InputError where no particle has a cost.
    """
    options = options or SwarmOptions()
    random = np.random.default_rng(seed)
    planned = options.generations * (options.swarm_generations + options.genetic_generations)
    state = _Search(cost, options, random, progress, cancel, planned)
    position = random.random((options.population, dimensions))  # step 1
    if start is not None:
        position[: len(start)] = np.clip(start, 0.0, 1.0)
    costs, better = state.evaluate(position), 0  # step 2
    if not np.isfinite(costs).any():
        found = "no candidate can be compared with these samples"
        raise InputError("identification", found, "a longer run in which the axis slides")
    for number in range(options.generations):  # steps 3, 4 and 13
        velocity = starting_velocity(position, better, number / options.generations, options, random)
        position, costs = _swarm(state, position, costs, velocity)  # steps 5 to 7
        if state.outcome is not None:
            break
        position, costs, better = _evolve_worse(state, position, costs)  # steps 8 to 12
        if state.outcome is not None:
            break
    outcome = state.outcome or Outcome.BUDGET_SPENT
    history, evaluated = np.array(state.history), np.array(state.evaluated)
    return SearchResult(state.best, state.best_cost, history, state.evaluations, outcome, evaluated)  # step 14


def _swarm(
    state: _Search, position: np.ndarray, costs: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Steps 5 to 7: G_PSO generations of the particle swarm. The particles end where each was best."""
    options, random = state.options, state.random
    own_best, own_cost = position.copy(), costs.copy()
    for iteration in range(1, options.swarm_generations + 1):
        weight = inertia_weight(options, iteration)
        position, velocity = fly(position, velocity, own_best, state.best, weight, options, random)  # step 6
        costs = state.evaluate(position)
        better = costs < own_cost  # step 5
        own_best[better], own_cost[better] = position[better], costs[better]
        if state.generation_done():
            break
    return own_best, own_cost


def _evolve_worse(
    state: _Search, position: np.ndarray, costs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Steps 8 to 12: the particles below mean fitness are evolved for G_GA generations and join the better ones.

    Returns positions and costs, the better ones first, and how many these are.
    """
    options, random = state.options, state.random
    better, worse = split(costs)  # step 8: generation II1, and the GA's population
    if options.swarm_generations == 0:
        better, worse = (
            better[:1],
            np.setdiff1d(np.arange(len(costs)), better[:1]),
        )  # GA alone keeps its elite
    if len(worse) < 2 or options.genetic_generations == 0:
        return position, costs, len(costs)
    evolving, evolving_costs = position[worse], costs[worse]
    for _ in range(options.genetic_generations):  # step 10
        fittest_last = np.argsort(-evolving_costs, kind="stable")
        chosen = fittest_last[np.sort(roulette(evolving_costs[fittest_last], len(worse), random))]
        children = mutate(_mated(evolving[chosen], options, random), random)  # step 9
        child_costs = state.evaluate(children)
        pool, pool_costs = np.vstack([evolving, children]), np.concatenate([evolving_costs, child_costs])
        survivors = np.argsort(pool_costs, kind="stable")[: len(worse)]  # step 11: generation II2, sorted
        evolving, evolving_costs = pool[survivors], pool_costs[survivors]
        if state.generation_done():
            break
    joined = np.vstack([position[better], evolving])  # step 12
    return joined, np.concatenate([costs[better], evolving_costs]), len(better)


def _mated(parents: np.ndarray, options: SwarmOptions, random: np.random.Generator) -> np.ndarray:
    """Crossover of randomly paired parents, in their own places, so that eq. 15 still sees them in order of fitness."""
    order = random.permutation(len(parents))
    children = np.empty_like(parents)
    children[order] = cross(parents[order], options.crossover, random)
    return children
