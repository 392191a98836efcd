"""Diagnosis of concealed effects: draw axes, conceal effects, see what the tool makes of bag and believed axis alone.

The own worlds come from an independent simulation (concealed_physics.py). Counted: exact sets for one, two and three effects,
false alarms where nothing is concealed, `unexplained` where the effect is outside the vocabulary; errors of parameters, held-out
residual over the noise floor, time. Beside it two baselines on the same worlds, and, with --limits, the size at which each
effect is found in half of all recordings beside that of an oracle (concealed_oracle.py).

`--worlds` asks for other kinds: on MuJoCo, with misspecified bases, with other friction laws, with torques as drives
log them (mujoco_worlds.py, misspecified_worlds.py, law_worlds.py, logged_worlds.py), and recordings: of other simulators
(practice_worlds.py) and of real machines (real_worlds.py). Every kind is judged by one function (concealed_score.py).
`--save` writes worlds for `./tcs diagnose`, `-o` a report with the reliability of the stated probabilities.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.children import begun, ended_with_this
from benchmarks.concealed_baselines import baselines
from benchmarks.concealed_cases import CLASSES, LIMITED, Case, draw_cases, expected_of, own_trial, world_of
from benchmarks.concealed_effects import OUTSIDE
from benchmarks.concealed_kinds import ALL, DRAWN, KINDS, OWN, Task, save, tasks_of
from benchmarks.concealed_kinds import solve as solve_task
from benchmarks.concealed_limits import limit_rows, limits_of
from benchmarks.concealed_report import reliability_rows, row, summary, write_report
from benchmarks.concealed_score import Judged, judge
from benchmarks.trials import save_trial
from benchmarks.worlds import World
from tcs_friction.commands.parser import positive
from tcs_friction.diagnose.parallel import cores
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.rules import RULES
from tcs_friction.diagnose.rules import without as rules_without
from tcs_friction.errors import InputError, nearest
from tcs_friction.writable import output_directory

TOOL = "diagnose"


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
    judged: Judged
    errors: dict[str, float] = field(default_factory=dict)  # relative, of parameters of effects found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--seed", type=int, default=0, help="of all worlds (default 0)")
    parser.add_argument(
        "--worlds", choices=[OWN, *KINDS, ALL], default=OWN, help="kind of worlds; all: every one that is drawn (default own)"
    )
    parser.add_argument(
        "--each", type=positive, default=1, help="own worlds per effect; pairs and others in proportion"
    )
    parser.add_argument(
        "--stretch", type=float, default=1.0, help="length of the own worlds' recordings; 1 is about 340 s"
    )
    parser.add_argument(
        "--limits",
        nargs="*",
        metavar="EFFECT",
        choices=LIMITED,
        help="detection limits, of all effects or these",
    )
    parser.add_argument(
        "--only", type=_world_name, metavar="NAME", help="one world, or one class of the own worlds"
    )
    parser.add_argument("--count", type=positive, help="only so many of each kind, drawn at random")
    parser.add_argument(
        "--save", type=output_directory, metavar="DIR", help="write the worlds instead of diagnosing them"
    )
    parser.add_argument(
        "-o", "--output", type=output_directory, metavar="DIR", help="where to write a report"
    )
    parser.add_argument(
        "--without", choices=[rule.name for rule in RULES], nargs="*", default=[], metavar="RULE",
        help="rules that are not asked: what changes says which worlds need them",
    )  # fmt: skip
    parser.add_argument(
        "--jobs", type=positive, default=min(2, cores()), help="processes (default at most 2)"
    )


def _world_name(word: str) -> str:
    """A name of a world of any kind, or a class of the own ones, as the `type` of an argument."""
    known = [*CLASSES, *(name for kind in KINDS.values() for name in kind.names())]
    if word in known or re.fullmatch(rf"({'|'.join(CLASSES)})-\d+", word):
        return word
    raise argparse.ArgumentTypeError(f"no world {word!r}, {nearest(word, known)}")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """All worlds of the kinds asked for, or the limits."""
    kinds = DRAWN if arguments.worlds == ALL else [arguments.worlds]
    with ProcessPoolExecutor(arguments.jobs, multiprocessing.get_context("spawn")) as pool, ended_with_this():
        if arguments.limits is not None and arguments.only is None:
            tasks = [(name, arguments.seed, arguments.stretch) for name in arguments.limits or LIMITED]
            return limit_rows(list(_watched(begun(pool, limits_of, tasks))))
        found: list[dict[str, Any]] = []
        judged: list[Judged] = []
        for kind in kinds:
            work = _work(kind, arguments)
            if arguments.save is not None:
                written = sum(_watched(begun(pool, partial(save_world, folder=arguments.save), work)))
                found.append(row(f"{kind} worlds written to {arguments.save}", float(written)))
                continue
            results = list(_watched(begun(pool, partial(solve, without=tuple(arguments.without)), work)))
            outcomes = [result for result in results if isinstance(result, Outcome)]
            of_kind = [result.judged if isinstance(result, Outcome) else result for result in results]
            found += (rows(outcomes) if outcomes else []) + (summary(kind, of_kind) if of_kind else [])
            judged += of_kind
    if not judged:
        return found
    found += reliability_rows(judged)
    if arguments.output is not None:
        print(write_report(arguments.output, judged, found), file=sys.stderr)
    return found


def _work(kind: str, arguments: argparse.Namespace) -> list[Case | Task]:
    """The worlds of one kind that are asked for. InputError when there is none, where one kind is asked for."""
    work: list[Case | Task] = []
    if kind == OWN:
        work += draw_cases(arguments.seed, arguments.each, arguments.stretch, arguments.only)
    else:
        work += tasks_of(kind, arguments.seed, arguments.only)
    if not work and arguments.worlds == kind:
        raise InputError(
            "--only", f"no world {arguments.only!r} among the {kind} ones", f"--worlds {ALL} or its kind"
        )
    if arguments.count is None or arguments.count >= len(work):
        return work
    kept = np.random.default_rng(arguments.seed).choice(len(work), arguments.count, replace=False)
    return [work[i] for i in sorted(kept)]


def _watched(results_and_count: tuple[Iterator[Any], int]) -> Iterable[Any]:
    results, count = results_and_count
    for done, result in enumerate(results, 1):
        if sys.stderr.isatty():
            print(f"\r{done}/{count}", end="\n" if done == count else "", file=sys.stderr, flush=True)
        yield result


def save_world(work: Case | Task, folder: Path) -> int:
    """Write one world for `./tcs diagnose`; the number of worlds written."""
    if isinstance(work, Task):
        save(work, folder)
        return 1
    save_trial(own_trial(work), folder / OWN / work.name)
    return 1


def solve(work: Case | Task, without: tuple[str, ...] = ()) -> Outcome | Judged:
    """Make and diagnose one world `without` some rules; an own one with the baselines beside the tool."""
    with rules_without(without):
        return solve_task(work) if isinstance(work, Task) else _solve_own(work)


def _solve_own(work: Case) -> Outcome:
    world = world_of(work)
    begin = time.perf_counter()
    found = diagnose([world.recording], world.believed).to_mapping()
    judged = judge(work.name, OWN, expected_of(world), found, time.perf_counter() - begin)
    others = baselines(world.recording, world.believed, world.truth.noise_floor)
    concealed = tuple(name for name in world.truth.effects if name not in OUTSIDE)
    named = {TOOL: tuple(entry["effect"] for entry in found["effects"]), **others}
    inside = not judged.expected.outside
    right = {name: set(effects) == set(concealed) and inside for name, effects in others.items()}
    right[TOOL] = judged.right
    floor = float(found["fit"]["noise_floor"])
    held_out = float(found["fit"]["improved"]["held_out"]) / floor
    errors = parameter_errors(world, found["effects"])
    return Outcome(
        work.kind, world.truth.effects, named, right, judged.verdict, judged.seconds, held_out, judged, errors
    )


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
