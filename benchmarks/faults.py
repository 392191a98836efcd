"""Real time under faults: processes killed, stopped and restarted at random, clocks stepped, messages garbled and doubled.

The loop runs as five real processes on the simulated telescope and follows a sinusoid. One fault after the other is injected,
each into a loop that was well and running. Checked all the time: the axis' true speed and the torque that acts stay within
the controller's limits. Checked of every fault: no other process ends of it, /diagnostics names it, and afterwards the loop
is well again and begins its programme when told to. What fails a check is named as soon as it is found, and the benchmark
ends with status 1.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
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
        failures += _told(_resume(loop, watch, "the start"))
        began = time.monotonic()
        while time.monotonic() - began < 60.0 * arguments.minutes:
            kind = min(counts, key=lambda name: (counts[name], chance.random()))  # each of them about as often
            name = "plant" if kind == "clock" else chance.choice(LOOP)
            counts[kind] += 1
            missed = _inject(kind, name, chance, loop, watch)
            failures += _told(missed + _resume(loop, watch, f"{kind} of {name} (number {counts[kind]})"))
    finally:
        loop.end()
        watch.close()
    failures = watch.excesses() + failures  # the worst first
    if failures:
        raise JobError("faults", f"{len(failures)} checks failed: {'; '.join(failures[:5])}")
    return _results(counts, watch)


def _told(failures: list[str]) -> list[str]:
    for failure in failures:
        print(f"faults, {time.strftime('%H:%M:%S')}: {failure}", file=sys.stderr, flush=True)
    return failures


def _inject(kind: str, name: str, chance: random.Random, loop: Loop, watch: Watch) -> list[str]:
    """One fault in a running loop; what /diagnostics did not say about it, and which nodes have ended before it."""
    time.sleep(chance.uniform(0.5, 2.0))
    died = loop.revive()
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
    return died if named else [*died, f"{kind} of {name} is not in /diagnostics"]


def _resume(loop: Loop, watch: Watch, after: str) -> list[str]:
    """Wait until the loop is well, then begin the programme; what of that did not happen, and which nodes have ended."""
    wrong = loop.revive()
    if not watch.until_well(LOOP, WELL_WITHIN):
        wrong += [f"not well within {WELL_WITHIN:g} s after {after}: {watch.complaints()}"]
    elif not watch.until_running(RUNNING_WITHIN):
        wrong += [f"the programme did not begin within {RUNNING_WITHIN:g} s after {after}: {watch.complaints()}"]
    return wrong + loop.revive()


def _results(counts: dict[str, int], watch: Watch) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = [
        {"name": f"faults: {kind}", "value": count, "unit": "", "beside": None, "ratio": None}
        for kind, count in counts.items()
    ]
    for name, value, limit, unit in watch.extremes():
        entries.append({"name": name, "value": value, "unit": unit, "beside": limit, "ratio": value / limit})
    entries.append({"name": "inputs refused", "value": watch.refused(), "unit": "", "beside": None, "ratio": None})
    return entries
