"""Every operator of PSO-GA against its definition in the paper, and the search as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.identify import operators
from tcs_friction.identify.operators import SwarmOptions, alone
from tcs_friction.identify.pso_ga import Generation, search
from tcs_friction.numerics.outcome import Outcome

SMALL = SwarmOptions(population=30, generations=3, swarm_generations=20, genetic_generations=10)


def bowl(position: np.ndarray) -> np.ndarray:
    """Least at 0.3 in every coordinate."""
    return np.asarray(np.sum((position - 0.3) ** 2, axis=1))


def test_fitness_is_the_worst_cost_less_the_own() -> None:
    assert operators.fitness(np.array([3.0, 1.0, 5.0])).tolist() == [2.0, 4.0, 0.0]


def test_a_cost_that_is_not_finite_has_no_fitness() -> None:
    assert operators.fitness(np.array([3.0, np.nan, 5.0, np.inf])).tolist() == [2.0, 0.0, 0.0, 0.0]


def test_weight_falls_linearly_from_greatest_to_least() -> None:
    options = SwarmOptions(swarm_generations=300)
    weights = [operators.inertia_weight(options, i) for i in range(1, 301)]
    assert weights[0] == pytest.approx(0.9 - 0.8 / 300)
    assert weights[-1] == pytest.approx(0.1)
    assert np.diff(weights) == pytest.approx(-0.8 / 300)


def test_velocity_is_inertia_and_two_pulls() -> None:
    """Eq. 7 and 8 with known random numbers, where neither limit nor wall is met."""
    position, velocity = np.full((3, 2), 0.5), np.full((3, 2), 0.01)
    own, best = np.full((3, 2), 0.52), np.array([0.51, 0.49])
    options = SwarmOptions()
    moved, speed = operators.fly(position, velocity, own, best, 0.7, options, np.random.default_rng(5))
    twin = np.random.default_rng(5)
    r1, r2 = twin.random((3, 2)), twin.random((3, 2))
    expected = 0.7 * velocity + 1.3 * r1 * (own - position) + 1.75 * r2 * (best - position)
    assert speed == pytest.approx(expected)
    assert moved == pytest.approx(position + expected)


def test_velocity_is_limited_and_the_walls_reflect() -> None:
    options = SwarmOptions(velocity_limit=0.1)
    position = np.random.default_rng(0).random((200, 3))
    none = np.zeros((200, 3))
    moved, speed = operators.fly(
        position, none, np.ones((200, 3)), np.ones(3), 0.9, options, np.random.default_rng(1)
    )
    assert np.abs(speed).max() <= 0.1
    assert np.abs(moved - position).max() <= 0.1 + 1e-12
    beyond, back = operators.fly(
        np.array([[0.97], [0.02]]), np.array([[0.05], [-0.05]]), np.array([[0.97], [0.02]]), np.array([0.5]), 1.0,
        replace(options, global_factor=0.0), np.random.default_rng(0),
    )  # fmt: skip
    assert beyond[:, 0] == pytest.approx([0.98, 0.03])
    assert back[:, 0] == pytest.approx([-0.05, 0.05])


def test_nothing_is_reflected_out_of_the_box() -> None:
    found = operators.reflected(np.array([-3.0, -1.0, -0.25, 0.0, 0.4, 1.0, 1.25, 2.0, 7.0]))
    assert found == pytest.approx([1.0, 1.0, 0.25, 0.0, 0.4, 1.0, 0.75, 0.0, 0.0])


def test_split_at_the_mean_fitness() -> None:
    better, worse = operators.split(np.array([4.0, 1.0, 10.0, 2.0]))  # fitness 6, 9, 0, 8; mean 5.75
    assert better.tolist() == [1, 3, 0]
    assert worse.tolist() == [2]


def test_roulette_draws_in_proportion_to_fitness() -> None:
    costs = np.array([4.0, 3.0, 1.0])  # fitness 0, 1, 3
    drawn = operators.roulette(costs, 40_000, np.random.default_rng(0))
    shares = np.bincount(drawn, minlength=3) / 40_000
    assert shares == pytest.approx([0.0, 0.25, 0.75], abs=0.01)


def test_roulette_with_equal_costs_gives_equal_chances() -> None:
    drawn = operators.roulette(np.full(4, 2.0), 40_000, np.random.default_rng(0))
    assert np.bincount(drawn, minlength=4) / 40_000 == pytest.approx(0.25, abs=0.01)


def test_crossover_blends_pairs_half_their_distance_beyond() -> None:
    """BLX-0.5: children of one pair add up to their parents; genes are spread evenly over twice the parents' distance."""
    parents = np.tile([[0.4, 0.45], [0.6, 0.5]], (5000, 1))
    children = operators.cross(np.vstack([parents, [[0.2, 0.2]]]), 1.0, np.random.default_rng(2))
    assert children[:-1:2] + children[1::2] == pytest.approx(np.tile([1.0, 0.95], (5000, 1)))
    genes = children[:-1, 0]
    assert (genes.min(), genes.max()) == pytest.approx((0.3, 0.7), abs=1e-3)
    assert np.std(genes) == pytest.approx(0.4 / np.sqrt(12.0), rel=0.02)
    assert (children[-1] == 0.2).all(), "a parent without a partner is its own child"


def test_children_stay_in_the_box() -> None:
    parents = np.random.default_rng(1).integers(0, 2, (2000, 4)).astype(float)
    children = operators.cross(parents, 1.0, np.random.default_rng(2))
    assert ((children >= 0.0) & (children <= 1.0)).all()


def test_crossover_happens_with_its_probability() -> None:
    parents = np.random.default_rng(1).random((20_000, 2))
    children = operators.cross(parents, 0.9, np.random.default_rng(2))
    changed = np.any(children[::2] != parents[::2], axis=1).mean()
    assert changed == pytest.approx(0.9, abs=0.01)


