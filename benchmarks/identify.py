"""Optimisers on the identification of six LuGre parameters: the same data, the same compiled cost, the same box.

Counted is what each needs to come within 1 % of the least cost known: wall time and evaluations, over many seeds. This
package's PSO-GA, PSO, GA and its default (a swarm over three shape parameters with the linear part solved for, then
Levenberg-Marquardt) beside scipy, pymoo and cma, each with its own default settings.

Then the paper's comparison: what RMSE above the least possible PSO-GA leaves after so many evaluations, and PSO alone after as
many, and after 300 generations more; in the box that the data suggest, and in the paper's; on the paper's axis and on others
drawn at random within the paper's box.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks import crossings
from tcs_friction.commands.parser import positive
from tcs_friction.errors import InputError
from tcs_friction.identify.cost import LuGreCost, ShapeCost
from tcs_friction.identify.identification import QUICK, identify
from tcs_friction.identify.operators import SwarmOptions, alone
from tcs_friction.identify.problem import Problem
from tcs_friction.identify.pso_ga import search
from tcs_friction.identify.refine import refine
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.physics.axis import Axis
from tcs_friction.report.paper.identification import paper_box

WITHIN = 1.01
PEERS = ("cma", "pymoo")
POPULATION = 60
OURS = ("default", "pso-ga", "pso", "ga")
MORE_GENERATIONS = 300  # that PSO needed in the paper
FINE = {"xatol": 1e-9, "fatol": 1e-9, "maxfev": 3000}


class ReachedError(Exception):
    """The target cost has been reached."""


@dataclass
class Counted:
    """The cost over the unit box (m, 6) that counts evaluations and ends a search at the target or the budget."""

    cost: Callable[[np.ndarray], np.ndarray]
    target: float
    budget: int
    evaluations: int = 0
    least: float = np.inf

    def __call__(self, position: np.ndarray) -> np.ndarray:
        found = self.cost(np.clip(position, 0.0, 1.0))
        self.evaluations += len(found)
        self.least = min(self.least, float(found.min()))
        if self.least <= self.target or self.evaluations >= self.budget:
            raise ReachedError
        return found

    def single(self, position: np.ndarray) -> float:
        return float(self(np.asarray(position)[None])[0])


Optimiser = Callable[[Counted, int], object]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=positive, default=20)
    parser.add_argument("--budget", type=positive, default=30_000, help="evaluations at most")
    parser.add_argument("--axes", type=positive, default=5, help="that PSO-GA and PSO are compared on")
    parser.add_argument("--only", nargs="*", help="names of optimisers to run, alone")


def optimisers(budget: int) -> dict[str, Optimiser]:
    """All that are installed, by name."""
    found: dict[str, Optimiser] = {name: _swarm(name, budget) for name in OURS if name != "default"}
    found["scipy differential_evolution"] = _differential_evolution
    found["scipy dual_annealing"] = _dual_annealing
    if importlib.util.find_spec("pymoo"):
        found.update({f"pymoo {name}": _pymoo(name, budget) for name in ("PSO", "GA", "CMAES")})
    if importlib.util.find_spec("cma"):
        found["cma"] = _cma
    return found


def _swarm(name: str, budget: int) -> Optimiser:
    options = replace(SwarmOptions(), stagnation=10**6, budget=10**9)
    per_round = options.population * (options.swarm_generations + options.genetic_generations)
    options = replace(options, generations=max(1, round(budget / per_round * 1.3)))
    if name != "pso-ga":
        options = alone(options, name)
    return lambda cost, seed: search(cost, 6, seed, options)


def _differential_evolution(cost: Counted, seed: int) -> object:
    from scipy.optimize import differential_evolution

    return differential_evolution(
        lambda x: cost(x.T),
        [(0.0, 1.0)] * 6,
        rng=seed,
        vectorized=True,
        updating="deferred",
        polish=False,
        maxiter=10**6,
        tol=0.0,
    )


def _dual_annealing(cost: Counted, seed: int) -> object:
    from scipy.optimize import dual_annealing

    return dual_annealing(cost.single, [(0.0, 1.0)] * 6, rng=seed, maxiter=10**6, maxfun=10**9)


def _pymoo(name: str, budget: int) -> Optimiser:
    from pymoo.core.problem import Problem as PymooProblem
    from pymoo.optimize import minimize as run_pymoo

    module = {"PSO": "pso", "GA": "ga", "CMAES": "cmaes"}[name]
    algorithm = getattr(importlib.import_module(f"pymoo.algorithms.soo.nonconvex.{module}"), name)

    def run_one(cost: Counted, seed: int) -> object:
        class Crossing(PymooProblem):
            def __init__(self) -> None:
                super().__init__(n_var=6, n_obj=1, xl=np.zeros(6), xu=np.ones(6))

            def _evaluate(self, x: np.ndarray, out: dict[str, np.ndarray], *_: object, **__: object) -> None:
                out["F"] = cost(np.atleast_2d(x))[:, None]

        chosen = algorithm() if name == "CMAES" else algorithm(pop_size=POPULATION)
        return run_pymoo(Crossing(), chosen, ("n_eval", budget), seed=seed, verbose=False)

    return run_one


def _cma(cost: Counted, seed: int) -> object:
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "seed": seed + 1,
        "verbose": -9,
        "maxfevals": cost.budget,
        "tolfun": 0.0,
        "tolflatfitness": 10**6,
    }
    while True:  # restarts, as its author advises
        strategy = cma.CMAEvolutionStrategy(np.random.default_rng(seed).random(6), 0.3, options)
        while not strategy.stop():
            candidates = strategy.ask()
            strategy.tell(candidates, cost(np.array(candidates)).tolist())
        seed += 1000
        options["seed"] = seed


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    posed = crossings.problem()
    cost = crossings.lugre_cost(posed)
    best = _best_known(cost, crossings.axis())
    known = {"default": None, **optimisers(arguments.budget)}
    chosen = arguments.only or list(known)
    for name in chosen:
        if name not in known:
            raise InputError("bench identify", f"no optimiser {name!r}", f"one of: {', '.join(known)}")
    missing = [name for name in PEERS if not importlib.util.find_spec(name)]
    if missing:
        print(f"not installed: {', '.join(missing)} (pip install -r requirements/bench.txt)", file=sys.stderr)
    rows = {}
    for name in chosen:
        if sys.stderr.isatty():
            print(name, file=sys.stderr)
        optimiser = known[name]
        trials = [
            _default(posed, cost, seed, best)
            if optimiser is None
            else _trial(optimiser, cost, seed, best, arguments.budget)
            for seed in range(arguments.seeds)
        ]
        rows[name] = np.array(trials)
    paper = [] if arguments.only is not None else _paper(arguments.axes, arguments.seeds)
    return [*_results(rows), *paper]


def _paper(axes: int, seeds: int) -> list[dict[str, Any]]:
    """PSO-GA beside PSO alone: RMSE above the least, median over the seeds, N m."""
    results = []
    for number in range(axes):
        axis = crossings.drawn(number)
        posed = crossings.problem(number, of=axis)
        for where, box in (("data's box", None), ("paper's box", paper_box())):
            cost = LuGreCost(posed, False, False, believed_start(posed), box, len(posed.motion))
            best = _best_known(cost, axis, number)
            hybrid, same, longer = (float(np.median(column)) for column in _hybrid(cost, best, seeds).T)
            label = f"pso-ga beside pso, axis {number}, {where}: median rmse above the least"
            for name, beside in (
                ("at equal evaluations", same),
                (f"with {MORE_GENERATIONS} generations less", longer),
            ):
                row = {"name": f"{label}, {name}", "value": hybrid, "unit": "N m", "beside": beside}
                results.append({**row, "ratio": hybrid / beside})
    return results


def _hybrid(cost: LuGreCost, best: float, seeds: int) -> np.ndarray:
    """(seeds, 3) N m: PSO-GA, PSO after as many evaluations, PSO after MORE_GENERATIONS generations more."""
    options = replace(SwarmOptions(), stagnation=10**6, budget=10**9)

    def above(costs: float) -> float:
        return float(np.sqrt(2.0 * max(costs - best, 0.0) / cost.points))

    rows = []
    for seed in range(seeds):
        hybrid = search(cost, 6, seed, options)
        generations = hybrid.evaluations // options.population
        swarms = [
            search(cost, 6, seed, replace(alone(options, "pso"), swarm_generations=count)).cost
            for count in (generations, generations + MORE_GENERATIONS)
        ]
        rows.append([above(hybrid.cost), *(above(found) for found in swarms)])
    return np.array(rows)


def _best_known(cost: LuGreCost, axis: Axis, seed: int = 0) -> float:
    """Least cost known: the default method's, polished on the very points of this cost."""
    found = identify(crossings.series(seed, of=axis), axis)
    start = cost.box.position(np.array([found.parameters[name].value for name in cost.box.names]))
    polished = minimize(
        lambda x: float(cost(np.clip(x, 0.0, 1.0)[None])[0]), start, method="Nelder-Mead", options=FINE
    )
    return float(polished.fun)


