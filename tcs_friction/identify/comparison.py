"""Friction laws side by side on the same recordings, judged by samples that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.motion import Data
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import laws


@dataclass(frozen=True)
class Row:
    """One law: residual rms on held-out and on training samples, N m; determined parameters; Bayesian information criterion."""

    law: str
    held_out: float
    train: float
    parameters: int
    bic: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """rows: best first by held-out residual. found: law -> its identification, in the same order."""

    rows: tuple[Row, ...]
    found: dict[str, Identification]

    @property
    def best(self) -> Identification:
        """The law with the least residual on held-out samples."""
        return self.found[self.rows[0].law]

    def to_mapping(self) -> list[dict[str, Any]]:
        """Rows as in `identification.json` under `laws`."""
        return [
            {
                "law": row.law,
                "rmse": {"train": row.train, "held_out": row.held_out},
                "parameters": row.parameters,
                "bic": row.bic,
                "seconds": row.seconds,
            }
            for row in self.rows
        ]


def compare_laws(
    data: Sequence[Data],
    axis: Axis,
    seed: int = 0,
    progress: Callable[[Generation], None] = lambda _: None,
    cancel: Callable[[], bool] = lambda: False,
    options: IdentifyOptions | None = None,
    names: Sequence[str] | None = None,
) -> Comparison:
    """Identify every law (or those named) by the default method."""
    found: dict[str, Identification] = {}
    for name in names or sorted(laws()):
        if cancel() and found:
            break
        found[name] = identify(data, axis, "default", name, seed, progress, cancel, options)
    rows = sorted((_row(item) for item in found.values()), key=lambda row: row.held_out)
    return Comparison(tuple(rows), {row.law: found[row.law] for row in rows})


def _row(item: Identification) -> Row:
    count = len(item.fit.t)
    free = len(item.correlation[0])
    bic = count * math.log(max(item.rmse.train**2, 1e-300)) + free * math.log(count)
    return Row(item.law, item.rmse.held_out, item.rmse.train, len(item.parameters), bic, item.seconds)