def test_mutation_probability_is_eq_15() -> None:
    found = operators.mutation_probability(np.array([1, 50, 100]), 100)
    assert found == pytest.approx([0.0999, 0.095, 0.09])


def test_mutation_hits_so_many_genes_and_stays_in_the_box() -> None:
    children = np.full((4000, 6), 0.5)
    mutated = operators.mutate(children, np.random.default_rng(3))
    assert (mutated != 0.5).mean() == pytest.approx(0.095, abs=0.005)
    assert ((mutated >= 0.0) & (mutated <= 1.0)).all()


@pytest.mark.parametrize(
    "options", [SMALL, alone(SMALL, "pso"), alone(SMALL, "ga")], ids=["pso-ga", "pso", "ga"]
)
def test_it_finds_the_bottom_of_a_bowl(options: SwarmOptions) -> None:
    found = search(bowl, 4, 0, replace(options, stagnation=1000))
    assert found.position == pytest.approx(0.3, abs=0.05)
    assert found.cost == pytest.approx(bowl(found.position[None])[0])


def test_same_seed_same_result_and_another_seed_another() -> None:
    first, again, other = search(bowl, 3, 7, SMALL), search(bowl, 3, 7, SMALL), search(bowl, 3, 8, SMALL)
    assert (first.position == again.position).all()
    assert (first.history == again.history).all()
    assert not (first.position == other.position).all()


def test_history_never_rises_and_counts_generations() -> None:
    told: list[Generation] = []
    found = search(bowl, 3, 0, replace(SMALL, stagnation=1000), progress=told.append)
    assert (np.diff(found.history) <= 0.0).all()
    assert [generation.number for generation in told] == list(range(1, len(found.history) + 1))
    assert told[-1].share == pytest.approx(len(found.history) / 90), "60 of swarms, up to 30 of GA"
    assert len(found.history) > 60
    assert told[-1].evaluations == found.evaluations
    assert found.outcome is Outcome.BUDGET_SPENT


def test_stopping_rules() -> None:
    assert search(bowl, 3, 0, replace(SMALL, cost_tolerance=1e-2)).outcome is Outcome.TOLERANCE
    flat = search(lambda x: np.ones(len(x)), 3, 0, replace(SMALL, stagnation=5))
    assert flat.outcome is Outcome.STAGNATED
    assert len(flat.history) == 6
    spent = search(bowl, 3, 0, replace(SMALL, budget=200))
    assert spent.outcome is Outcome.BUDGET_SPENT
    assert spent.evaluations <= 200
    assert search(bowl, 3, 0, SMALL, cancel=lambda: True).outcome is Outcome.CANCELLED


def test_a_given_particle_takes_part() -> None:
    found = search(bowl, 3, 0, replace(SMALL, budget=60), start=np.full((1, 3), 0.3))
    assert found.cost == pytest.approx(0.0, abs=1e-30)


def test_costs_that_are_not_numbers_are_passed_over() -> None:
    def holed(position: np.ndarray) -> np.ndarray:
        return np.where(position[:, 0] > 0.5, np.nan, bowl(position))

    assert search(holed, 3, 0, SMALL).position == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(
    "wrong",
    [
        {"population": 3},
        {"generations": 0},
        {"swarm_generations": 0, "genetic_generations": 0},
        {"crossover": 1.2},
        {"velocity_limit": float("nan")},
        {"budget": 0},
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="pso-ga: "):
        SwarmOptions(**wrong)  # type: ignore[arg-type]


def test_only_pso_and_ga_are_parts() -> None:
    with pytest.raises(InputError, match="pso or ga"):
        alone(SMALL, "de")


def test_the_paper_preset_is_section_5_3() -> None:
    paper = operators.PAPER
    assert (paper.generations, paper.swarm_generations, paper.genetic_generations) == (300, 300, 200)
    assert (paper.local_factor, paper.global_factor) == (1.3, 1.75)
    assert (paper.greatest_weight, paper.least_weight, paper.crossover, paper.velocity_limit) == (
        0.9,
        0.1,
        0.9,
        1.0,
    )


@pytest.mark.parametrize("done", [0.0, 0.25, 1.0])
def test_the_better_fly_on_and_of_the_others_that_share(done: float) -> None:
    """Both generations lie close together, so that who flies on at the size of its own spread is slow."""
    random, options = np.random.default_rng(0), SwarmOptions(velocity_limit=0.1)
    position = np.vstack([0.5 + 0.004 * random.random((3000, 3)), 0.2 + 0.004 * random.random((3000, 3))])
    speed = np.abs(operators.starting_velocity(position, 3000, done, options, random)).max(axis=1)
    assert 0.0 < speed[:3000].max() <= 0.002
    assert np.mean(speed[3000:] <= 0.002) == pytest.approx(done, abs=0.03)
    assert speed[3000:].max() <= 0.1


def test_a_swarm_sets_out_at_random() -> None:
    options = SwarmOptions(velocity_limit=0.1)
    velocity = operators.starting_velocity(np.full((3000, 3), 0.5), 0, 0.0, options, np.random.default_rng(0))
    assert np.abs(velocity).max() <= 0.1
    assert np.std(velocity) == pytest.approx(0.1 / np.sqrt(3.0), rel=0.03)


def test_a_cost_that_is_never_defined_is_one_clear_line() -> None:
    """48 samples of a friction estimate, all of them within the observer's lag, once ended in numpy's words."""
    with pytest.raises(InputError, match="no candidate can be compared"):
        search(lambda position: np.full(len(position), np.nan), 3, seed=0)
