"""Whole diagnoses of a closed loop with noise that nobody logs: nothing is named for it, nor for alignment or history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope, telescope_file
from concealed_torque_cases import conditioned, settled, unfitted

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile
from tcs_friction.diagnose import pipeline
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.pipeline import _explanation, _inertia_lost, diagnose
from tcs_friction.diagnose.remainder.remainder import remainder_of
from tcs_friction.diagnose.search.stepwise import Selection
from tcs_friction.errors import InputError
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording


def test_nothing_is_named_for_a_torque_that_is_not_logged() -> None:
    recording, plant = telescope(drive_noise=0.87, speed=0.027)
    assert diagnose([recording], telescope_file().with_axis(plant)).verdict == "match"


def test_a_run_that_begins_away_from_its_reference_matches() -> None:
    """Full torque one way, then the other, within the first half second."""
    recording, plant = telescope(drive_noise=0.2, speed=0.003, start=0.0, away=0.01)
    assert np.abs(recording.torque).max() == plant.drive.limit
    assert diagnose([recording], telescope_file().with_axis(plant)).verdict == "match"


def test_an_inertia_that_the_recording_does_not_tell_is_lost_only_far_from_the_believed_one() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(3), seconds=60.0))

    def lost(factor: float, believed: float) -> bool:
        chosen = unfitted(balance, replace(fit.axis, inertia=factor * fit.axis.inertia), fit.noise)
        known = replace(fit.axis, inertia=believed * fit.axis.inertia)
        return _inertia_lost(balance, Selection(fit, fit, chosen), known)

    assert lost(1e-6, 1.0)
    assert not lost(1e-6, 1e-6), "as believed"
    assert not lost(100.0, 1.0), "its torque shows"


def test_alignment_is_no_wrong_parameter() -> None:
    """A log that has the torque which acted up to its stamp; the plant's own delay is stated and stays what it was."""
    recording, plant = telescope(drive_noise=0.05, speed=0.01)
    found = diagnose([recording], telescope_file().with_axis(plant))
    assert found.axis_file.axis.actuation_delay == plant.actuation_delay
    (acts,) = found.timing
    assert acts.acts == pytest.approx(-1e-3, abs=0.15e-3)
    assert acts.determined
    assert acts.usual
    late = acts.acts - acts.timing.acts
    assert found.believed.held_out > 1.5 * found.retuned.held_out
    assert found.verdict == "match"
    assert f"acts {-1e3 * late:.2g} ms earlier than stated" in found.statement


def test_nothing_but_what_is_stated_depends_on_untouched_data() -> None:
    """A torque that is wrong there changes no number of the model, no name, no verdict."""
    recording, plant = telescope(drive_noise=0.05, speed=0.01)
    data = prepare([recording], untouched=True)
    t = data.joined("t")[data.untouched]
    wrong = np.where((recording.t > t[0]) & (recording.t < t[-1]), 3.0, 1.0)
    file = telescope_file().with_axis(plant)
    found, other = (diagnose([one], file) for one in (recording, replace(recording, torque=wrong * recording.torque)))
    assert other.improved.untouched is not None
    assert found.improved.untouched is not None
    assert other.improved.untouched > 10.0 * found.improved.untouched
    assert other.verdict == found.verdict == "match"
    assert any("untouched data" in line for line in other.limits)
    assert other.limits[:-1] == found.limits
    assert other.improved.held_out == pytest.approx(found.improved.held_out, rel=1e-3)
    assert other.axis_file.axis.inertia == pytest.approx(found.axis_file.axis.inertia, rel=1e-6)
    assert other.free_run["improved"] > 10.0 * found.free_run["improved"]


def test_friction_before_a_recording_is_not_held_against_the_model() -> None:
    """It begins at a reversal, the bristles bent by where the axis came from."""
    recording, plant = telescope(drive_noise=0.05, speed=0.01)
    ways = np.sign(np.diff(recording.position[::100]))
    turns = 100 * (1 + np.flatnonzero(ways[1:] * ways[:-1] < 0.0))
    part = recording.part(slice(turns[0], len(recording)))
    wrong = TorqueBalance(prepare([part]))
    right = TorqueBalance(prepare([part], memory=10.0 * plant.bristle))
    assert np.abs(wrong.residual(plant, white_noise(wrong.samples))[wrong.train]).max() > 10.0
    assert np.abs(right.residual(plant, white_noise(right.samples))[right.train]).max() < 1.0
    assert diagnose([part], telescope_file().with_axis(plant)).verdict == "match"


def test_a_recording_without_motion_is_refused() -> None:
    t = np.arange(0.0, 10.0, 1e-2)
    with pytest.raises(InputError, match="position never changes"):
        diagnose([Recording(t, np.zeros(len(t)), np.sin(t))], AxisFile(telescope_file().axis))


def test_what_remains_is_asked_of_the_effects_that_won_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """A load step wins the place of nothing: what remained without it is no longer there."""
    step = instance(effect("load_step"), {"step": 1.5, "time": 40.37})
    balance, plain = settled(conditioned(np.random.default_rng(1), lambda m: 1.5 * (m.t > 40.37), seconds=80.0))
    won = settle(balance, plain.axis.with_effect(step), plain.noise, rounds=1)
    left = remainder_of(balance, plain, plain)
    assert left.structure is not None
    monkeypatch.setattr(pipeline, "contested", lambda *_: (won, ()))
    selection = Selection(plain, plain, plain)
    assert _explanation(balance, plain.axis, selection, left, lambda *_: None).structure is None