def _trial(
    optimiser: Optimiser, cost: LuGreCost, seed: int, best: float, budget: int
) -> tuple[float, float, float]:
    """Seconds, evaluations, least cost over the best known."""
    counted = Counted(cost, WITHIN * best, budget)
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with contextlib.suppress(ReachedError):
            optimiser(counted, seed)
    return time.perf_counter() - began, counted.evaluations, counted.least / best


def _default(posed: Problem, cost: LuGreCost, seed: int, best: float) -> tuple[float, float, float]:
    """The default method to its end: swarm over the shape, Levenberg-Marquardt over all parameters."""
    began = time.perf_counter()
    start = believed_start(posed)
    shape = ShapeCost(posed, False, False, start)
    found = search(shape, 3, seed, QUICK)
    refined = refine(
        posed.linearised,
        posed.torque,
        posed.target,
        posed.weights,
        shape.unknowns(found.position),
        space_of(posed, False, False, False),
    )
    seconds = time.perf_counter() - began
    final = float(cost.costs(refined.unknowns[None, :8])[0])
    return seconds, found.evaluations + refined.evaluations, final / best


def _results(rows: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    peers = [
        np.median(row[:, 0]) for name, row in rows.items() if name not in OURS and (row[:, 2] <= WITHIN).all()
    ]
    beside = float(min(peers)) if peers else None
    results = []
    for name, row in rows.items():
        reached = row[:, 2] <= WITHIN
        median = float(np.median(row[:, 0]))
        ratio = beside / median if beside and reached.all() else None
        results.append(
            {"name": f"{name}: median time", "value": median, "unit": "s", "beside": beside, "ratio": ratio}
        )
        for label, value in (
            ("worst time", float(row[:, 0].max())),
            ("median evaluations", float(np.median(row[:, 1]))),
            ("seeds that fail", float(np.sum(~reached))),
            ("median rmse over the best", float(np.sqrt(np.median(row[:, 2])))),
            ("worst rmse over the best", float(np.sqrt(row[:, 2].max()))),
        ):
            results.append(
                {"name": f"{name}: {label}", "value": value, "unit": "1", "beside": None, "ratio": None}
            )
    return results
