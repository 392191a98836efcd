"""Many simulated axis-years of stored results, without any bags: false changes, and planted ones found within their errors.

The results scatter as identifications of the bags of `benchmarks.fleet_bags` do: a standard deviation of each parameter that its
recording gives, a scatter between recordings beyond it, and neighbours that are alike. Temperature goes through year, night and
weather, friction follows it, one recording in twelve is a tracking that tells little and claims much. Beside our false changes
stand those of a plain test of means: Welch's, the second half of the year against the first, at the same rate of error.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import ttest_ind

from benchmarks.fleet_bags import BEGIN, YEAR, temperature_on
from tcs_friction.commands.parser import positive
from tcs_friction.trends.changes import Change
from tcs_friction.trends.fleet import FALSE_RATE, AxisTrend, axis_trend
from tcs_friction.trends.rows import AxisRows, Effect, rows_of

LEVELS = {
    # value at 10 degC, standard deviation that a recording gives, scatter between recordings beyond it, change per degC
    "coulomb": (78.0, 0.033, 0.05, -0.23, "N m"),
    "static": (119.0, 1.6, 0.8, -0.35, "N m"),
    "stribeck_velocity": (6.0e-4, 1.3e-5, 5e-6, 0.0, "rad/s"),
    "stiffness": (2.9e5, 2.6e3, 2e3, 0.0, "N m/rad"),
    "damping": (3.3e4, 125.0, 200.0, 0.0, "N m s/rad"),
    "viscous": (570.0, 2.0, 3.0, -6.8, "N m s/rad"),
    "inertia": (1000.0, 1.8, 2.0, 0.0, "kg m^2"),
    "offset": (0.0, 0.013, 0.01, 0.0, "N m"),
}
ALIKE = 0.2  # correlation of neighbours
TRACKING = 1.0 / 12.0
REFERENCE = 10.0  # degC
WITHIN = 3.0  # standard deviations that a size may be off
PLANTED: dict[str, Mapping[str, tuple[str, float]]] = {
    "lubricant": {"coulomb": ("drift", 0.14), "viscous": ("drift", 0.30)},
    "preload": {"coulomb": ("step", 0.08), "static": ("step", 0.08)},
    "cable": {"offset": ("step", 4.0)},
    "lubricant thinned": {"viscous": ("step", -0.10)},
}
"""Name -> parameter -> kind and size, relative to the level where that is not zero."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--years", type=positive, default=100, help="axis-years without a change (default 100)"
    )
    parser.add_argument(
        "--planted", type=positive, default=25, help="axis-years with each kind of change (default 25)"
    )
    parser.add_argument("--recordings", type=positive, default=50, help="of each axis in a year (default 50)")
    parser.add_argument("--seed", type=int, default=0)


def axis_year(
    random: np.random.Generator, recordings: int, planted: Mapping[str, tuple[str, float]], bump: bool = False
) -> tuple[AxisRows, float]:
    """The rows of one axis over a year, and the day of the year at which steps (and a bump) come."""
    days = np.sort(random.uniform(0.0, YEAR, recordings))
    change = float(random.uniform(0.2, 0.8)) * YEAR
    warm = np.array([temperature_on(float(day), random) for day in days])
    values = {name: _course(random, name, days, warm, planted.get(name), change) for name in LEVELS}
    begin = BEGIN.timestamp() / 86400.0
    content = []
    for k in range(recordings):
        tracking = bool(random.random() < TRACKING)
        shown = [] if tracking or not bump or days[k] < change else [_bump(random)]
        content.append(_row(k, begin + float(days[k]), float(warm[k]), values, shown, tracking, random))
    return rows_of("axis", content), begin + change


def _course(
    random: np.random.Generator,
    name: str,
    days: np.ndarray,
    warm: np.ndarray,
    planted: tuple[str, float] | None,
    change: float,
) -> tuple[np.ndarray, np.ndarray]:
    level, std, scatter, slope, _ = LEVELS[name]
    stds = std * np.exp(0.2 * random.standard_normal(len(days)))
    alike = np.empty(len(days))
    alike[0] = random.standard_normal()
    for k in range(1, len(days)):
        alike[k] = ALIKE * alike[k - 1] + math.sqrt(1.0 - ALIKE**2) * random.standard_normal()
    values = level + slope * (warm - REFERENCE) + scatter * alike + stds * random.standard_normal(len(days))
    if planted is not None:
        kind, size = planted
        size *= abs(level) if level else 1.0
        values = values + size * (days >= change if kind == "step" else days / YEAR)
    return values, stds


def _bump(random: np.random.Generator) -> Effect:
    parameters = {
        "amplitude": (0.25 + 7e-4 * random.standard_normal(), 7e-4, ""),
        "centre": (0.06 + 9e-5 * random.standard_normal(), 9e-5, "rad"),
    }
    return Effect("local_friction_bump", parameters, (), "position", 4.2)


