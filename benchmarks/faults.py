"""Real time under faults: processes killed, stopped, restarted; clocks stepped; messages garbled, doubled, swapped, lost.

Every node is a real process. The loop's five drive the simulated telescope along a sinusoid; beside them run identifier,
diagnoser and commission, a recorder, a player, and a dynamometer on a simulated gauge. One fault after the other is injected,
each into a graph that is well and running.

Checked all the time: the axis' true speed, the torque that acts and the steps of the reference stay within their limits.
Checked of every fault: no other process ends of it, /diagnostics names it, afterwards all nodes are well and the loop begins its
programme when told to; what a recorder wrote before it was killed can be read. Checked in the end: each node of the loop has
refused what was sent to it garbled beyond doubt. What fails a check is named as soon as it is found, and the benchmark ends
with status 1.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import time
from typing import Any

from benchmarks.faulty_companions import LISTENERS, companions
from benchmarks.faulty_nodes import Loop
from benchmarks.faulty_watch import SILENT, Watch
from tcs_friction.errors import JobError
from tcs_friction.nodes.graph import LOOP

WELL_WITHIN = 60.0  # s, processes started anew included
RUNNING_WITHIN = 30.0  # s, the way to the programme included
NAMED_WITHIN = 10.0  # s; reports come every second
STOPS = (1.5, 3.0)  # s, longer than the age limit
SILENT_STOPS = (3.0, 4.0)  # s, of a node that only its own reports are missed of
REFUSED_SHARE = 0.7
"""Of what is garbled beyond doubt: some of it comes while a node is away, and one that is killed takes its last count along."""
NAMES = {  # what a report says when this process is away
    "plant": "joint_states",
    "reference": "reference",
    "lugre_compensator": "friction_compensation",
    "dob": "friction_estimate",
    "controller": "torque_command",
}
KINDS = ("kill", "stop", "clock")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--minutes", type=_minutes, default=2.0, help="of faults (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the faults (default %(default)s)")


def _minutes(word: str) -> float:
    value = float(word)
    if not 0.0 < value < 1e5:
        raise argparse.ArgumentTypeError(f"{word}, expected a positive number of minutes")
    return value


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Inject faults for the time given; raises JobError naming what went wrong."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    chance = random.Random(arguments.seed)
    nodes = (*LOOP, *companions())
    loop = Loop(arguments.seed)
    watch = Watch()
    counts, faults = dict.fromkeys(KINDS, 0), dict.fromkeys(nodes, 0)
    failures: list[str] = []
    try:
        for name in nodes:
            loop.start(name)
        failures += _told(_resume(loop, watch, "the start"))
        began = time.monotonic()
        while time.monotonic() - began < 60.0 * arguments.minutes:
            kind = min(counts, key=lambda name: (counts[name], chance.random()))  # each of them about as often
            name = "plant" if kind == "clock" else _next(chance, faults, nodes)
            faults[name] += kind != "clock"
            counts[kind] += 1
            missed = _inject(kind, name, chance, loop, watch)
            failures += _told(missed + _resume(loop, watch, f"{kind} of {name} (number {counts[kind]})"))
    finally:
        loop.end()
        watch.close()
    failures = watch.excesses() + failures + _unrefused(watch)  # the worst first
    if failures:
        raise JobError("faults", f"{len(failures)} checks failed: {'; '.join(failures[:5])}")
    return _results(counts, faults, watch)


def _next(chance: random.Random, faults: dict[str, int], nodes: tuple[str, ...]) -> str:
    """The loop's nodes and those beside it in turn, each of either about as often."""
    beside = tuple(name for name in nodes if name not in LOOP)
    turn = LOOP if sum(faults[name] for name in LOOP) <= sum(faults[name] for name in beside) else beside
    return min(turn, key=lambda name: (faults[name], chance.random()))


