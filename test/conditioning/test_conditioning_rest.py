"""Where friction without memory is unknown: at rest, at reversals, below the noise of the speed."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.conditioning.rest import AROUND_REVERSAL, unknown_friction
from tcs_friction.recording.recording import Recording

DT, CUTOFF, NOISE = 1e-3, 20.0, 1e-8


def test_an_axis_that_moves_one_way_never_rests() -> None:
    t = DT * np.arange(5000)
    assert not unknown_friction(0.01 * t, np.full(len(t), 0.01), DT, CUTOFF, NOISE, 1e-5).any()


def test_a_halt_is_rest_and_its_noise_is_no_motion() -> None:
    t = DT * np.arange(6000)
    velocity = np.where((t > 2.0) & (t < 4.0), 0.0, 0.01)
    position = np.cumsum(velocity) * DT + NOISE * np.random.default_rng(0).standard_normal(len(t))
    unknown = unknown_friction(position, velocity, DT, CUTOFF, NOISE, 1e-5)
    assert unknown[(t > 2.1) & (t < 3.9)].all()
    assert not unknown[(t < 1.8) | (t > 4.2)].any()


def test_so_long_around_a_reversal_it_is_unknown() -> None:
    t = DT * np.arange(10_000)
    velocity = 0.1 * np.cos(2.0 * np.pi * 0.25 * t)
    position = np.cumsum(velocity) * DT
    unknown = unknown_friction(position, velocity, DT, CUTOFF, NOISE, 1e-9)
    near = np.min(np.abs(t[:, None] - np.array([1.0, 3.0, 5.0, 7.0, 9.0])), axis=1)
    assert unknown[near < 0.9 * AROUND_REVERSAL / CUTOFF].all()
    assert not unknown[near > 0.02 + AROUND_REVERSAL / CUTOFF].any()


@pytest.mark.parametrize("at_rest", [True, False])
def test_nothing_is_compared_where_it_is_unknown(at_rest: bool) -> None:
    t = DT * np.arange(40_000)
    velocity = 0.02 * np.clip(2.0 * np.sin(2.0 * np.pi * 0.1 * t), -1.0, 1.0)
    velocity[(t > 12.0) & (t < 16.0)] = 0.0
    rng = np.random.default_rng(1)
    position = np.cumsum(velocity) * DT + 1e-7 * rng.standard_normal(len(t))
    torque = 500.0 * velocity + 60.0 * np.sign(velocity) + rng.standard_normal(len(t))
    data = prepare([Recording(t, position, torque)], at_rest=at_rest)
    still = (data.joined("t") > 12.5) & (data.joined("t") < 15.5)
    assert data.resting[still].all() != at_rest
    assert not (data.resting & (data.train | data.held_out)).any()
