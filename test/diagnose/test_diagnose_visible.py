"""What a diagnosis could have seen: its band, its share of the data, the size of effects, and what is no verdict."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.outcome.conclusion import conclude
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.visible import FOUND, visible
from tcs_friction.diagnose.remainder.maps import Structure


@pytest.fixture(scope="module")
def plain() -> tuple[TorqueBalance, Fit]:
    return settled(conditioned(np.random.default_rng(3), seconds=80.0))


def test_a_torque_is_seen_from_what_it_does_to_the_noise_on(plain: tuple[TorqueBalance, Fit]) -> None:
    """A constant torque beside noise of one level: standard deviations of its mean over independent samples."""
    balance, fit = plain
    found = visible(balance, fit, {"imbalance"}, 0.01)
    assert found.band == balance.data.cutoff
    assert found.share == pytest.approx(float(np.mean(balance.train | balance.held_out)))
    assert "imbalance" not in found.sizes, "the data cannot carry it"
    assert not {"flexible_mode", "backlash", "transport_delay", "encoder_periodic_error"} & set(found.sizes)
    left = rms(balance.residual(fit.axis, fit.noise)[balance.train])
    least = FOUND * left / np.sqrt(balance.samples.effective_count)
    assert 0.7 * least < found.sizes["torque_bias"] < 3.0 * least
    assert 0.7 * least < min(found.sizes.values()), "what friction can stand for is seen later still"


def test_noise_twice_as_large_hides_torques_twice_as_large(plain: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = plain
    data = conditioned(np.random.default_rng(3), lambda m: 0.52 * np.random.default_rng(4).standard_normal(len(m.t)), 80.0)
    louder = visible(*settled(data), frozenset(), 0.0).sizes["torque_bias"]
    assert louder > 1.3 * visible(balance, fit, frozenset(), 0.0).sizes["torque_bias"]


@pytest.mark.parametrize(("tolerance", "said"), [(0.0, True), (0.1, False)])
def test_a_remainder_within_the_tolerance_is_no_verdict(plain: tuple[TorqueBalance, Fit], tolerance: float, said: bool) -> None:
    balance, fit = plain
    structure = Structure(("position",), 1e-9, 0.5, 0.5, None, None)
    found = conclude(balance, AxisFile(axis()), Explanation(fit, fit, fit, structure), tolerance)
    assert found.unexplained.present is said
    assert found.unexplained.torque_rms == pytest.approx(0.5, rel=0.2)
    assert (found.verdict == "unexplained") is said
