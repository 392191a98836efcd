"""Friction laws side by side on the same recordings, judged by samples that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from tcs_friction.conditioning.motion import Data
from tcs_friction.errors import InputError
from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification, finite
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import compared_laws


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
    """rows: best first by held-out residual, NaN last. found: law -> its identification, in the same order.

    left_out: law -> why it could not be fitted.
    """

    rows: tuple[Row, ...]
    found: dict[str, Identification]
    left_out: dict[str, str] = field(default_factory=dict)

    @property
    def best(self) -> Identification:
        """The law with the least residual on held-out samples."""
        return self.found[self.rows[0].law]

    def to_mapping(self) -> list[dict[str, Any]]:
        """Rows as in `identification.json` under `laws`."""
        return [
            {
                "law": row.law,
                "rmse": {"train": finite(row.train), "held_out": finite(row.held_out)},
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
    progress: Callable[[str, Generation], None] = lambda *_: None,
    cancel: Callable[[], bool] = lambda: False,
    options: IdentifyOptions | None = None,
    names: Sequence[str] | None = None,
) -> Comparison:
    """Identify every law that has a formula (or those named) by the default method. `progress` is told which of how many, too.

    Raises InputError when none can be fitted.
    """
    found: dict[str, Identification] = {}
    failed: dict[str, InputError] = {}
    names = names or compared_laws()
    for number, name in enumerate(names, 1):
        if cancel() and found:
            break
        shown = partial(progress, f"law {number} of {len(names)} ({name})")
        try:
            found[name] = identify(data, axis, "default", name, seed, shown, cancel, options)
        except InputError as error:
            failed[name] = error
    if failed and not found:
        raise next(iter(failed.values()))
    rows = sorted((_row(item) for item in found.values()), key=lambda row: (math.isnan(row.held_out), row.held_out))
    left_out = {name: str(error) for name, error in failed.items()}
    return Comparison(tuple(rows), {row.law: found[row.law] for row in rows}, left_out)


def _row(item: Identification) -> Row:
    count = len(item.fit.t)
    free = len(item.correlation[0])
    bic = count * math.log(max(item.rmse.train**2, 1e-300)) + free * math.log(count)
    return Row(item.law, item.rmse.held_out, item.rmse.train, len(item.parameters), bic, item.seconds)
