"""A log whose torque is out of step with its position: it is found to be that, and nothing is named for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_loop_cases import telescope, telescope_file
from concealed_torque_cases import axis, conditioned

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.timing import LogTiming
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.search.late_log import as_timed
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


@pytest.mark.parametrize(
    ("late", "sure", "held"), [(1e-3, True, False), (-4e-3, True, True), (4e-3, True, True), (4e-3, False, False)]
)
def test_values_are_held_where_their_middle_is_nearer_to_that_of_a_hold(late: float, sure: bool, held: bool) -> None:
    """Logged every 10 ms: the middle of a hold is 5 ms from the stamp, that of a momentary value at it."""
    timing = LogTiming(-5e-3, 5e-3, between=Between.LINE)
    data = replace(conditioned(np.random.default_rng(3), seconds=80.0), timings=(timing,))
    balance = TorqueBalance(data)
    fit = settle(balance, axis(), white_noise(balance.samples), rounds=1)
    asked: list[tuple[LogTiming, ...]] = []

    def prepared(timings: tuple[LogTiming, ...]) -> DataSet:
        asked.append(timings)
        return replace(data, timings=timings)

    told = replace(fit, axis=replace(fit.axis, lateness=late), covariance=(1e-9 if sure else 1e9) * fit.covariance)
    again, _ = as_timed(balance, told, prepared)
    assert (again is balance) is not held
    assert asked == ([(replace(timing, between=Between.HELD),)] if held else [])


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
