"""Draws of axes and controllers: they have the covariance that was stated and keep within the declared bounds."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.control.pid import PidConfig
from tcs_friction.control.spread import CONTROLLER, FRICTION, INERTIA, Spread, drawn, independent
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance

CONTROL = PidConfig()


def axis() -> Axis:
    friction = instance(law("coulomb_viscous"), {"coulomb": 10.0, "viscous": 1e-3})
    return Axis("axis", 2.0, friction, (instance(effect("torque_bias"), {"bias": 1.0}),))


def test_draws_have_the_covariance_though_the_numbers_are_of_other_magnitudes() -> None:
    names = ((FRICTION, "coulomb"), (FRICTION, "viscous"), INERTIA, ("torque_bias", "bias"))
    size = np.array([0.5, 1e-5, 1e-2, 0.1])
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = -0.8
    correlation[2, 3] = correlation[3, 2] = 0.5
    found = drawn(axis(), CONTROL, Spread(names, correlation * np.outer(size, size)), 4000, 0)
    values = np.array(
        [
            [one.friction.values["coulomb"], one.friction.values["viscous"], one.inertia, one.effects[0].values["bias"]]
            for one, _ in found
        ]
    )
    assert values.mean(axis=0) == pytest.approx([10.0, 1e-3, 2.0, 1.0], rel=0.01)
    assert values.std(axis=0) == pytest.approx(size, rel=0.05)
    assert np.corrcoef(values.T) == pytest.approx(correlation, abs=0.06)


def test_draws_keep_within_bounds() -> None:
    spread = Spread((INERTIA, (FRICTION, "viscous"), (CONTROLLER, "position_proportional")), np.diag([16.0, 1.0, 1e4]))
    for one, controller in drawn(axis(), CONTROL, spread, 200, 0):
        assert one.inertia > 0.0
        assert one.friction.values["viscous"] >= 0.0
        controller.validate()
    wide = Spread(tuple((FRICTION, name) for name in ("coulomb", "viscous")), 1e12 * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    assert all(one.friction.values["coulomb"] >= 0.0 for one, _ in drawn(axis(), CONTROL, wide, 20, 0)), "no draw is within"


def test_a_covariance_that_rounding_made_indefinite_is_drawn_from() -> None:
    covariance = np.array([[1.0, 1.0 + 1e-6], [1.0 + 1e-6, 1.0]])
    found = drawn(axis(), CONTROL, Spread(((FRICTION, "coulomb"), ("torque_bias", "bias")), covariance), 50, 0)
    moved = [one.friction.values["coulomb"] - 10.0 - (one.effects[0].values["bias"] - 1.0) for one, _ in found]
    assert np.all(np.isfinite(moved))
    assert np.max(np.abs(moved)) < 0.02, "they move together"


def test_draws_have_a_seed_and_identities_stay() -> None:
    spread = independent({"torque_bias": {"bias": 0.1}})
    first, again, other = (drawn(axis(), CONTROL, spread, 3, seed) for seed in (1, 1, 2))
    assert [one.effects[0].values for one, _ in first] == [one.effects[0].values for one, _ in again]
    assert [one.effects[0].values for one, _ in first] != [one.effects[0].values for one, _ in other]
    model = axis()
    assert drawn(model, CONTROL, spread, 1, 0)[0][0].effects[0].identity == model.effects[0].identity


def test_of_two_spreads_the_second_one_counts_for_what_both_have() -> None:
    first = Spread((INERTIA, (FRICTION, "coulomb")), np.array([[1.0, 0.5], [0.5, 1.0]]))
    both = first.with_independent(Spread(((FRICTION, "coulomb"), (FRICTION, "viscous")), np.diag([9.0, 4.0])))
    assert both.unknowns == (INERTIA, (FRICTION, "coulomb"), (FRICTION, "viscous"))
    assert both.covariance == pytest.approx(np.diag([1.0, 9.0, 4.0]))
    assert not Spread()
    assert not independent({"torque_bias": {"bias": 0.0}})
    assert both
