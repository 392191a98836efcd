"""Motions that cannot tell a number: it is called undetermined, or its uncertainty covers the truth."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import INERTIA, LUGRE, axis_of, walked

from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.result import Identification
from tcs_friction.recording.recording import Recording

BIAS = 15.0
RATE = 200.0
COVERED = 3.0  # standard deviations
PLAIN = {"coulomb": 78.1, "viscous": 572.0}


def moved(velocity: np.ndarray, law: str, values: dict[str, float]) -> Recording:
    """A recording of a biased axis with a law that went at these speeds (n,)."""
    random = np.random.default_rng(0)
    t = np.arange(len(velocity)) / RATE
    position = np.cumsum(velocity) / RATE
    torque = INERTIA * np.gradient(velocity, t) + walked(axis_of(values, law).friction, t, position) + BIAS
    noisy = position + 2e-8 * random.standard_normal(len(t))
    return Recording(t, noisy, torque + 0.3 * random.standard_normal(len(t)), source="test")


def wrong(found: Identification, truth: dict[str, float]) -> list[str]:
    """What is called determined and is not covered."""
    numbers = {**found.parameters, "inertia": found.inertia, "offset": found.offset}
    return [
        f"{name}: {numbers[name].value:.4g} ± {numbers[name].std:.2g}, of {true:.4g}"
        for name, true in truth.items()
        if numbers[name].determined and abs(numbers[name].value - true) > COVERED * numbers[name].std
    ]


T = np.arange(int(20.0 * RATE)) / RATE
ONE_WAY = 4e-3 + 2e-3 * np.sin(1.5 * T)
ONE_SPEED = 4e-3 + 4e-6 * np.sin(1.5 * T)
TO_AND_FRO = 4e-3 * np.sin(1.5 * T)
SLOWLY_TO_AND_FRO = 1e-4 * np.sin(0.6 * T)  # far below the Stribeck velocity


@pytest.mark.parametrize(
    ("velocity", "undetermined"), [(ONE_WAY, {"coulomb"}), (ONE_SPEED, {"coulomb", "viscous"}), (TO_AND_FRO, set())]
)
def test_what_a_motion_cannot_tell_apart_is_undetermined(velocity: np.ndarray, undetermined: set[str]) -> None:
    guess = axis_of({"coulomb": 60.0, "viscous": 300.0}, "coulomb_viscous", 700.0)
    found = identify([moved(velocity, "coulomb_viscous", PLAIN)], guess)
    assert {name for name, one in found.parameters.items() if not one.determined} == undetermined
    assert wrong(found, {**PLAIN, "offset": BIAS}) == []
    if "coulomb" in undetermined:
        assert "offset" in str(found.parameters["coulomb"].reason)
        assert found.parameters["coulomb"].to_mapping()["value"] is None


def test_one_way_tells_coulomb_torque_where_a_constant_torque_is_ruled_out() -> None:
    recorded = moved(ONE_WAY, "coulomb_viscous", PLAIN)
    unbiased = Recording(recorded.t, recorded.position, recorded.torque - BIAS, source="test")
    guess = axis_of({"coulomb": 60.0, "viscous": 300.0}, "coulomb_viscous", 700.0)
    found = identify([unbiased], guess, options=IdentifyOptions(offset=False))
    assert found.parameters["coulomb"].determined
    assert wrong(found, {**PLAIN, "inertia": INERTIA}) == []


def test_static_torque_is_not_taken_for_coulombs_where_all_is_slow() -> None:
    found = identify([moved(SLOWLY_TO_AND_FRO, "lugre", LUGRE)], axis_of({**LUGRE, "coulomb": 50.0, "static": 60.0}))
    assert not found.parameters["coulomb"].determined
    assert "stribeck velocity" in str(found.parameters["coulomb"].reason)
    assert wrong(found, LUGRE) == []
