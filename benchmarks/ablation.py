"""What each rule of the diagnosis is needed for: worlds as they are, then without each rule that decided in them.

    ./tcs bench ablation -o DIR --minutes 60
    ./tcs bench ablation -o DIR --minutes 0 --table docs/diagnosis.md

Worlds of all kinds are drawn in turn, recorded ones once. The result of each is a file of its own in DIR, and a
world that has one is not made again: the command goes on where it was ended. A rule that is asked of finished fits is left out of
the conclusions alone, and only where it is the only one to refuse some name; one of the search where the ledger says that it
decided something. Where no rule decided, nothing could change.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ablation_table import Effect, table_rows, with_table
from benchmarks.concealed_cases import Case, draw_cases, own_trial
from benchmarks.concealed_kinds import DRAWN, KINDS, OWN, Task, tasks_of
from benchmarks.concealed_report import row
from benchmarks.concealed_score import Judged, judge
from benchmarks.trials import Trial
from tcs_friction.commands.parser import positive
from tcs_friction.config import write_whole
from tcs_friction.diagnose.outcome.conclusion import conclude
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose, explain
from tcs_friction.diagnose.rules import OF_SEARCH, RULES, ledger, without
from tcs_friction.errors import TcsError
from tcs_friction.writable import output_directory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    kinds = [OWN, *KINDS]
    parser.add_argument("--seed", type=int, default=0, help="of the first worlds (default 0)")
    parser.add_argument("--kinds", nargs="*", choices=kinds, default=["real", *DRAWN], help="kinds of worlds")
    parser.add_argument("--stretch", type=float, default=1.0, help="length of the own worlds' recordings; 1 is about 340 s")
    parser.add_argument("--minutes", type=float, default=60.0, help="after which no further world is begun (default 60)")
    parser.add_argument("--count", type=positive, help="worlds after which none is begun, those with a result among them")
    parser.add_argument("-o", "--output", type=output_directory, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--table", type=Path, metavar="FILE", help="text in which the table is renewed, between its two marks")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Worlds until the time is over, then what all results in the folder say of each rule."""
    end = time.monotonic() + 60.0 * arguments.minutes
    for done, (kind, seed, work) in enumerate(_worlds(arguments.kinds, arguments.seed, arguments.stretch)):
        if time.monotonic() >= end or (arguments.count is not None and done >= arguments.count):
            break
        place = arguments.output / kind / f"{work.name}-{seed}.json"
        if not place.exists():
            write_whole(place, json.dumps(ablated(work, kind)) + "\n")
            print(f"{done + 1}: {kind} {work.name} {seed}", file=sys.stderr, flush=True)
    results = [json.loads(path.read_text()) for path in sorted(arguments.output.glob("*/*.json"))]
    if arguments.table is not None:
        write_whole(arguments.table, with_table(arguments.table.read_text(), results))
    found = [row("worlds", float(len(results)))]
    for rule, entries in table_rows(results):
        found += [row(f"{rule.name}: {what}", float(len(worlds))) for what, worlds in entries.items() if worlds]
    return found


def _worlds(kinds: Sequence[str], seed: int, stretch: float) -> Iterator[tuple[str, int, Case | Task]]:
    """Kind, seed and world, one of each kind in turn; recorded worlds once each."""
    turns = [_of_kind(kind, seed, stretch) for kind in kinds]
    while turns:
        for turn in list(turns):
            world = next(turn, None)
            if world is None:
                turns.remove(turn)
            else:
                yield world


def _of_kind(kind: str, seed: int, stretch: float) -> Iterator[tuple[str, int, Case | Task]]:
    """All worlds of a kind and a seed in random order, then those of the next."""
    recorded = kind in KINDS and KINDS[kind].recorded is not None
    for number in [0] if recorded else itertools.count(seed):
        works = draw_cases(number, 1, stretch) if kind == OWN else tasks_of(kind, number, None)
        for k in np.random.default_rng([number, len(works)]).permutation(len(works)):
            yield kind, number, works[k]


def ablated(work: Case | Task, kind: str) -> dict[str, Any]:
    """A world's result: what is said with all rules, and of each rule that decided what its absence does."""
    trial = KINDS[work.kind].world(work.name, work.seed) if isinstance(work, Task) else own_trial(work)
    begin = time.process_time()
    result: dict[str, Any] = {"world": trial.name, "kind": kind, "effects": {}}
    try:
        with ledger() as decided:
            balance, explanation = explain([trial.recording], trial.believed)
        found = conclude(balance, trial.believed, explanation)
        judged = _judged(trial, kind, found)
        effects = {}
        for rule in RULES:
            if rule in OF_SEARCH and rule.name in decided:
                with without([rule.name]):
                    other = diagnose([trial.recording], trial.believed)
            elif rule not in OF_SEARCH and any({x.rule for x in one.refused} == {rule} for one in found.described):
                with without([rule.name]):
                    other = conclude(balance, trial.believed, explanation)
            else:
                continue
            effects[rule.name] = Effect.between(judged, _judged(trial, kind, other)).to_mapping()
        result |= {"said": said(judged), "right": judged.right, "effects": effects}
    except TcsError as error:
        result |= {"said": f"error: {error}", "right": False}
    return result | {"seconds": round(time.process_time() - begin, 1)}


def said(judged: Judged) -> str:
    """Verdict and names in a line."""
    return " ".join([judged.verdict, *(f"{n.effect}{'' if n.true else '(false)'}:{n.probability:.2f}" for n in judged.names)])


def _judged(trial: Trial, kind: str, found: Diagnosis) -> Judged:
    return judge(trial.name, kind, trial.expected, found.to_mapping(), 0.0)
