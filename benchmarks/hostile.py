"""Files drawn to hurt: bags, tables, axis and reference files, results; plug-ins, requests and command lines; killed runs.

They are damaged, or made to claim, unpack to or ask for much more than they are. Every reading has to end with a recording, an
axis or one line; none may take more than 10 s of processor time or 1 GB. What fails is kept and named.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks import (
    hostile_bags,
    hostile_others,
    hostile_results,
    hostile_tables,
    hostile_writing,
    hostile_yaml,
)
from benchmarks.children import deaf, ended_with_this
from tcs_friction.config import load_axis
from tcs_friction.control.reference import load_reference
from tcs_friction.errors import JobError, TcsError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.tables import import_table

SLOW = 10.0  # s of processor time
LARGE = 1 << 30  # bytes
HANGS = 300.0  # s of wall time without an answer, on a machine that may be busy
SIGNALS = SignalMap(
    SignalSource(hostile_bags.TOPIC, "position", "azimuth"), SignalSource(hostile_bags.TOPIC, "effort", "azimuth")
)
KINDS: dict[str, dict[hostile_bags.Maker, tuple[int, int]]] = {
    **hostile_bags.CASES,
    "tables": hostile_tables.CASES,
    "axis files": hostile_yaml.CASES,
    "results": hostile_results.RESULTS,
    "motions": hostile_results.MOTIONS,
    "plug-ins": hostile_others.PLUG_INS,
    "requests": hostile_others.REQUESTS,
    "command lines": hostile_others.COMMAND_LINES,
    "writing": hostile_writing.WRITING,
}

WHOLE = ("motions", "plug-ins", "requests", "command lines", "writing")
"""Kinds that damage would only turn into others."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's options."""
    parser.add_argument("--count", type=int, default=1000, help="files of each kind (default 1000)")
    parser.add_argument("--seed", type=int, default=0, help="another seed draws others (default 0)")
    parser.add_argument("--kind", choices=list(KINDS), help="only this kind")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Slowest and largest reading of each kind. Raises JobError if one failed."""
    results: list[dict[str, Any]] = []
    failures: list[str] = []
    for kind in [arguments.kind] if arguments.kind else KINDS:
        seconds, memory, failed = tried(kind, arguments.count, arguments.seed)
        failures += failed
        results += [
            {"name": f"{kind}: slowest of {arguments.count}", "value": seconds, "unit": "s", "beside": SLOW},
            {"name": f"{kind}: most memory", "value": memory / 2**20, "unit": "MB", "beside": LARGE / 2**20},
        ]
    if failures:
        raise JobError("bench hostile", f"{len(failures)} failures, the first: {failures[0]}", "none")
    return results


def tried(kind: str, count: int, seed: int) -> tuple[float, int, list[str]]:
    """Read `count` files of a kind in a process of their own: most seconds, most bytes, what failed and is kept."""
    folder = Path(tempfile.mkdtemp(prefix="hostile-"))
    failed: list[str] = []
    try:
        seconds, memory, failed = _read(kind, count, seed, folder)
    finally:
        if not failed:
            shutil.rmtree(folder)
    return seconds, memory, failed


def _read(kind: str, count: int, seed: int, folder: Path) -> tuple[float, int, list[str]]:
    context = multiprocessing.get_context("spawn")
    seconds, memory, number = 0.0, 0, 0
    failed: list[str] = []
    while number < count:
        mine, theirs = context.Pipe()
        worker = context.Process(target=_work, args=(theirs, kind, number, count, seed, folder), daemon=True)
        with deaf():
            worker.start()
        theirs.close()
        with suppress(EOFError), ended_with_this():
            while number < count and mine.poll(HANGS):
                took, grew, problem = mine.recv()
                seconds, memory = max(seconds, took), max(memory, grew)
                failed += [f"{kind} {number}: {problem}"] if problem else []
                number += 1
        worker.kill()
        worker.join()
        if number < count:
            failed.append(f"{kind} {number}: no answer (kept in {folder})")
            number += 1
    return seconds, memory, failed


def _work(answers: Connection, kind: str, first: int, count: int, seed: int, folder: Path) -> None:
    for number in range(first, count):
        path = drawn(kind, random.Random(f"{kind} {seed} {number}"), folder / f"{number}")
        took, grew, problem = _measured(reading(kind, path))
        if problem:
            problem += f" (kept: {path})"
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
        answers.send((took, grew, problem))


def drawn(kind: str, chance: random.Random, path: Path) -> Path:
    """A file of a kind, its size even on a logarithmic scale; half of them damaged on top."""
    make, (low, high) = chance.choice(list(KINDS[kind].items()))
    made = make(path, round(low * (high / low) ** chance.random()) if low else chance.randint(low, high))
    if kind in WHOLE:
        return made
    for file in sorted(made.rglob("*")) if made.is_dir() else [made]:
        if file.is_file() and not file.is_symlink() and chance.random() < 0.5:
            file.write_bytes(hostile_bags.damaged(file.read_bytes(), chance))
    return made


def reading(kind: str, path: Path) -> list[Callable[[], object]]:
    """What commands do with such a file."""
    return READINGS[kind](path) if kind in READINGS else [lambda: bag_info(path), lambda: read_recordings([path], SIGNALS)]


READINGS: dict[str, Callable[[Path], list[Callable[[], object]]]] = {
    "tables": lambda path: [lambda: import_table(path, "axis", {})],
    "axis files": lambda path: [lambda: load_axis(path), lambda: load_reference(path)],
    "results": hostile_results.reading_results,
    "motions": hostile_results.reading_motions,
    "plug-ins": hostile_others.reading_plug_in,
    "requests": hostile_others.reading_request,
    "command lines": hostile_others.reading_words,
    "writing": hostile_writing.reading_writing,
}


def _measured(works: list[Callable[[], object]]) -> tuple[float, int, str]:
    """Processor time of the longest, memory it grew by at most, and what was wrong."""
    longest, most, problem = 0.0, 0, ""
    for work in works:
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
        before, begin = _memory("VmRSS"), time.process_time()
        try:
            work()
        except TcsError as error:
            if "\n" in str(error) or not str(error).isprintable():
                problem = f"not one printable line: {str(error)!r}"
        except Exception:
            problem = traceback.format_exc()[-500:]
        longest = max(longest, time.process_time() - begin)
        most = max(most, _memory("VmHWM") - before)
    if longest > SLOW or most > LARGE:
        problem = problem or f"took {longest:.1f} s, {most >> 20} MB"
    return longest, most, problem


def _memory(name: str) -> int:
    """A line of the process' status, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(name)), 0)