def _row(
    number: int,
    day: float,
    temperature: float,
    values: Mapping[str, tuple[np.ndarray, np.ndarray]],
    shown: list[Effect],
    tracking: bool,
    random: np.random.Generator,
) -> dict[str, Any]:
    estimates = {name: (float(value[number]), float(std[number])) for name, (value, std) in values.items()}
    if tracking:  # what an identification makes of a motion without reversals
        estimates["coulomb"] = (LEVELS["coulomb"][0] * 1.5 + float(random.standard_normal()), 0.007)
    return {
        "recording": f"{number:05}",
        "piece": 0,
        "start": round(day * 86400e9),
        "duration": 50.0,
        "input_hash": f"{number:05}",
        "version": "1",
        "status": "done",
        "reason": None,
        "law": "lugre",
        "parameter_names": list(estimates),
        "parameter_values": [value for value, _ in estimates.values()],
        "parameter_stds": [std for _, std in estimates.values()],
        "parameter_determined": [not tracking or name == "coulomb" for name in estimates],
        "parameter_units": [LEVELS[name][4] for name in estimates],
        "verdict": "missing_physics" if shown else "match",
        "effects": shown,
        "temperature": temperature,
        "temperature_change": 0.1,
        "position_from": -0.1 + 0.01 * float(random.standard_normal()),
        "position_to": 0.1 + 0.01 * float(random.standard_normal()),
        "travel": 0.5,
        "speed_rms": 0.0141 * float(random.uniform(0.9, 1.1)),
        "speed_max": 0.03 * float(random.uniform(0.9, 1.1)),
        "reversals": 0 if tracking else 8,
    }


def plain_test(rows: AxisRows) -> bool:
    """Whether the means of both halves of the recordings differ in any parameter, by Welch's test."""
    half = len(rows) // 2
    parts = [(one.value[:half], one.value[half:]) for one in rows.estimates.values()]
    chances = [ttest_ind(*pair, equal_var=False, nan_policy="omit").pvalue for pair in parts]
    return bool(min(chances) < FALSE_RATE / len(parts))


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    random = np.random.default_rng([arguments.seed, 5])
    false, naive = 0, 0
    for _ in range(arguments.years):
        rows, _ = axis_year(random, arguments.recordings, {})
        false += bool(axis_trend(rows, REFERENCE).events)
        naive += plain_test(rows)
    results = [
        _row_of("axis-years without a change in which one was found", false, "", naive, arguments.years)
    ]
    for title, planted in PLANTED.items():
        results += _planted(random, title, planted, arguments)
    results += _bumps(random, arguments)
    return results


def _planted(
    random: np.random.Generator,
    title: str,
    planted: Mapping[str, tuple[str, float]],
    arguments: argparse.Namespace,
) -> list[dict[str, Any]]:
    """How many planted changes were found at their date and with their size, and what was found beside them."""
    found = sized = dated = wanted = beside = 0
    for _ in range(arguments.planted):
        rows, day = axis_year(random, arguments.recordings, planted)
        trend = axis_trend(rows, REFERENCE)
        changes = [change for event in trend.events for change in event.changes]
        for name, (kind, size) in planted.items():
            wanted += 1
            one = next((c for c in changes if c.parameter == name and c.kind == kind), None)
            found += one is not None
            sized += one is not None and abs(one.size - _true(trend, name, kind, size)) < WITHIN * one.std
            dated += one is not None and (kind == "drift" or _dated(one, day))
        beside += sum(c.parameter not in planted or c.kind != planted[c.parameter][0] for c in changes)
    return [
        _row_of(f"{title}: found", found, "", wanted, wanted),
        _row_of(f"{title}: size within {WITHIN:g} standard deviations", sized, "", wanted, wanted),
        _row_of(f"{title}: date within its 95 % interval", dated, "", wanted, wanted),
        _row_of(f"{title}: changes found that were not planted", beside, "", None, arguments.planted),
    ]


def _true(trend: AxisTrend, name: str, kind: str, size: float) -> float:
    """What a change comes to between the first and the last recording."""
    size *= abs(LEVELS[name][0]) if LEVELS[name][0] else 1.0
    day = trend.trends[name].series.day
    return size if kind == "step" else size * float(day[-1] - day[0]) / YEAR


def _dated(change: Change, day: float) -> bool:
    return change.earliest <= day <= change.latest


def _bumps(random: np.random.Generator, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    found = dated = 0
    for _ in range(arguments.planted):
        rows, day = axis_year(random, arguments.recordings, {}, bump=True)
        shown = axis_trend(rows, REFERENCE).presences
        found += len(shown) == 1
        dated += any(one.earliest <= day <= one.latest for one in shown)
    count = arguments.planted
    return [
        _row_of("bump: found", found, "", count, count),
        _row_of("bump: date within its 95 % interval", dated, "", count, count),
    ]


def _row_of(name: str, value: float, unit: str, beside: float | None, of: int) -> dict[str, Any]:
    ratio = value / beside if beside else None
    return {"name": f"{name} (of {of})", "value": value, "unit": unit, "beside": beside, "ratio": ratio}
