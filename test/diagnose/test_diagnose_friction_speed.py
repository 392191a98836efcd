"""Friction against speed of a diagnosis: the true friction, whatever else acts on the axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.outcome.friction_speed import friction_by_speed
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

COGGING = instance(effect("cogging"), {"order": 30.0, "amplitude": 8.0, "phase": 0.0})


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    return settled(conditioned(np.random.default_rng(3), lambda m: 8.0 * np.cos(30.0 * m.q), seconds=150.0))


def test_points_are_the_true_friction_when_other_effects_are_known(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    improved = replace(fit, axis=replace(axis(), effects=(COGGING,)))
    believed = axis().with_friction({"coulomb": 50.0, "viscous": 500.0})
    axes = {"believed": believed, "retuned": fit.axis, "improved": improved.axis}
    found = friction_by_speed(balance, improved, axes)
    assert found is not None
    true = 60.0 * np.sign(found.speed) + 500.0 * found.speed
    std = found.models["improved"].std
    assert std is not None
    fast = np.abs(found.speed) > 1e-3  # the filter rounds the jump at rest
    assert fast.sum() > 40
    assert (np.abs(found.measured - true)[fast] < 5.0 * np.hypot(found.error, std)[fast] + 0.02).all()
    np.testing.assert_allclose(np.abs(found.residual("believed"))[fast], 10.0, atol=1.0)
    wrong = friction_by_speed(balance, replace(fit, axis=axis()), {**axes, "improved": axis()})
    assert wrong is not None
    assert np.median(wrong.scatter) > 2.0 * np.median(found.scatter), "without cogging in the model it is in the points"


def test_an_axis_that_rests_has_no_friction_against_speed(fitted: tuple[TorqueBalance, Fit]) -> None:
    data = conditioned(np.random.default_rng(3), seconds=40.0)
    still = replace(data, stretches=tuple(replace(s, resting=np.ones(len(s.t), bool)) for s in data.stretches))
    fit = fitted[1]
    assert friction_by_speed(TorqueBalance(still), fit, {"improved": fit.axis}) is None
