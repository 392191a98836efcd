"""A log whose torque is out of step with its position: it is found to be that, and nothing is named for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope, telescope_file

from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

PERIOD = 1e-3  # s; the log has the torque that acted up to its stamp
LATE = 4  # samples


def logged_late(recording: Recording) -> Recording:
    return replace(recording, torque=np.concatenate([recording.torque[:1].repeat(LATE), recording.torque[:-LATE]]))


def diagnosed(recording: Recording) -> Diagnosis:
    file = telescope_file()
    return diagnose([recording], file.with_axis(replace(file.axis, effects=())))


def test_a_late_log_is_no_physics() -> None:
    recording, _ = telescope(drive_noise=0.05, speed=0.01, duration=100.0)
    found = diagnosed(logged_late(recording))
    (acts,) = found.timing
    assert not found.effects
    assert found.verdict == "match"
    assert acts.acts == pytest.approx(-(1 + LATE) * PERIOD, abs=0.2e-3)
    assert not acts.usual
    assert "the log is out of step" in " ".join(found.evidence.notes)
    signals = found.axis_file.signals
    assert signals is not None
    assert signals.torque.acts == pytest.approx(acts.acts)


def test_what_is_stated_is_used() -> None:
    recording, _ = telescope(drive_noise=0.05, speed=0.01, duration=200.0)
    found = diagnosed(replace(logged_late(recording), acts=-(1 + LATE) * PERIOD))
    assert found.verdict == "match"
    assert found.timing[0].to_mapping() | {"recording": ""} == {
        "recording": "",
        "acts": -(1 + LATE) * PERIOD,
        "std": 0.0,
        "stated": True,
        "determined": True,
    }


def test_a_delay_beyond_what_stamps_may_mean_is_named_with_what_looks_like_it() -> None:
    late = instance(effect("transport_delay"), {"delay": 6e-3})
    recording, _ = telescope(drive_noise=0.05, speed=0.027, effects=(late,), duration=60.0)
    found = diagnosed(recording)
    (one,) = found.effects
    delay = one.parameters["delay"]
    assert one.effect == "transport_delay"
    assert delay["std"] >= 0.5 * PERIOD / np.sqrt(3.0)
    assert delay["value"] == pytest.approx(6e-3, abs=2.0 * delay["std"])
    assert "stamped as much too early, which look alike" in found.statement
