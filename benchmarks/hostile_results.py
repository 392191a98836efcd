"""Results made to hurt whoever reads them back: diagnoses, identifications and rows of fleets; recordings that tell nothing."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from pyarrow import parquet

from benchmarks.hostile_bags import Maker
from benchmarks.hostile_yaml import device, pipe
from tcs_friction.conditioning.checks import check_changes
from tcs_friction.conditioning.motion import prepare
from tcs_friction.diagnose.outcome.result import SCHEMA as DIAGNOSIS
from tcs_friction.identify.identification import identify
from tcs_friction.identify.net_work import refuse_turned
from tcs_friction.identify.result import SCHEMA as IDENTIFICATION
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.tables import import_table
from tcs_friction.report.diagnosis_files import told_by
from tcs_friction.report.identification_spread import spread_by
from tcs_friction.trends.fleet import fleet_trend
from tcs_friction.trends.read import NEEDED, read_axes

AXIS = Axis(
    "hostile",
    4.0,
    instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.5}),
    (instance(effect("cogging"), {"order": 72.0, "amplitude": 2.0, "phase": 0.3}),),
)
ODD: tuple[Any, ...] = (None, True, -1, 0, 1e400, -1e400, "x", "\x1b[31m", [], {}, [[]], {"value": 1}, 10**400, "9" * 1000)
NAMES = ("effects", "described", "parameters", "order", "amplitude", "value", "std", "effect", "law", "correlation", "drive")


def told(path: Path, size: int, schema: str) -> Path:
    """A result of so many entries, in which odd values stand at random."""
    chance = random.Random(f"{schema} {size}")
    parameters = {name: {"value": value, "std": 0.1} for name, value in AXIS.effects[0].values.items()}
    entry = {"effect": "cogging", "parameters": parameters}
    friction = {name: {"value": value, "std": 0.1, "determined": True} for name, value in AXIS.friction.values.items()}
    content: dict[str, Any] = {"effects": [entry] * size, "described": [entry], "law": "coulomb_viscous", "parameters": friction}
    content |= {"inertia": {"value": 4.0, "std": 0.1, "determined": True}, "correlation": {}, "drive": {"noise": {"value": 1.0}}}
    content = {"schema": schema, **_spoilt(content, chance)}
    path = path.with_suffix(".json")
    path.write_text(json.dumps(content))
    return path


def _spoilt(value: Any, chance: random.Random) -> Any:
    if chance.random() < 0.02:
        return chance.choice(ODD)
    if isinstance(value, dict):
        kept = {name: _spoilt(inner, chance) for name, inner in value.items() if chance.random() > 0.02}
        return kept | ({chance.choice(NAMES): chance.choice(ODD)} if chance.random() < 0.02 else {})
    return [_spoilt(inner, chance) for inner in value] if isinstance(value, list) else value


def nested(path: Path, size: int) -> Path:
    """Lists inside lists."""
    path.write_text('{"schema": ' + "[" * size)
    return path


def rows(path: Path, size: int) -> Path:
    """The results of a fleet of two axes, of which a file may lack a column, or hold what is none."""
    chance = random.Random(f"rows {size}")
    for axis in ("a", "b"):
        folder = path / "rows" / f"axis={axis}" / "month=2026-01"
        folder.mkdir(parents=True)
        columns = {name: pyarrow.array([_cell(name, chance)] * size) for name in NEEDED if chance.random() > 0.02}
        parquet.write_table(pyarrow.table(columns), folder / "rows.parquet")
    return path


def _cell(name: str, chance: random.Random) -> Any:
    if chance.random() < 0.05:
        return chance.choice((None, "x", -1, 1e300, ""))
    if name.startswith("parameter_"):
        return [] if chance.random() < 0.5 else [{"names": "coulomb", "determined": True, "units": "N m"}.get(name[10:], 1.0)]
    return {"piece": 0, "start": 1 << 60, "status": "done", "effects": "[]", "law": "lugre"}.get(name, 1.0)


def motion(path: Path, size: int, kinds: tuple[str, str]) -> Path:
    """A table whose position and torque say next to nothing: constant, a line, a step, one value that differs, noise."""
    t, noise = np.arange(size) / 100.0, np.random.default_rng(size)
    made = {
        "constant": np.full(size, 1.5), "line": 0.1 * t, "step": np.where(t > t.mean(), 1.0, 0.0), "sine": np.sin(t),
        "one": np.eye(1, size, size // 2)[0], "noise": 1e-6 * noise.standard_normal(size),
        "huge": 1e300 * (-1.0) ** np.arange(size),
    }  # fmt: skip
    path = path.with_suffix(".csv")
    columns = zip(t.tolist(), made[kinds[0]].tolist(), made[kinds[1]].tolist(), strict=True)
    path.write_text("time [s],position [rad],torque [Nm]\n" + "".join(f"{a!r},{b!r},{c!r}\n" for a, b, c in columns))
    return path


def reading_results(path: Path) -> list[Callable[[], object]]:
    """What commands do with such a file."""
    if path.is_dir():
        return [lambda: fleet_trend(list(read_axes(str(path))))]
    return [lambda: told_by(path, AXIS), lambda: spread_by(path, AXIS)]


def reading_motions(path: Path) -> list[Callable[[], object]]:
    """What `identify` does with such a table."""

    def identified() -> object:
        recording: Recording = import_table(path, "axis", {}).recording
        check_changes([recording])
        refuse_turned(prepare([recording]), AXIS.kind)
        return identify([recording], AXIS)

    return [identified]


RESULTS: dict[Maker, tuple[int, int]] = {
    **{partial(told, schema=schema): (1, 300) for schema in (DIAGNOSIS, IDENTIFICATION)},
    nested: (1, 1_000_000), device: (1, 1), pipe: (1, 1), rows: (1, 300),
}  # fmt: skip
QUIET = ("constant", "line", "step", "one", "noise", "huge")
MOTIONS: dict[Maker, tuple[int, int]] = {
    partial(motion, kinds=(position, torque)): (2, 400) for position in (*QUIET, "sine") for torque in QUIET
}
"""Makers, each with the least and the largest size to draw."""
