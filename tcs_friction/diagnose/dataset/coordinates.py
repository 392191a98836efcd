"""Coordinates that a residual may live on: their values over conditioned recordings, and their units."""

from __future__ import annotations

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.physics.axis import Axis

UNITS = {
    "time": "s",
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "torque": "N m",
    "temperature": "degC",
    "time_since_reversal": "s",
    "frequency": "Hz",
}


def unit_of(coordinate: str, axis: Axis) -> str:
    """Its unit on an axis; nothing for directions and for signals, whose units nobody recorded."""
    return axis.unit(UNITS.get(coordinate, ""))


def values_of(data: DataSet, coordinate: str) -> np.ndarray:
    """A coordinate of the motion vector (n,): time, position, ..., temperature, `exogenous:NAME`."""
    if coordinate == "temperature":
        return np.asarray(data.joined("signals")[0])
    if coordinate.startswith("exogenous:"):
        return np.asarray(data.joined("signals")[1 + data.names.index(coordinate.removeprefix("exogenous:"))])
    return data.joined("t" if coordinate == "time" else coordinate)
