"""When a logged torque acts: as stated, or within what conventions of stamping allow; and what conditioning makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.conditioning.timing import LogTiming, TorqueActs, log_timing
from tcs_friction.recording.recording import Recording

PERIOD = 4e-3
T = np.arange(0.0, 20.0, PERIOD)
RATE = 2.0 * np.pi * 3.0  # rad/s, of the torque


def recording(torque: np.ndarray, acts: float | None = None, position: np.ndarray | None = None) -> Recording:
    """It moves in a band of some 20 Hz."""
    moved = gaussian_filter1d(np.random.default_rng(1).standard_normal(len(T)), 2.0) if position is None else position
    return Recording(T, moved, torque, acts=acts)


def phase(torque: np.ndarray, t: np.ndarray) -> float:
    """s by which a wave is late."""
    inside = (t > 2.0) & (t < 18.0)
    turn = np.exp(-1j * RATE * t[inside]) * np.hanning(np.count_nonzero(inside))
    return float(-np.angle(1j * np.sum(turn * torque[inside])) / RATE)


@pytest.mark.parametrize(("acts", "late"), [(None, 0.0), (0.0, 0.5 * PERIOD), (-PERIOD, -0.5 * PERIOD), (-0.012, -0.01)])
def test_torque_is_what_its_hold_makes_of_it(acts: float | None, late: float) -> None:
    """A held value lags by half of its hold, and the hold attenuates by the sine cardinal; a momentary value does neither."""
    (stretch,) = prepare([recording(np.sin(RATE * T), acts)]).stretches
    assert phase(stretch.torque, stretch.t) == pytest.approx(late, abs=2e-5)
    inside = (stretch.t > 2.0) & (stretch.t < 18.0)
    size = np.sqrt(2.0) * np.std(stretch.torque[inside])
    assert size == pytest.approx(1.0 if acts is None else np.sinc(RATE * PERIOD / (2.0 * np.pi)), abs=2e-4)


def test_what_stamps_may_mean_is_one_renewal_of_the_torque() -> None:
    every_third = np.sin(RATE * T)[np.arange(len(T)) // 3 * 3]
    momentary, repeated = log_timing(recording(np.sin(RATE * T))), log_timing(recording(every_third))
    assert (momentary.acts, momentary.leeway) == (pytest.approx(-0.5 * PERIOD), pytest.approx(0.5 * PERIOD))
    assert momentary.between is Between.LINE
    assert repeated.leeway == pytest.approx(1.5 * PERIOD)
    assert repeated.between is Between.HELD, "the log repeats each value"
    stated = log_timing(recording(every_third, -1e-3))
    assert (stated.acts, stated.leeway, stated.stated) == (-1e-3, 0.0, True)
    own = replace(recording(every_third), torque_log=np.array([T, every_third]))
    assert log_timing(own).own_clock


def test_of_a_position_that_is_renewed_every_third_sample_the_new_ones_count() -> None:
    whole = recording(np.sin(RATE * T))
    stale = recording(np.sin(RATE * T), position=whole.position[np.arange(len(T)) // 3 * 3])
    data = prepare([stale])
    assert data.period == pytest.approx(3.0 * PERIOD)
    assert data.nyquist == pytest.approx(0.5 / (3.0 * PERIOD))
    assert f"above {data.nyquist:.4g} Hz are not named" in " ".join(data.notes)
    assert prepare([whole]).nyquist == pytest.approx(0.5 / PERIOD)


def test_what_is_known_of_the_timing_is_said() -> None:
    free, stated = LogTiming(-2e-3, 2e-3), LogTiming(-1e-3, 0.0)
    held = TorqueActs(-3.5e-3, 1e-4, True, free)
    assert held.words == "the logged torque is held and begins to act -3.5 ± 0.1 ms after its stamp"
    momentary = TorqueActs(-1.5e-3, 1e-4, True, replace(free, between=Between.LINE))
    assert momentary.words == "the logged torque is momentary and acts 0.5 ± 0.1 ms after its stamp"
    assert TorqueActs(-8e-3, 1e-4, True, free).words.endswith("the log is out of step")
    assert "anywhere within 4 ms before its stamp" in TorqueActs(-2e-3, 1e-3, False, free).words
    assert TorqueActs(-1e-3, 0.0, True, stated).words.endswith("-1 ms after its stamp on, as stated")
    told = TorqueActs(-3.5e-3, 1e-4, True, free).to_mapping()
    assert told == {"recording": "recording", "acts": -3.5e-3, "std": 1e-4, "stated": False, "determined": True}
