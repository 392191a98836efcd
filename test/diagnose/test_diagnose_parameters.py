"""Free numbers of an axis: read, written and moved one at a time within their bounds."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.diagnose.fit.parameters import (
    bound_reached,
    free_parameters,
    moved,
    read_numbers,
    with_numbers,
)
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance

COGGING = instance(effect("cogging"), {"order": 24.0, "amplitude": 0.6, "phase": 1.0})


def axis(*effects: Instance) -> Axis:
    values = {"coulomb": 2.0, "stiffness": 800.0, "viscous": 1.5}
    return Axis("turntable", 1.2, instance(law("dahl_viscous"), values), effects)


def test_free_numbers_go_in_as_they_came_out() -> None:
    subject = axis(COGGING, instance(effect("torque_bias"), {"bias": -0.3}))
    free = free_parameters(subject)
    again = with_numbers(subject, free, read_numbers(subject, free))
    assert again.inertia == pytest.approx(subject.inertia)
    for old, new in zip(subject.effects, again.effects, strict=True):
        assert dict(new.values) == pytest.approx(dict(old.values))


def test_one_number_moves_and_all_others_stay_as_they_are() -> None:
    subject = axis(COGGING, instance(effect("actuator_lag"), {"time_constant": 1e-3}))
    free = free_parameters(subject)
    numbers = read_numbers(subject, free)
    for k, f in enumerate(free):
        after = moved(subject, free, k, f.step)
        assert read_numbers(after, free) == pytest.approx(numbers + f.step * (np.arange(len(free)) == k), rel=1e-9)
        untouched = [item for item in after.effects if item.identity != f.effect]
        assert all(any(item is old for old in subject.effects) for item in untouched)
        assert bound_reached(subject, free, k) == 0
    longest = subject.without_effect(subject.effects[1]).with_effect(subject.effects[1].replace(time_constant=10.0))
    assert bound_reached(longest, free, len(free) - 1) == 1
