"""Diagnosis of concealed effects: draw axes, conceal effects, see what the tool makes of bag and believed axis alone.

Worlds come from an independent simulation (concealed_physics.py). Counted: exact sets for one, two and three effects, false
alarms where nothing is concealed, `unexplained` where the effect is outside the vocabulary; errors of parameters, held-out
residual over the noise floor, time. Beside it two baselines on the same worlds, and, with --limits, the size at which each
effect is found in half of all recordings beside that of an oracle (concealed_oracle.py).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.children import deaf, ended_with_this
from benchmarks.concealed_baselines import baselines
from benchmarks.concealed_effects import EFFECTS, OUTSIDE
from benchmarks.concealed_oracle import detection_limit
from benchmarks.worlds import World, draw_world
from tcs_friction.commands.parser import positive
from tcs_friction.diagnose.parallel import cores
from tcs_friction.diagnose.pipeline import diagnose

SMALLEST, LARGEST = 1.0, 8.0  # sizes of concealed effects, torque rms over that of the noise floor
NATURAL = ("presliding",)  # effects that come as large as they are
LIMITED = [name for name in EFFECTS if name not in (*OUTSIDE, *NATURAL)]  # that have a detection limit
TOOL = "diagnose"


@dataclass(frozen=True)
class Case:
    """One world to draw: how many effects or which, seeds, length."""

    kind: str
    effects: tuple[str, ...] | int
    seed: tuple[int, ...]
    stretch: float
    size: float | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of one case: the effects concealed and those each method named."""

    kind: str
    concealed: tuple[str, ...]
    named: dict[str, tuple[str, ...]]
    right: dict[str, bool]
    verdict: str
    seconds: float
    held_out: float  # rms over that of the noise floor
    errors: dict[str, float] = field(default_factory=dict)  # relative, of parameters of effects found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--seed", type=int, default=0, help="of all worlds (default 0)")
    parser.add_argument(
        "--worlds", type=positive, default=1, help="worlds per effect; pairs and others in proportion"
    )
    parser.add_argument(
        "--stretch", type=float, default=1.0, help="length of the recordings; 1 is about 340 s"
    )
    parser.add_argument(
        "--limits",
        nargs="*",
        metavar="EFFECT",
        choices=LIMITED,
        help="detection limits, of all effects or these",
    )
    parser.add_argument(
        "--only", choices=["none", "one", "two", "three", "outside"], help="one kind of world"
    )
    parser.add_argument("--count", type=positive, help="only so many of the worlds, drawn at random from them")
    parser.add_argument("--jobs", type=positive, default=cores(), help="processes")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """All worlds, then the limits where asked for."""
    with ProcessPoolExecutor(arguments.jobs, multiprocessing.get_context("spawn")) as pool, ended_with_this():
        if arguments.limits is not None and arguments.only is None:
            tasks = [(name, arguments.seed, arguments.stretch) for name in arguments.limits or LIMITED]
            return limit_rows(list(_watched(_begun(pool, limits_of, tasks), len(tasks))))
        cases = draw_cases(arguments.seed, arguments.worlds, arguments.stretch, arguments.only)
        if arguments.count is not None and arguments.count < len(cases):
            kept = np.random.default_rng(arguments.seed).choice(len(cases), arguments.count, replace=False)
            cases = [cases[i] for i in sorted(kept)]
        return rows(list(_watched(_begun(pool, solve, cases), len(cases))))


