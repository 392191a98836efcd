"""The result of an identification, as data and as `identification.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from tcs_friction.numerics.by_speed import TorqueBySpeed
from tcs_friction.numerics.outcome import Outcome

SCHEMA = "tcs_friction/identification/1"
RISING = "friction rises with speed; no stiction"


@dataclass(frozen=True)
class Estimate:
    """One identified number.

    `value` of an undetermined parameter is the one that was held while the others were fitted; the file says null.
    `std` is NaN (null in the file) where the value is at no minimum of the cost.
    """

    value: float
    std: float
    unit: str
    determined: bool = True
    reason: str | None = None

    def to_mapping(self) -> dict[str, Any]:
        return {
            "value": finite(self.value) if self.determined else None,
            "std": finite(self.std) if self.determined else None,
            "unit": self.unit,
            "determined": self.determined,
            "reason": self.reason,
        }


def finite(value: float) -> float | None:
    """A number as JSON can have it: None for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


@dataclass(frozen=True)
class Errors:
    """Root mean square of the torque residual, N m; held_out: samples that the fit behind this number never saw."""

    train: float
    held_out: float


@dataclass(frozen=True)
class TorqueTiming:
    """When the logged torque acts: `acts` s after its stamp it begins to (see `conditioning.hold`), `delay` s of it believed
    apart; between: `held`, or a `line` through momentary values."""

    acts: Estimate
    delay: float
    between: str

    def to_mapping(self) -> dict[str, Any]:
        """As in `identification.json`."""
        return {"acts": self.acts.to_mapping(), "actuation_delay": self.delay, "between": self.between}


@dataclass(frozen=True)
class Noise:
    """What disturbs the axis and its encoder, by a fit of predictions: drive N m rms up to `bandwidth` Hz, encoder rad rms."""

    drive: float
    bandwidth: float
    encoder: float

    def to_mapping(self) -> dict[str, Any]:
        """As in `identification.json`."""
        return {"drive": self.drive, "bandwidth": self.bandwidth, "encoder": self.encoder}


@dataclass(frozen=True, eq=False)
class Fit:
    """The compared samples, for pictures, each (m,): t s, velocity rad/s, torque measured and modelled, friction in both, N m."""

    t: np.ndarray
    velocity: np.ndarray
    measured: np.ndarray
    modelled: np.ndarray
    friction_measured: np.ndarray
    friction_modelled: np.ndarray
    bounds: np.ndarray  # (s + 1,) where each stretch starts

    @property
    def residual(self) -> np.ndarray:
        """(m,) N m."""
        return self.measured - self.modelled


@dataclass(frozen=True, eq=False)
class Profile:
    """values (k,) in the parameter's unit, estimate included; rise (k,) of -2 log likelihood; 95 % interval, None where open."""

    values: np.ndarray
    rise: np.ndarray
    interval: tuple[float | None, float | None]

    def to_mapping(self) -> dict[str, Any]:
        """As in `identification.json`."""
        return {
            "values": self.values.tolist(),
            "rise": self.rise.tolist(),
            "interval": list(self.interval),
        }


@dataclass(frozen=True, eq=False)
class Identification:
    """What was identified, how well, and how.

    parameters: of the law, by their names in the axis file. directions: the same for motion one way only ("positive",
    "negative"), without those that the recording never shows. correlation: names and matrix (p, p) of the free unknowns.
    bound: least standard deviation that any unbiased estimate could have with noise like the residual (Cramer-Rao), by name.
    profiles: profile likelihoods by name, where asked for. history, evaluated: best cost (g,) per generation of the global
    search, and evaluations (g,) until then. outcome: how the search ended; minimum: whether at a minimum of the cost, otherwise
    every `std` is NaN. noise_floor: see `conditioning.noise_floor`, at most what is left of fitted and of held-out samples.
    by_speed: friction against speed, for pictures; None where there is no motion. timing: of the torque; None for friction
    estimates. noise: None where no predictions were made.
    """

    law: str
    method: str
    parameters: Mapping[str, Estimate]
    inertia: Estimate
    offset: Estimate
    directions: Mapping[str, Mapping[str, Estimate]]
    rmse: Errors
    noise_floor: float
    cost: float
    evaluations: int
    seconds: float
    outcome: Outcome
    history: np.ndarray
    fit: Fit
    correlation: tuple[tuple[str, ...], np.ndarray]
    bound: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    notes: tuple[str, ...] = ()
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    by_speed: TorqueBySpeed | None = None
    timing: TorqueTiming | None = None
    noise: Noise | None = None
    minimum: bool = True
    evaluated: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        for name in ("parameters", "directions", "bound", "profiles"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def every(self) -> dict[str, Estimate]:
        """Estimates by name: the law's parameters, inertia and offset."""
        return {**self.parameters, "inertia": self.inertia, "offset": self.offset}

    def friction(self, direction: str | None = None) -> dict[str, float]:
        """Values of every parameter of the law, for one direction or both together; undetermined ones as they were held."""
        chosen = {**self.parameters, **(self.directions.get(direction, {}) if direction else {})}
        return {name: estimate.value for name, estimate in chosen.items()}

    def to_mapping(self) -> dict[str, Any]:
        """The content of `identification.json`."""
        names, matrix = self.correlation
        return {
            "schema": SCHEMA,
            "law": self.law,
            "method": self.method,
            "parameters": {name: item.to_mapping() for name, item in self.parameters.items()},
            "inertia": self.inertia.to_mapping(),
            "offset": self.offset.to_mapping(),
            "timing": self.timing.to_mapping() if self.timing else None,
            "noise": self.noise.to_mapping() if self.noise else None,
            "directions": {
                way: {name: item.to_mapping() for name, item in found.items()}
                for way, found in self.directions.items()
            },
            "rmse": {"train": finite(self.rmse.train), "held_out": finite(self.rmse.held_out)},
            "noise_floor": finite(self.noise_floor),
            "cost": finite(self.cost),
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "seed": self.seed,
            "outcome": self.outcome.value,
            "minimum": self.minimum,
            "cramer_rao": {name: finite(value) for name, value in self.bound.items()},
            "correlation": {
                "names": list(names),
                "matrix": [[round(float(x), 6) for x in row] for row in matrix],
            },
            **(
                {"profiles": {name: item.to_mapping() for name, item in self.profiles.items()}}
                if self.profiles
                else {}
            ),
            "history": [float(x) for x in self.history],
            "notes": list(self.notes),
        }
