"""`./tcs bench accuracy --axes scales`: what `identify` makes of the worlds of `scale_worlds`, beside the truth and the bound.

Nobody tells it when the torque acts, how it was logged or what the noise is; what it believes of the friction is up to 20 % off.
A number is missed if its bound is below a tenth of it and it is called undetermined.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.scale_bound import bound
from benchmarks.scale_worlds import ScaleWorld, draw
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.errors import TcsError
from tcs_friction.identify.identification import identify
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

NAMES = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous", "inertia")
NORMAL_95, NORMAL_MEDIAN = 1.96, 0.6745
FAR = 6.0  # standard deviations
TOLD = 0.1  # of a value: with a lower bound, a recording tells it

Row = tuple[float, float, float, float]  # error, standard deviation (NaN: undetermined), bound, truth


def recorded(world: ScaleWorld) -> Recording:
    """A world's log, as somebody reads it who knows nothing of its clocks."""
    own = len(world.torque_t) != len(world.t) or not np.array_equal(world.torque_t, world.t)
    last = np.clip(np.searchsorted(world.torque_t, world.t, side="right") - 1, 0, len(world.torque) - 1)
    log = np.vstack([world.torque_t, world.torque]) if own else None
    return Recording(world.t, world.position, world.torque[last] if own else world.torque, torque_log=log, source=world.name)


def believed(world: ScaleWorld) -> Axis:
    """What its owner believes of the axis."""
    values = {name: world.believed[name] for name in NAMES[:6]}
    return Axis("axis", world.believed["inertia"], instance(law("lugre"), values), (), world.kind)


def rows(world: ScaleWorld) -> dict[str, Row]:
    """What `identify` makes of each parameter of a world."""
    limits = bound(world)
    try:
        found = identify([recorded(world)], believed(world))
    except TcsError:  # refused, with its reason: nothing is told
        return {name: (np.nan, np.nan, limits[name], world.truth[name]) for name in NAMES}
    return {name: _row_of(_estimate(found, name), limits[name], world.truth[name]) for name in NAMES}


def _estimate(found: Identification, name: str) -> Estimate:
    return found.inertia if name == "inertia" else found.parameters[name]


def _row_of(estimate: Estimate, limit: float, truth: float) -> Row:
    return estimate.value - truth, estimate.std if estimate.determined else np.nan, limit, truth


def run(seed: int, worlds: int) -> list[dict[str, Any]]:
    """The benchmark's results: of each parameter and of all together."""
    every = side_by_side(lambda number: rows(draw(seed, number)), range(worlds))
    tables = {name: np.array([one[name] for one in every]) for name in NAMES}
    tables = {"": np.vstack(list(tables.values())), **{f"{name}: ": table for name, table in tables.items()}}
    return [line for whose, table in tables.items() for line in _results(whose, table)]


def _results(whose: str, table: np.ndarray) -> list[dict[str, Any]]:
    """Rows of a parameter (n, 4): error, standard deviation, bound, truth."""
    told = table[np.isfinite(table[:, 1])]
    scores, ratios = np.abs(told[:, 0] / told[:, 1]), np.abs(told[:, 0] / told[:, 2])
    missed = ~np.isfinite(table[:, 1]) & (table[:, 2] < TOLD * np.abs(table[:, 3]))
    counts = [
        _line(f"{whose}determined", len(told), len(table)),
        _line(f"{whose}undetermined with a bound below 10 %", int(np.count_nonzero(missed)), 0),
    ]
    if not len(told):
        return counts
    return [
        *counts,
        _line(f"{whose}95 % intervals that hold the truth", 100.0 * float(np.mean(scores < NORMAL_95)), 95.0, "%"),
        _line(f"{whose}beyond {FAR:g} standard deviations", int(np.count_nonzero(scores > FAR)), 0),
        _line(f"{whose}median error over that of the bound", float(np.median(ratios)) / NORMAL_MEDIAN, 1.0),
    ]


def _line(name: str, value: float, beside: float, unit: str = "1") -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": value / beside if beside else None}
