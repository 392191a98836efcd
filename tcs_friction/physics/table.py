"""A table of torque over one or two coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.physics.motion import SLOTS, signal_slot

RECORDED = "exogenous:"  # before the name of a recorded signal that is a coordinate


@dataclass(frozen=True)
class Table:
    """Opposing torque over one or two coordinates, for a tabulated effect.

    Attributes
    ----------
    coordinates: names from SLOTS, or `exogenous:NAME`.
    lower, upper: range of each coordinate; outside, the edge value holds.
    values: torque on the regular grid, N m, shape (n,) or (n, m).
    """

    coordinates: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    values: np.ndarray

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for equal tables."""
        return self.coordinates, self.lower, self.upper, self.values.shape, self.values.tobytes()

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the recorded signals among its coordinates."""
        return tuple(name.removeprefix(RECORDED) for name in self.coordinates if name.startswith(RECORDED))

    def slot(self, coordinate: str, signals: tuple[str, ...]) -> int:
        if coordinate in SLOTS:
            return SLOTS[coordinate]
        name = coordinate.removeprefix(RECORDED)
        if name not in signals:
            raise InputError(
                "table",
                f"no coordinate {coordinate!r}",
                f"one of: {', '.join([*SLOTS, *signals])}",
            )
        return signal_slot(signals.index(name))

    def packed(self, signals: tuple[str, ...]) -> list[float]:
        grid = self.values if self.values.ndim == 2 else self.values[:, None]
        coordinates = [*self.coordinates, "time"][:2]
        lower, upper = [*self.lower, 0.0][:2], [*self.upper, 1.0][:2]
        head: list[float] = []
        for name, low, high, size in zip(coordinates, lower, upper, grid.shape, strict=True):
            head += [float(self.slot(name, signals)), low, high, float(size)]
        return head + [float(x) for x in grid.ravel()]