def _unrefused(watch: Watch) -> list[str]:
    return [
        f"{name} refused {refused} inputs although {garbled} were garbled beyond doubt"
        for name, refused, garbled in watch.refusals()
        if refused < REFUSED_SHARE * garbled
    ]


def _told(failures: list[str]) -> list[str]:
    for failure in failures:
        print(f"faults, {time.strftime('%H:%M:%S')}: {failure}", file=sys.stderr, flush=True)
    return failures


def _inject(kind: str, name: str, chance: random.Random, loop: Loop, watch: Watch) -> list[str]:
    """One fault in a running loop; what /diagnostics did not say about it, and which nodes have ended before it."""
    time.sleep(chance.uniform(0.5, 2.0))
    died = loop.revive()
    watch.forget(f"{kind} of {name}")
    if name not in LOOP:
        return died + _beside(kind, name, chance, loop, watch)
    if kind == "kill":
        loop.kill(name)
        named = watch.until_named(NAMES[name], NAMED_WITHIN)
        loop.start(name)
    elif kind == "stop":
        span = chance.uniform(*STOPS)
        loop.signal(name, signal.SIGSTOP)
        time.sleep(span)
        loop.signal(name, signal.SIGCONT)
        named = watch.until_named(NAMES[name], NAMED_WITHIN)
    else:
        loop.signal(name, chance.choice((signal.SIGUSR1, signal.SIGUSR2)))
        named = watch.until_named("stamp", NAMED_WITHIN)
    return died if named else [*died, f"{kind} of {name} is not in /diagnostics"]


def _beside(kind: str, name: str, chance: random.Random, loop: Loop, watch: Watch) -> list[str]:
    """A fault of a node beside the loop; what went wrong with it."""
    wrong: list[str] = []
    watch.until_well([name], NAMED_WITHIN)  # its next report, after which it falls silent
    loop.signal(name, signal.SIGKILL if kind == "kill" else signal.SIGSTOP)
    if not watch.until_silent(name, NAMED_WITHIN):
        wrong.append(f"{kind} of {name}: it goes on to report")
    if kind == "stop":
        time.sleep(chance.uniform(*SILENT_STOPS) - SILENT)
        loop.signal(name, signal.SIGCONT)
        if name in LISTENERS and not watch.until_named("joint_states", NAMED_WITHIN):
            wrong.append(f"stop of {name} is not in /diagnostics")
    else:
        recordings = loop.surroundings.recordings
        if name == "recorder" and not loop.surroundings.recorded(recordings[-1]):
            wrong.append("kill of recorder: nothing can be read of its bag")
        loop.kill(name)
        loop.start(name)
    return wrong


def _resume(loop: Loop, watch: Watch, after: str) -> list[str]:
    """Wait until the loop is well, then begin the programme; what of that did not happen, and which nodes have ended."""
    wrong = loop.revive()
    if not watch.until_well((*LOOP, *companions()), WELL_WITHIN):
        wrong += [f"not well within {WELL_WITHIN:g} s after {after}: {watch.complaints()}"]
    elif not watch.until_running(RUNNING_WITHIN):
        wrong += [f"the programme did not begin within {RUNNING_WITHIN:g} s after {after}: {watch.complaints()}"]
    return wrong + loop.revive()


def _results(counts: dict[str, int], faults: dict[str, int], watch: Watch) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = [
        {"name": name, "value": count, "unit": "", "beside": None, "ratio": None}
        for name, count in (
            *((f"faults: {kind}", count) for kind, count in counts.items()),
            *((f"killed or stopped: {name}", count) for name, count in faults.items()),
        )
    ]
    for name, value, limit, unit in watch.extremes():
        entries.append({"name": name, "value": value, "unit": unit, "beside": limit, "ratio": value / limit})
    for name, refused, garbled in watch.refusals():
        title = f"inputs refused by {name}, beside those garbled beyond doubt"
        ratio = refused / garbled if garbled else None
        entries.append({"name": title, "value": refused, "unit": "", "beside": garbled, "ratio": ratio})
    return entries
