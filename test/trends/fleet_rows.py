"""Stored results of a few axes, as `./tcs fleet` would leave them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from pyarrow import parquet

from benchmarks.fleet_year import PLANTED, axis_year
from tcs_friction.trends.rows import AxisRows


def year(seed: int, planted: str = "", bump: bool = False, recordings: int = 50) -> tuple[AxisRows, float]:
    """One axis-year and the day of its change."""
    return axis_year(np.random.default_rng(seed), recordings, PLANTED.get(planted, {}), bump)


def as_content(rows: AxisRows, only: Sequence[str] = ()) -> list[dict[str, Any]]:
    """The rows as mappings with the columns of the data set; of all parameters, or of some."""
    content = []
    for k in range(len(rows)):
        known = {name: one for name, one in rows.estimates.items() if not only or name in only}
        content.append(
            {
                "recording": rows.recording[k],
                "piece": 0,
                "start": round(rows.day[k] * 86400e9),
                "input_hash": rows.recording[k],
                "version": rows.version[k],
                "status": "done" if rows.done[k] else "failed",
                "reason": rows.reasons[k] or None,
                "law": rows.law if rows.done[k] else None,
                "parameter_names": list(known),
                "parameter_values": [float(one.value[k]) for one in known.values()],
                "parameter_stds": [float(one.std[k]) for one in known.values()],
                "parameter_determined": [bool(np.isfinite(one.value[k])) for one in known.values()],
                "parameter_units": [one.unit for one in known.values()],
                "verdict": "match" if rows.diagnosed[k] else None,
                "effects": list(rows.effects[k]),
                **{name: float(values[k]) for name, values in rows.columns.items()},
            }
        )
    return content


def stored(out: Path, axes: Mapping[str, Sequence[Mapping[str, Any]]]) -> Path:
    """A data set at `out`/rows of axis -> rows as mappings."""
    for axis, content in axes.items():
        rows = [{**row, "effects": json.dumps([_entry(item) for item in row["effects"]])} for row in content]
        folder = out / "rows" / f"axis={axis}" / "month=2025-01"
        folder.mkdir(parents=True)
        parquet.write_table(pyarrow.Table.from_pylist(rows), folder / "part.parquet")
    return out


def _entry(item: Any) -> dict[str, Any]:
    return {
        "effect": item.name,
        "equivalent": list(item.equivalent),
        "parameters": {
            name: {"value": v, "std": s, "unit": u} for name, (v, s, u) in item.parameters.items()
        },
        "where": {"coordinate": item.coordinate},
        "torque_rms": item.torque_rms,
    }
