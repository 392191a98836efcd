"""How sure an axis model and its controller are known: the joint normal distribution of their numbers, and draws from it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.config_field import settings
from tcs_friction.control.model_compensator import effect_names
from tcs_friction.control.pid import PidConfig
from tcs_friction.physics.axis import Axis

Array = NDArray[np.float64]

Unknown = tuple[str, str]
"""A number that is not known exactly: what it belongs to (one of those below or the name of an effect), and its own name."""
FRICTION, BODY, DRIVE, CONTROLLER = "friction law", "axis", "drive", "controller"
INERTIA: Unknown = (BODY, "inertia")
NOISE: Unknown = (DRIVE, "noise")

TRIES = 100
"""Of a draw that has to lie within the bounds; what then is still beyond one is put there."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Names of k numbers and their covariance (k, k) about the values that the axis file and its controller have."""

    unknowns: tuple[Unknown, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __bool__(self) -> bool:
        return bool(np.any(self.covariance))

    def with_independent(self, other: Spread) -> Spread:
        """Both, the one knowing nothing of the other; what both have is as the other one says."""
        kept = [k for k, name in enumerate(self.unknowns) if name not in other.unknowns]
        size = len(kept)
        covariance = np.zeros((size + len(other.unknowns),) * 2)
        covariance[:size, :size] = self.covariance[np.ix_(kept, kept)]
        covariance[size:, size:] = other.covariance
        return Spread((*(self.unknowns[k] for k in kept), *other.unknowns), covariance)


def independent(deviations: Mapping[str, Mapping[str, float]]) -> Spread:
    """Of standard deviations by effect and parameter."""
    found = {(part, name): value for part, values in deviations.items() for name, value in values.items()}
    return Spread(tuple(found), np.diag(np.square(list(found.values()))) if found else np.zeros((0, 0)))


def drawn(axis: Axis, controller: PidConfig, spread: Spread, count: int, seed: int) -> list[tuple[Axis, PidConfig]]:
    """So many axes and controllers that could be the true ones, every number within its declared bounds."""
    random = np.random.default_rng(seed)
    limits = np.array([_bounds(axis, name) for name in spread.unknowns]).reshape(-1, 2)
    centre = np.array([_value(axis, controller, name) for name in spread.unknowns])
    root = _root(spread.covariance)
    return [_moved(axis, controller, spread.unknowns, _inside(centre, root, limits, random)) for _ in range(count)]


def _inside(centre: Array, root: Array, limits: Array, random: np.random.Generator) -> Array:
    """One draw (k,) from the normal distribution where it is within the limits (k, 2)."""
    for _ in range(TRIES):
        values = centre + root @ random.standard_normal(len(centre))
        if np.all((values >= limits[:, 0]) & (values <= limits[:, 1])):
            break
    return np.asarray(np.clip(values, limits[:, 0], limits[:, 1]))


def _root(covariance: Array) -> Array:
    """A matrix whose square is a covariance (k, k); rounding may have made it slightly indefinite.

    The numbers are scaled to deviations of 1 first, since theirs may be twenty orders of magnitude apart.
    """
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _bounds(axis: Axis, unknown: Unknown) -> tuple[float, float]:
    part, name = unknown
    if unknown in (INERTIA, NOISE):
        return math.ulp(0.0), math.inf
    if part == CONTROLLER:
        declared = next(one for one in settings(PidConfig) if one.name == name)
        assert declared.lower is not None  # it is a number
        assert declared.upper is not None
        return declared.lower, declared.upper
    term = axis.friction.term if part == FRICTION else effect_names(axis)[part].term
    parameter = term.parameter(name)
    return parameter.lower, parameter.upper


def _value(axis: Axis, controller: PidConfig, unknown: Unknown) -> float:
    part, name = unknown
    if unknown == INERTIA:
        return axis.inertia
    if unknown == NOISE:
        return axis.drive.noise
    if part == CONTROLLER:
        return float(getattr(controller, name))
    return (axis.friction if part == FRICTION else effect_names(axis)[part]).values[name]


def _moved(axis: Axis, controller: PidConfig, names: Sequence[Unknown], values: Array) -> tuple[Axis, PidConfig]:
    """The axis and the controller with these values (k,) in place of theirs."""
    changed: dict[str, dict[str, float]] = {}
    for (part, name), value in zip(names, values.tolist(), strict=True):
        changed.setdefault(part, {})[name] = value
    inertia = changed.get(BODY, {}).get("inertia", axis.inertia)
    effects = tuple(
        item.replace(**changed[name]) if name in changed else item for name, item in effect_names(axis).items()
    )
    drive = replace(axis.drive, **changed.get(DRIVE, {}))
    moved = replace(axis, inertia=inertia, effects=effects, drive=drive).with_friction(changed.get(FRICTION, {}))
    return moved, replace(controller, **changed.get(CONTROLLER, {}))
