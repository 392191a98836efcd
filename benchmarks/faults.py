"""Real time under faults: processes killed, stopped and restarted at random, clocks stepped, messages garbled and doubled.

The loop runs as five real processes on the simulated telescope and follows a sinusoid. One fault after the other is injected,
each into a loop that was well and running. Checked all the time: the axis' true speed and the torque that acts stay within
the controller's limits. Checked of every fault: /diagnostics names it, and afterwards the loop is well again and begins its
programme when told to. What fails a check is named, and the benchmark ends with status 1.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import time
from typing import Any

from benchmarks.faulty_nodes import LOOP, Loop
from benchmarks.faulty_watch import Watch
from tcs_friction.errors import JobError

WELL_WITHIN = 60.0  # s, processes started anew included
RUNNING_WITHIN = 30.0  # s, the way to the programme included
NAMED_WITHIN = 10.0  # s; reports come every second
STOPS = (1.5, 3.0)  # s, longer than the age limit
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
    loop = Loop(arguments.seed)
    watch = Watch()
    counts = dict.fromkeys(KINDS, 0)
    failures: list[str] = []
    try:
        for name in LOOP:
            loop.start(name)
        _resume(watch, "the start")
        began = time.monotonic()
        while time.monotonic() - began < 60.0 * arguments.minutes:
            kind = min(counts, key=lambda name: (counts[name], chance.random()))  # each of them about as often
            failures += _inject(kind, chance, loop, watch)
            counts[kind] += 1
            failures += _resume(watch, f"{kind} number {counts[kind]}")
    finally:
        loop.end()
        watch.close()
    failures += watch.excesses()
    if failures:
        raise JobError("faults", f"{len(failures)} checks failed: {'; '.join(failures[:5])}")
    return _results(counts, watch)


def _inject(kind: str, chance: random.Random, loop: Loop, watch: Watch) -> list[str]:
    """One fault in a running loop; what /diagnostics did not say about it."""
    time.sleep(chance.uniform(0.5, 2.0))
    name = "plant" if kind == "clock" else chance.choice(LOOP)
    watch.forget(f"{kind} of {name}")
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
    return [] if named else [f"{kind} of {name} is not in /diagnostics"]


def _resume(watch: Watch, after: str) -> list[str]:
    """Wait until the loop is well, then begin the programme; what of that did not happen."""
    if not watch.until_well(LOOP, WELL_WITHIN):
        return [f"not well within {WELL_WITHIN:g} s after {after}: {watch.complaints()}"]
    if not watch.until_running(RUNNING_WITHIN):
        return [f"the programme did not begin within {RUNNING_WITHIN:g} s after {after}: {watch.complaints()}"]
    return []


def _results(counts: dict[str, int], watch: Watch) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = [
        {"name": f"faults: {kind}", "value": count, "unit": "", "beside": None, "ratio": None}
        for kind, count in counts.items()
    ]
    for name, value, limit, unit in watch.extremes():
        entries.append({"name": name, "value": value, "unit": unit, "beside": limit, "ratio": value / limit})
    entries.append({"name": "inputs refused", "value": watch.refused(), "unit": "", "beside": None, "ratio": None})
    return entries
