"""PSO-GA beside PSO alone, as the paper compares them: the same cost, the same seed, as many evaluations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.conditioning.motion import Data
from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.operators import PAPER
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification, finite
from tcs_friction.physics.axis import Axis

HYBRID, SWARM, AS_PRINTED = "pso-ga", "pso", "paper"
NAMES = {HYBRID: "PSO-GA", SWARM: "PSO"}


@dataclass(frozen=True, eq=False)
class Searches:
    """found: what each search found, PSO-GA first. Their evaluations differ by less than one generation."""

    found: dict[str, Identification]

    def rows(self) -> list[list[str]]:
        """A table for people: what is compared, PSO-GA's, PSO's, the unit."""
        both = list(self.found.values())
        unit = both[0].offset.unit
        return [
            ["residual, rms", *(f"{residual_rms(item):.4g}" for item in both), unit],
            ["cost", *(f"{item.history[-1]:.6g}" for item in both), f"({unit})²"],
            ["evaluations", *(f"{searched(item):,}" for item in both), ""],
            ["time", *(f"{item.seconds:.1f}" for item in both), "s"],
            ["ended", *(item.outcome.value for item in both), ""],
            *([name, *(f"{item.every[name].value:.5g}" for item in both), one.unit] for name, one in both[0].every.items()),
        ]

    def to_mapping(self) -> list[dict[str, Any]]:
        """As in `identification.json` under `compare`."""
        return [
            {
                "method": method,
                "residual": finite(residual_rms(item)),
                "cost": finite(float(item.history[-1])),
                "evaluations": searched(item),
                "seconds": item.seconds,
                "outcome": item.outcome.value,
                "minimum": item.minimum,
                "values": {name: finite(estimate.value) for name, estimate in item.every.items()},
                "history": {"evaluations": item.evaluated.tolist(), "cost": item.history.tolist()},
            }
            for method, item in self.found.items()
        ]


def searched(found: Identification) -> int:
    """Evaluations of the search alone; those that judge its end come on top."""
    return int(found.evaluated[-1])


def residual_rms(found: Identification) -> float:
    """Root mean square of measured less modelled torque over all that was compared, N m: the paper's RMSE."""
    return float(np.sqrt(np.mean(found.fit.residual**2)))


def compare_searches(
    data: Sequence[Data],
    axis: Axis,
    law: str | None = None,
    seed: int = 0,
    progress: Callable[[Generation], None] = lambda _: None,
    options: IdentifyOptions | None = None,
    method: str = HYBRID,
) -> Searches:
    """Search by PSO-GA, then by PSO alone until as many evaluations are spent.

    method: `paper` for the paper's settings, otherwise those of `options` count.
    PSO is not ended where it stagnates, and its inertia weight falls over all of its generations. Neither is refined. Raises
    InputError as `identify` does.
    """
    options = replace(options or IdentifyOptions(), refine=False, profile=False)
    method = AS_PRINTED if method == AS_PRINTED else HYBRID
    hybrid = identify(data, axis, method, law, seed, progress, options=options)
    settings = PAPER if method == AS_PRINTED else options.swarm
    generations = max(searched(hybrid) // settings.population - 1, 1)  # the first evaluation is that of the start
    as_many = replace(
        settings, generations=1, swarm_generations=generations, genetic_generations=0, stagnation=generations + 1
    )
    swarm = identify(data, axis, SWARM, law, seed, progress, options=replace(options, swarm=as_many))
    return Searches({HYBRID: hybrid, SWARM: swarm})