def _begun(pool: ProcessPoolExecutor, work: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
    with deaf():
        return pool.map(work, tasks)


def _watched(results: Iterable[Any], count: int) -> Iterable[Any]:
    for done, result in enumerate(results, 1):
        if sys.stderr.isatty():
            print(f"\r{done}/{count}", end="\n" if done == count else "", file=sys.stderr, flush=True)
        yield result


def draw_cases(seed: int, worlds: int, stretch: float, only: str | None = None) -> list[Case]:
    """Every effect alone so many times, and about as many others as their bars need."""
    known = [name for name in EFFECTS if name not in OUTSIDE]
    wanted: list[tuple[str, tuple[str, ...] | int]] = []
    wanted += [("one", (name,)) for name in known] * worlds
    wanted += [("none", ())] * 10 * worlds
    wanted += [("two", 2)] * 14 * worlds
    wanted += [("three", 3)] * 6 * worlds
    wanted += [("outside", (name,)) for name in OUTSIDE] * 2 * worlds
    cases = [Case(kind, effects, (seed, i), stretch) for i, (kind, effects) in enumerate(wanted)]
    return [case for case in cases if only in (None, case.kind)]


def world_of(case: Case) -> World:
    """The case's world; sizes between SMALLEST and LARGEST unless it says one."""
    rng = np.random.default_rng(case.seed)
    size = (
        case.size if case.size is not None else math.exp(rng.uniform(math.log(SMALLEST), math.log(LARGEST)))
    )
    return draw_world(rng, case.effects, size, case.stretch)


def solve(case: Case) -> Outcome:
    """Diagnose one world with the tool and the baselines."""
    world = world_of(case)
    begin = time.perf_counter()
    found = diagnose([world.recording], world.believed).to_mapping()
    seconds = time.perf_counter() - begin
    others = baselines(world.recording, world.believed, world.truth.noise_floor)
    concealed = tuple(name for name in world.truth.effects if name not in OUTSIDE)
    outside = len(concealed) < len(world.truth.effects)
    named = {TOOL: tuple(entry["effect"] for entry in found["effects"]), **others}
    right = {name: set(effects) == set(concealed) and not outside for name, effects in others.items()}
    verdict = str(found["verdict"])
    expected = "unexplained" if outside else ("missing_physics" if concealed else verdict)
    right[TOOL] = verdict == expected and same_set(concealed, found["effects"])
    if not concealed and not outside:
        right[TOOL] = verdict in ("match", "parameters") and not named[TOOL]
    floor = float(found["fit"]["noise_floor"])
    held_out = float(found["fit"]["improved"]["held_out"]) / floor
    errors = parameter_errors(world, found["effects"])
    return Outcome(case.kind, world.truth.effects, named, right, verdict, seconds, held_out, errors)


def same_set(concealed: Sequence[str], entries: Sequence[dict[str, Any]]) -> bool:
    """Whether the entries name the concealed effects one to one, each by its id or as equivalent; maps count for nothing."""
    entries = [entry for entry in entries if entry["effect"] != "learned_map"]
    left = list(concealed)
    for entry in entries:
        match = next((name for name in left if name in (entry["effect"], *entry["equivalent"])), None)
        if match is None:
            return False
        left.remove(match)
    return not left


def parameter_errors(world: World, entries: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Relative error of every parameter that both name; phases in turns."""
    errors = {}
    for entry in entries:
        truth = world.truth.parameters.get(entry["effect"], {})
        for name, value in truth.items():
            if name not in entry["parameters"]:
                continue
            found = float(entry["parameters"][name]["value"])
            if name.startswith("phase"):
                error = abs((found - value + math.pi) % (2.0 * math.pi) - math.pi) / (2.0 * math.pi)
            else:
                error = abs(found - value) / max(abs(value), 1e-12)
            errors[f"{entry['effect']}.{name}"] = error
    return errors


def row(name: str, value: float, unit: str = "1", beside: float | None = None) -> dict[str, Any]:
    """One result; the ratio is of the value to what stands beside it."""
    ratio = value / beside if beside else None
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": ratio}


def rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Shares right per kind and method, then errors, residuals, time and the confusions."""
    found = []
    labels = {
        "one": "one effect, right and alone",
        "two": "two effects, exact set",
        "three": "three effects, exact set",
        "outside": "outside the vocabulary, said so",
    }
    for kind, label in labels.items():
        found += _shares(label, [o for o in outcomes if o.kind == kind], lambda o, method: o.right[method])
    nothing = [o for o in outcomes if o.kind == "none"]
    found += _shares("nothing concealed, false alarm", nothing, lambda o, method: not o.right[method])
    known = [o for o in outcomes if o.kind != "outside"]
    if known:
        ratios = [o.held_out for o in known]
        found.append(row("held-out residual over noise floor, median", float(np.median(ratios))))
        found.append(row("held-out residual over noise floor, worst", max(ratios)))
    errors = [error for o in outcomes if o.right[TOOL] for error in o.errors.values()]
    if errors:
        found.append(row("relative error of parameters, median", float(np.median(errors))))
        found.append(row("relative error of parameters, 90 % of them below", float(np.quantile(errors, 0.9))))
    seconds = [o.seconds for o in outcomes]
    found.append(row("time per recording, median", float(np.median(seconds)), "s"))
    found.append(row("time per recording, longest", max(seconds), "s"))
    return found + confusions(outcomes)


def _shares(
    label: str, outcomes: Sequence[Outcome], counted: Callable[[Outcome, str], bool]
) -> list[dict[str, Any]]:
    if not outcomes:
        return []
    methods = list(outcomes[0].right)
    shares = {m: 100.0 * float(np.mean([counted(o, m) for o in outcomes])) for m in methods}
    others = [row(f"{label}: {m}", shares[m], f"% of {len(outcomes)}") for m in methods if m != TOOL]
    return [row(label, shares[TOOL], f"% of {len(outcomes)}"), *others]


def confusions(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """How often which concealed set was named what, where the tool was wrong."""
    wrong = Counter(
        (", ".join(sorted(o.concealed)) or "nothing", ", ".join(sorted(o.named[TOOL])) or o.verdict)
        for o in outcomes
        if not o.right[TOOL]
    )
    return [row(f"{truth} named {named}", float(count)) for (truth, named), count in sorted(wrong.items())]


def limits_of(task: tuple[str, int, float]) -> tuple[str, float, float]:
    """An effect's detection limits over the noise floor: the tool's, by an up-and-down search, and the oracle's."""
    name, seed, stretch = task
    index = list(EFFECTS).index(name)
    world = world_of(Case("limit", (name,), (seed, index, 0), stretch, 1.0))
    believed = world.believed.axis
    declared = {p.name for p in believed.friction.term.parameters}
    values = {n: v for n, v in world.truth.friction.items() if n in declared}
    axis = replace(believed.with_friction(values), inertia=world.truth.inertia)
    oracle = detection_limit(world, axis) / world.truth.noise_floor
    size, factor, visited, before = 3.0 * oracle, 2.0, [], None
    for trial in range(1, 9):
        case = Case("limit", (name,), (seed, index, trial), stretch, size)
        hidden = world_of(case)
        entries = diagnose([hidden.recording], hidden.believed).to_mapping()["effects"]
        seen = any(name in (entry["effect"], *entry["equivalent"]) for entry in entries)
        if before is not None and seen != before:
            factor = math.sqrt(factor) if factor > 1.3 else factor
            visited.append(size)
        before = seen
        size = size / factor if seen else size * factor
    visited.append(size)
    return name, float(np.exp(np.mean(np.log(visited)))), oracle


def limit_rows(limits: Sequence[tuple[str, float, float]]) -> list[dict[str, Any]]:
    """One row an effect, and the median ratio."""
    found = [row(f"detection limit, {name}", tool, "noise floors", oracle) for name, tool, oracle in limits]
    return [
        *found,
        row("detection limit over the oracle's, median", float(np.median([t / o for _, t, o in limits]))),
    ]
