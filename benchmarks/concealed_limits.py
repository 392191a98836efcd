"""How large an effect must be to be found in half of all recordings: the tool's limit beside that of an oracle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.concealed_cases import Case, world_of
from benchmarks.concealed_effects import EFFECTS
from benchmarks.concealed_oracle import detection_limit
from benchmarks.concealed_report import row
from tcs_friction.diagnose.pipeline import diagnose


def limits_of(task: tuple[str, int, float]) -> tuple[str, float, float]:
    """An effect's detection limits over the noise floor: the tool's, by an up-and-down search, and the oracle's."""
    name, seed, stretch = task
    index = list(EFFECTS).index(name)
    world = world_of(Case("limit", (name,), (seed, index, 0), stretch, 1.0))
    believed = world.believed.axis
    declared = {p.name for p in believed.friction.term.parameters}
    values = {n: v for n, v in world.truth.friction.items() if n in declared}
    axis = replace(believed.with_friction(values), inertia=world.truth.inertia)
    oracle = detection_limit(world, axis) / world.truth.noise_floor
    size, factor, visited, before = 3.0 * oracle, 2.0, [], None
    for trial in range(1, 9):
        case = Case("limit", (name,), (seed, index, trial), stretch, size)
        hidden = world_of(case)
        entries = diagnose([hidden.recording], hidden.believed).to_mapping()["effects"]
        seen = any(name in (entry["effect"], *entry["equivalent"]) for entry in entries)
        if before is not None and seen != before:
            factor = math.sqrt(factor) if factor > 1.3 else factor
            visited.append(size)
        before = seen
        size = size / factor if seen else size * factor
    visited.append(size)
    return name, float(np.exp(np.mean(np.log(visited)))), oracle


def limit_rows(limits: Sequence[tuple[str, float, float]]) -> list[dict[str, Any]]:
    """One row an effect, and the median ratio."""
    found = [row(f"detection limit, {name}", tool, "noise floors", oracle) for name, tool, oracle in limits]
    return [
        *found,
        row("detection limit over the oracle's, median", float(np.median([t / o for _, t, o in limits]))),
    ]
