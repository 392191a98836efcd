"""Coordinates over a data set: their values where it is compared, and their units on either kind of axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned

from tcs_friction.diagnose.dataset.coordinates import unit_of, values_of


@pytest.mark.parametrize(
    ("coordinate", "rotary", "linear"),
    [
        ("time", "s", "s"),
        ("position", "rad", "m"),
        ("velocity", "rad/s", "m/s"),
        ("acceleration", "rad/s^2", "m/s^2"),
        ("torque", "N m", "N"),
        ("temperature", "degC", "degC"),
        ("time_since_reversal", "s", "s"),
        ("frequency", "Hz", "Hz"),
        ("direction", "", ""),
        ("exogenous:wind_speed", "", ""),
    ],
)
def test_units_are_those_of_the_kind_of_axis(coordinate: str, rotary: str, linear: str) -> None:
    assert unit_of(coordinate, axis()) == rotary
    assert unit_of(coordinate, replace(axis(), kind="linear")) == linear
    assert unit_of(coordinate, replace(axis(), torque_unit="A")) == ("A" if coordinate == "torque" else rotary)


def test_values_are_those_at_the_samples_that_are_compared() -> None:
    """Of stretches one after the other, signals by their names."""
    one, two = (conditioned(np.random.default_rng(seed), seconds=20.0) for seed in (1, 2))
    stretches = tuple(
        replace(s, signals=np.vstack([s.signals, 7.0 + s.t]), train=s.train[::2], held_out=s.held_out[::2], piece=s.piece[::2])
        for s in (*one.stretches, *two.stretches)
    )
    data = replace(one, stretches=stretches, names=("wind_speed", "humidity"), stride=2, dt=2.0 * one.dt)
    expected = {
        "time": [s.t for s in stretches],
        "position": [s.position for s in stretches],
        "torque": [s.torque for s in stretches],
        "temperature": [s.signals[0] for s in stretches],
        "exogenous:wind_speed": [s.signals[1] for s in stretches],
        "exogenous:humidity": [7.0 + s.t for s in stretches],
    }
    for coordinate, parts in expected.items():
        np.testing.assert_array_equal(values_of(data, coordinate), np.concatenate([x[::2] for x in parts]))
