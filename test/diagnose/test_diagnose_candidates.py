"""What a joint fit gains, and that noise which an effect feeds on is no gain."""

from __future__ import annotations

from closed_loop_cases import telescope

from tcs_friction.diagnose.dataset.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import fit_jointly, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search.candidates import _gain_where_driven
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance


def test_what_answers_a_torque_that_is_not_logged_is_no_load_dependence() -> None:
    """Noise of the drive moves the axis; the controller answers it with a logged torque that is a multiple of it."""
    recording, believed = telescope(drive_noise=0.87, speed=0.027)
    balance = TorqueBalance(prepare([recording]), believed.actuation_delay)
    base = settle(balance, believed, white_noise(balance.samples))
    item = instance(effect("load_dependent_friction"), {"coefficient": 0.01})
    fit = fit_jointly(balance, base.axis.with_effect(item), base.noise, iterations=10)
    assert base.squares - fit.squares > 50.0
    assert _gain_where_driven(balance, base, fit) < 0.0
