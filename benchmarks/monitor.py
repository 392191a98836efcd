"""The watch of the node `monitor`: false alarms of an axis that does not change, how soon changes are told, and a tick's cost.

An axis of the shipped size, simulated at its 1 kHz under the shipped controller, moves at random for hours: every ten minutes
another sum of sines, while its temperature goes through the day. Two watches follow it: one with the exact model, and one whose
model has every number 2 % off and lacks the cogging. Changes come after the learning period, at twice the limit of detection:
the size at which a matched filter that knows the shape has five standard deviations in the first 60 s. Beside the time until a
change is told stands that of an oracle which knows shape and size and has the same bound on false alarms.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.monitor_worlds import (
    CHANGES,
    PERIOD,
    SEGMENT,
    Array,
    Change,
    Follower,
    World,
    limit_of,
    model_off,
    noise_density,
    world,
)
from tcs_friction.commands.parser import positive
from tcs_friction.monitor.baseline import Baseline
from tcs_friction.monitor.evidence import fresh, judge_all
from tcs_friction.monitor.finding import Finding, finding
from tcs_friction.monitor.residual import BLOCK
from tcs_friction.monitor.watch import Watch, WatchConfig

TIMES_LIMIT = 2.0
TENTH = 0.1  # of the Coulomb friction
BAR = 120.0  # s within which changes are to be told
NEVER = SEGMENT  # s: not told in the segment in which it came
TICKS = 100_000  # whose cost is measured
TICK_BAR = 20.0  # us
ALARM_BAR = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--hours", type=_hours, default=24.0, help="of the unchanged axis, after the learning period")
    parser.add_argument("--seed", type=int, default=0, help="of motions and noise")
    parser.add_argument("--changes", type=positive, default=5, help="trials of each change")


def _hours(word: str) -> float:
    value = float(word)
    if not 0.0 < value < 1e4:
        raise argparse.ArgumentTypeError(f"{word} is no number of hours from 0 to 10000")
    return value


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    axis = world(arguments.seed)
    models = {"exact model": Follower(axis.axis), "2 % off, no cogging": Follower(model_off(axis.axis))}
    known, first = learned(axis, models)
    found = tick_rows(axis)
    for name, model in models.items():
        for change in CHANGES:
            found += change_rows(axis, name, model, known[name], change, first, arguments.changes)
    return found + unchanged_rows(axis, models, known, first, arguments.hours)


def learned(axis: World, models: Mapping[str, Follower]) -> tuple[dict[str, Baseline], int]:
    """What each model shows in the learning period, and the number of the segment after it."""
    watches = {name: Watch(model.axis, PERIOD) for name, model in models.items()}
    number = 0
    while not all(watch.has_seen_enough for watch in watches.values()):
        heard, temperature = axis.run(number, number * SEGMENT)
        for name, model in models.items():
            for row in model.blocks(heard, temperature):
                watches[name].block(row)
        number += 1
    return {name: watch.learned() for name, watch in watches.items()}, number


def unchanged_rows(
    axis: World, models: Mapping[str, Follower], known: Mapping[str, Baseline], first: int, hours: float
) -> list[dict[str, Any]]:
    """Hours of the unchanged axis: alarms, and the highest evidence."""
    limit = WatchConfig().limit
    evidence = {name: fresh(base) for name, base in known.items()}
    highest = {name: np.full(1, -math.inf) for name in models}
    alarms = dict.fromkeys(models, 0)
    for number in range(first, first + math.ceil(hours * 3600.0 / SEGMENT)):
        heard, temperature = axis.run(number, number * SEGMENT)
        for name, model in models.items():
            rows = model.blocks(heard, temperature)
            while (at := judge_all(known[name], evidence[name], rows, limit, highest[name])) >= 0:
                alarms[name] += 1
                evidence[name], rows = fresh(known[name]), rows[at + 1 :]
    rows_of: list[dict[str, Any]] = []
    for name in models:
        share = (float(highest[name][0]) - limit) / math.log(10.0)
        rows_of += [
            _row(f"false alarms in {hours:g} h at 1 kHz, {name}; beside the bar", alarms[name], "1", ALARM_BAR),
            _row(f"  highest evidence, log10 of an alarm's, {name}", share, "1"),
        ]
    return rows_of


def change_rows(
    axis: World, name: str, model: Follower, base: Baseline, change: Change, first: int, trials: int
) -> list[dict[str, Any]]:
    """Median and longest time until a change is told, beside an oracle's."""
    told, oracle = [], []
    for trial in range(trials):
        number = 1000 + trial
        begin = first * SEGMENT
        rng = np.random.default_rng((axis.seed, number, 1))
        plain, _ = axis.run(number, begin)
        values = change.draw(rng, plain)
        torque = change.torque(axis.axis, plain, values)
        size = TIMES_LIMIT * limit_of(axis.axis, torque)
        heard, temperature = axis.run(number, begin, change.apply(axis.axis, size, values))
        seconds, _ = time_to_tell(base, model, model.blocks(heard, temperature))
        told.append(seconds)
        oracle.append(oracle_time(size * torque, noise_density(axis.axis)))
    what = f"{change.name}, twice the limit, told after; {name}; beside an oracle"
    return [
        _row(what, float(np.median(told)), "s", float(np.median(oracle))),
        _row(f"  the longest of {trials}; beside the bar", max(told), "s", BAR),
    ]


def time_to_tell(base: Baseline, model: Follower, rows: Array) -> tuple[float, Finding | None]:
    """Seconds until the blocks (n, COLUMNS) raise an alarm, and what it says; NEVER and None without one."""
    evidence = fresh(base)
    at = judge_all(base, evidence, rows, WatchConfig().limit, np.full(1, -math.inf))
    return (NEVER, None) if at < 0 else ((at + 1) * BLOCK, finding(base, evidence, model.axis))


def oracle_time(torque: Array, density: float) -> float:
    """Seconds until a test that knows the torque (n,), N m, has the evidence of an alarm: half its squared deviations."""
    logs = 0.5 * np.cumsum(torque**2) * PERIOD / density
    return float(np.searchsorted(logs, WatchConfig().limit) * PERIOD)


def tick_rows(axis: World) -> list[dict[str, Any]]:
    """Mean cost of a tick, learned and judging."""
    heard, _ = axis.run(0, 0.0)
    watch = Watch(axis.axis, PERIOD, WatchConfig(learning_time=60.0))
    position, torque = heard.position.tolist(), heard.torque.tolist()
    at = 0
    while not watch.has_seen_enough:
        watch.tick(PERIOD, position[at], torque[at])
        at += 1
    watch.adopt(watch.learned())
    spent = []
    for q, u in zip(position[at : at + TICKS], torque[at : at + TICKS], strict=True):
        began = time.perf_counter()
        watch.tick(PERIOD, q, u)
        spent.append(time.perf_counter() - began)
    spent = spent[len(spent) // 10 :]  # after the first ones, which load what is compiled
    return [
        _row("a tick of a watch; beside the bar", 1e6 * float(np.mean(spent)), "us", TICK_BAR),
        _row("  99.9 % are shorter than", 1e6 * float(np.quantile(spent, 0.999)), "us"),
    ]


def _row(name: str, value: float, unit: str, beside: float | None = None) -> dict[str, Any]:
    ratio = value / beside if beside else None
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": ratio}
