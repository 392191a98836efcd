"""A fleet of simulated bags through `./tcs fleet`: two workers beside one, the engine beside the work, memory, the same rows.

`--bags` recordings of four axes over a simulated year (benchmarks/fleet_bags.py) go through two workers. The first `--compare` of
them go through one and through two workers before, each time with compiled code and packages loaded.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.fleet_bags import write_fleet
from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError

SETTLED = 10
"""Pieces of a process after which its memory is taken as settled: 20 bags on two workers."""

CHANGES = "benchmarks.fleet_changes"
"""Says what the trends make of the planted changes: `score(out, truth)`."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--bags", type=positive, default=200, help="recordings in all (default %(default)s)")
    parser.add_argument("--compare", type=positive, default=40, help="of them for one worker beside two (default %(default)s)")
    parser.add_argument("--no-diagnose", action="store_true", help="identification only")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="DIR", help="where bags and results stay")


@dataclass(frozen=True)
class Run:
    """A run: s that it took, that its processes computed, and that processors were busy with it; its rows.

    memory: of each process after each piece, bytes.
    """

    wall: float
    seconds: float
    busy: float
    pieces: int
    failed: int
    memory: tuple[tuple[int, ...], ...]
    rows: tuple[str, ...]


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Throughput, overhead, memory, equality, and what the trends find of the planted changes."""
    with nullcontext(str(arguments.keep)) if arguments.keep else tempfile.TemporaryDirectory() as folder:
        fleet, out = Path(folder, "fleet"), Path(folder, "out")
        shutil.rmtree(fleet, ignore_errors=True)
        truth = write_fleet(fleet, arguments.bags, arguments.seed)
        bags = [str(path) for path in sorted(fleet.glob("bags/*/*"), key=lambda path: path.name)]
        some = bags[: arguments.compare]
        diagnosed = not arguments.no_diagnose
        _run(some[:4], fleet, Path(folder, "warm"), 2, diagnosed)
        one = _run(some, fleet, Path(folder, "one"), 1, diagnosed)
        _say(f"one worker: {one.wall:.0f} s for {len(some)} bags")
        two = _run(some, fleet, Path(folder, "two"), 2, diagnosed)
        _say(f"two workers: {two.wall:.0f} s")
        entire = two
        if len(bags) > len(some):
            entire = _run(bags, fleet, out, 2, diagnosed)
        kept = Path(folder, "two") if entire is two else out
        return [*_speed(one, two), *_memory(entire), *_all(entire), *_changes(kept, truth)]


def _say(text: str) -> None:
    if sys.stderr.isatty():
        print(text, file=sys.stderr)


def _run(bags: Sequence[str], fleet: Path, out: Path, workers: int, diagnosed: bool) -> Run:
    from tcs_friction.fleet import engine
    from tcs_friction.fleet.axes import read_axes
    from tcs_friction.fleet.cluster import workers_here
    from tcs_friction.fleet.plan import Plan
    from tcs_friction.fleet.sources import find
    from tcs_friction.fleet.store import Store

    shutil.rmtree(out, ignore_errors=True)
    axes = tuple(axis for axis in read_axes(fleet / "AXES.yaml") if any(f"/{axis.name}/" in bag for bag in bags))
    plan = Plan(axes, "AXES.yaml", diagnosed=diagnosed)
    with workers_here(workers) as client:
        client.run(_load)
        began = time.perf_counter()
        store = Store(str(out))
        summary = engine.run(client, find(bags), plan, store, lambda *_: None)
        wall = time.perf_counter() - began
    months = {(kept.axis, kept.month): kept for kept in store.kept()}
    rows = tuple(sorted(repr(row) for kept in months.values() for row in store.rows_beside(kept)))
    memory = tuple(tuple(values) for process, values in summary.memory.items() if process)
    return Run(wall, summary.seconds, summary.busy, summary.now, summary.failed, memory, rows)


def _load() -> None:
    """Import what the work needs, in a worker."""
    importlib.import_module("tcs_friction.fleet.work")


def _speed(one: Run, two: Run) -> list[dict[str, Any]]:
    equal = sum(a == b for a, b in zip(one.rows, two.rows, strict=True)) if len(one.rows) == len(two.rows) else 0
    return [
        {"name": f"bags an hour, two workers beside one on {one.pieces} bags (bar: 1.8)", "value": 3600 * two.pieces / two.wall,
         "unit": "1/h", "beside": 3600 * one.pieces / one.wall, "ratio": one.wall / two.wall},
        {"name": "processor time of the two workers together, beside that of one", "value": two.busy, "unit": "s",
         "beside": one.busy, "ratio": two.busy / one.busy},
        {"name": "time of one worker beside its work (bar: 1.05)", "value": one.wall, "unit": "s", "beside": one.seconds,
         "ratio": one.wall / one.seconds},
        {"name": "rows equal bit for bit with one worker and two", "value": equal, "beside": len(one.rows),
         "ratio": equal / len(one.rows)},
    ]  # fmt: skip


def _memory(entire: Run) -> list[dict[str, Any]]:
    """Medians of ten pieces each: of the second ten of a process, and of its last ten."""
    rows = []
    for number, values in enumerate(entire.memory):
        if len(values) > SETTLED:
            early = statistics.median(values[SETTLED : 2 * SETTLED]) / 2**20
            late = statistics.median(values[-SETTLED:]) / 2**20
            name = f"memory of worker {number}, last of {len(values)} bags beside bags {SETTLED + 1} to {2 * SETTLED}"
            rows.append({"name": name, "value": late, "unit": "MB", "beside": early, "ratio": late / early})
    return rows


def _all(entire: Run) -> list[dict[str, Any]]:
    return [
        {"name": f"all {entire.pieces} bags on two workers", "value": entire.wall, "unit": "s"},
        {"name": "work for a bag", "value": entire.seconds / max(1, entire.pieces), "unit": "s"},
        {"name": "bags that failed", "value": entire.failed, "unit": "1"},
    ]


def _changes(out: Path, truth: object) -> list[dict[str, Any]]:
    if importlib.util.find_spec(CHANGES) is None:
        return [{"name": "planted changes found", "value": "not measured: no " + CHANGES}]
    scored: list[dict[str, Any]] = importlib.import_module(CHANGES).score(out, truth)
    if not scored:
        raise JobError("bench fleet", "no planted change was looked at", "rows of every axis")
    return scored
