"""Recordings of ordinary operation: little acceleration, few reversals, a controller that answers noise. Nothing is made up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from closed_loop_cases import telescope_file

from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

SWING = {"kind": "sinusoid", "amplitude": 0.0668, "period": 40.0, "duration": 90.0}
MOTIONS = {
    "swing": SWING,
    "small swing": {"kind": "sinusoid", "amplitude": 0.003, "period": 10.0, "duration": 60.0},
    "pass": {"kind": "sinusoid", "amplitude": 0.5, "period": 240.0, "duration": 120.0, "phase": -1.5},
    "sidereal tracking": {"kind": "constant_speed", "velocity": 7.3e-5, "duration": 60.0},
}


def recorded(motion: dict[str, Any], seed: int, **effects: dict[str, float]) -> tuple[Recording, Axis]:
    """The telescope in its controller with these effects, and its axis without."""
    file = telescope_file()
    assert file.control is not None
    plain = replace(file.axis, effects=())
    axis = replace(plain, effects=tuple(instance(effect(name), values) for name, values in effects.items()))
    control = (file.control.controller, file.control.loop, file.control.observer, file.control.compensator)
    run = simulate_loop(axis, reference_from_mapping(motion, "motion"), *control, seed)
    return Recording(run.t, run.position, run.torque, source="simulated"), plain


def diagnosed(motion: dict[str, Any], seed: int, **effects: dict[str, float]) -> Diagnosis:
    """Of that recording, where none of the effects is known."""
    recording, plain = recorded(motion, seed, **effects)
    return diagnose([recording], telescope_file().with_axis(plain))


@pytest.mark.parametrize("name", MOTIONS)
def test_an_axis_that_is_as_believed_is_said_to_be(name: str) -> None:
    found = diagnosed(MOTIONS[name], 10)
    assert found.effects == ()
    assert found.verdict == "match", found.statement


def test_a_spring_that_no_inertia_explains_is_named_on_a_swing() -> None:
    found = diagnosed(SWING, 3, cable_wrap={"stiffness": 100.0})
    (one,) = found.effects
    assert "cable_wrap" in {one.effect, *(kind.effect for kind in one.equivalent)}
    assert found.axis_file.axis.inertia == pytest.approx(1000.0, rel=0.02)


def test_cogging_that_feigns_another_inertia_is_named_alone_on_a_swing() -> None:
    """Retuned without the cogging, the inertia is far off. Springs would mend the believed one, which is off by a tenth."""
    swing = {"kind": "sinusoid", "amplitude": 0.3, "period": 60.0, "duration": 120.0}
    recording, plain = recorded(swing, 3, cogging={"order": 72.0, "amplitude": 60.0, "phase": 1.0})
    shares: list[float] = []
    found = diagnose(
        [recording], telescope_file().with_axis(replace(plain, inertia=900.0)), lambda share, _: shares.append(share)
    )
    assert [one.effect for one in found.effects] == ["cogging"]
    assert found.axis_file.axis.inertia == pytest.approx(1000.0, rel=0.01)
    assert shares == sorted(shares), "the search was made twice, and its progress does not go back"
