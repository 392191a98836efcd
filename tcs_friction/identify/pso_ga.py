"""The paper's PSO-GA: a particle swarm whose worse half is evolved genetically, generation after generation.

Steps 1 to 14 and equations 5 to 8 and 12 to 15 of the paper (sections 3.2 and 5.3), with the errata of
docs/paper-errata.md: positions and velocities live in the normalised search box, so that one velocity limit serves
parameters of all sizes; step 10 reads `if K > G_GA`; the roulette wheel gives equal chances when all costs are equal.
A swarm hands on where its particles were best. What velocity a particle has when the next swarm begins, the paper leaves
open: those of generation II1 fly on at the size of their own spread, those that the GA made set out like new ones. If all set
out like new ones, every swarm forgets how near the one before had come. PSO and GA alone are the same pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.identify.refine import Outcome

Cost = Callable[[np.ndarray], np.ndarray]  # positions (m, d) in the unit box -> costs (m,)


@dataclass(frozen=True)
class SwarmOptions:
    """Settings of PSO-GA; the names in brackets are the paper's."""

    population: int = 60  # [N_PSO-GA]
    generations: int = 18  # [G_max] of the whole loop
    swarm_generations: int = 15  # [G_PSO] within each
    genetic_generations: int = 5  # [G_GA] within each
    local_factor: float = 1.3  # [c_1]
    global_factor: float = 1.75  # [c_2]
    greatest_weight: float = 0.9  # [W_max] inertia weight, eq. 12
    least_weight: float = 0.1  # [W_min]
    velocity_limit: float = 0.1  # [V_max = -V_min], of the normalised box
    crossover: float = 0.9  # [P_c]
    cost_tolerance: float = 0.0  # stop at this cost; 0: never
    stagnation: int = 80  # stop after so many generations of PSO or GA without gain
    stagnation_gain: float = 1e-4  # relative gain of cost that counts as one
    budget: int = 200_000  # cost evaluations at most

    def __post_init__(self) -> None:
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
    population=100, generations=300, swarm_generations=300, genetic_generations=200, velocity_limit=1.0,
    stagnation=600, budget=10_000_000,
)  # fmt: skip
"""Section 5.3. The paper's population is its number of data points (4600), "to simplify the algorithm"; 100 is ours."""


@dataclass(frozen=True)
class Generation:
    """Progress: how many generations are done, best cost so far, evaluations, share of the planned generations."""

    number: int
    cost: float
    evaluations: int
    share: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """position (d,) in the unit box, its cost, best cost per generation, evaluations, how it ended."""

    position: np.ndarray
    cost: float
    history: np.ndarray
    evaluations: int
    outcome: Outcome


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
    """Eqs. 7 and 8 with the velocity limit; a particle that hits the box stops at its wall. Shapes (m, d), best (d,)."""
    r1, r2 = random.random(position.shape), random.random(position.shape)
    pull = options.local_factor * r1 * (own_best - position) + options.global_factor * r2 * (best - position)
    velocity = np.clip(weight * velocity + pull, -options.velocity_limit, options.velocity_limit)
    moved = position + velocity
    inside = (moved >= 0.0) & (moved <= 1.0)
    return np.clip(moved, 0.0, 1.0), np.where(inside, velocity, 0.0)


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
    """Arithmetic crossover of neighbours (real coding): each pair, with that probability, is blended coordinate by coordinate."""
    children = parents.copy()
    pairs = len(parents) // 2
    first, second = parents[: 2 * pairs : 2], parents[1 : 2 * pairs : 2]
    share = random.random(first.shape)
    chosen = (random.random(pairs) < probability)[:, None]
    children[: 2 * pairs : 2] = np.where(chosen, share * first + (1.0 - share) * second, first)
    children[1 : 2 * pairs : 2] = np.where(chosen, share * second + (1.0 - share) * first, second)
    return children


def mutation_probability(rank: np.ndarray, count: int) -> np.ndarray:
    """Eq. 15: P_m = 0.1 - 0.01 i / N_GA; i is the individual's number among N_GA, fittest last."""
    return np.asarray(0.1 - 0.01 * rank / count)


def mutate(children: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Each gene, with its individual's probability of eq. 15, is drawn anew from the box."""
    count = len(children)
    probability = mutation_probability(np.arange(1, count + 1), count)[:, None]
    hit = random.random(children.shape) < probability
    return np.where(hit, random.random(children.shape), children)


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
    seed: int,
    options: SwarmOptions | None = None,
    start: np.ndarray | None = None,
    progress: Callable[[Generation], None] = lambda _: None,
    cancel: Callable[[], bool] = lambda: False,
) -> SearchResult:
    """Minimise a cost over the unit box by PSO-GA. Same seed, same result.

    `start` (k, d): particles to begin with among the random ones.
    """
    options = options or SwarmOptions()
    random = np.random.default_rng(seed)
    planned = options.generations * (options.swarm_generations + options.genetic_generations)
    state = _Search(cost, options, random, progress, cancel, planned)
    position = random.random((options.population, dimensions))  # step 1
    if start is not None:
        position[: len(start)] = np.clip(start, 0.0, 1.0)
    costs, survivors = state.evaluate(position), 0  # step 2
    for _ in range(options.generations):  # steps 3, 4 and 13
        velocity = starting_velocity(position, survivors, options, random)
        position, costs = _swarm(state, position, costs, velocity)  # steps 5 to 7
        if state.outcome is not None:
            break
        position, costs, survivors = _evolve_worse(state, position, costs)  # steps 8 to 12
        if state.outcome is not None:
            break
    outcome = state.outcome or Outcome.BUDGET_SPENT
    return SearchResult(
        state.best, state.best_cost, np.array(state.history), state.evaluations, outcome
    )  # step 14


def starting_velocity(
    position: np.ndarray, survivors: int, options: SwarmOptions, random: np.random.Generator
) -> np.ndarray:
    """(m, d): half the way from one survivor to another for the first so many particles, at random for the rest."""
    velocity = options.velocity_limit * random.uniform(-1.0, 1.0, position.shape)
    from_one, to_other = random.permutation(survivors), random.permutation(survivors)
    apart = 0.5 * (position[to_other] - position[from_one])
    velocity[:survivors] = np.clip(apart, -options.velocity_limit, options.velocity_limit)
    return velocity


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


def alone(options: SwarmOptions, part: str) -> SwarmOptions:
    """`pso` or `ga` alone with as many generations as the whole would have, in one stretch."""
    total = options.generations * (options.swarm_generations + options.genetic_generations)
    if part == "pso":
        return replace(options, generations=1, swarm_generations=total, genetic_generations=0)
    if part == "ga":
        return replace(options, generations=1, swarm_generations=0, genetic_generations=total)
    raise InputError("pso-ga: part", repr(part), "pso or ga")
