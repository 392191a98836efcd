"""What a joint fit gains, and that noise which an effect feeds on is no gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from closed_loop_cases import telescope

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import fit_jointly, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search.candidates import _gain_where_driven
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance


def test_what_answers_a_torque_that_is_not_logged_is_no_load_dependence() -> None:
    """Noise of the drive moves the axis; the controller answers it with a logged torque that is a multiple of it."""
    recording, believed = telescope(drive_noise=0.87, speed=0.027)
    balance = TorqueBalance(prepare([recording]))
    base = settle(balance, believed, white_noise(balance.samples))
    item = instance(effect("load_dependent_friction"), {"coefficient": 0.01})
    fit = fit_jointly(balance, base.axis.with_effect(item), base.noise, iterations=10)
    assert base.squares - fit.squares > 50.0
    assert _gain_where_driven(balance, base, fit, fit.axis.effects[-1]) < 0.0


def test_noise_of_the_logged_torque_that_a_lag_takes_away_is_no_gain() -> None:
    recording, believed = telescope(drive_noise=0.3, speed=0.027)
    noise = np.random.default_rng(5).standard_normal(len(recording.t))
    noisy = replace(recording, torque=recording.torque + 10.0 * noise)
    balance = TorqueBalance(prepare([noisy]))
    base = settle(balance, believed, white_noise(balance.samples))
    item = instance(effect("actuator_lag"), {"time_constant": 3e-3})
    fit = fit_jointly(balance, base.axis.with_effect(item), base.noise, iterations=10)
    assert base.squares - fit.squares > 500.0
    assert _gain_where_driven(balance, base, fit, fit.axis.effects[-1]) < 0.0


def test_what_a_delay_explains_where_the_torque_is_driven_is_its_gain() -> None:
    recording, believed = telescope(drive_noise=0.3, speed=0.027)
    early = replace(recording, torque=np.interp(recording.t + 0.02, recording.t, recording.torque))
    balance = TorqueBalance(prepare([early]))
    base = settle(balance, believed, white_noise(balance.samples))
    item = instance(effect("transport_delay"), {"delay": 0.02})
    fit = fit_jointly(balance, base.axis.with_effect(item), base.noise, iterations=10)
    gained = base.squares - fit.squares
    assert gained > 1000.0
    assert _gain_where_driven(balance, base, fit, fit.axis.effects[-1]) > 0.5 * gained
