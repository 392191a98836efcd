"""Stand-ins for real logs: the same for the same seed, late where they say so, coupled to the next joint where they say so."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.logged_worlds import COUPLED, KINDS, LATE, MOTIONS, names, world
from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.conditioning.timing import LogTiming
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise


def test_each_kind_has_each_motion() -> None:
    assert len(set(names())) == len(names()) == len(KINDS) * len(MOTIONS)


def test_a_world_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    one, same, other = (world("held-chirp", seed).recording for seed in (1, 1, 2))
    assert (one.torque == same.torque).all()
    assert len(one) != len(other) or (one.torque != other.torque).any()


def test_a_late_torque_is_late_against_the_balance() -> None:
    """The fit moves the logged torque back by what it is late."""
    found = {}
    for name in ("held-chirp", "late-chirp"):
        trial = world(name, 1)
        data = prepare([trial.recording], timings=[LogTiming(0.0, 0.01, False, "", Between.HELD)])
        balance = TorqueBalance(data)
        found[name] = settle(balance, trial.believed.axis, white_noise(balance.samples)).axis.lateness
        assert trial.details["acts"] == (-LATE if name == "late-chirp" else 0.0)
    assert found["held-chirp"] == pytest.approx(0.0, abs=0.2 * LATE)
    assert found["late-chirp"] == pytest.approx(-LATE, abs=0.3 * LATE)


def test_the_next_joint_takes_torque_by_its_acceleration() -> None:
    trial = world("coupled-multisine", 1)
    r = trial.recording
    acceleration = np.gradient(r.exogenous["next_velocity"], r.t)
    size = np.polyfit(acceleration, r.torque, 1)[0] * np.std(acceleration)
    assert size == pytest.approx(COUPLED * np.std(r.torque), rel=0.3)
    assert trial.expected.effects == (("cross_axis_coupling",),)
