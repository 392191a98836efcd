"""A recorded reference: the motion behind its samples, exact, rounded, noisy or held, and its steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tcs_friction.control.recorded_reference import RecordedReference, rest_of
from tcs_friction.control.reference import Reference, Sinusoid, Steps
from tcs_friction.errors import InputError

TRUE = Reference(Sinusoid(amplitude=0.02, period=4.0, duration=12.0))
T = np.arange(0.0, 12.0, 4e-3)
SIZES = np.abs(TRUE.over(T)).max(axis=0)


def away(samples: NDArray[np.float64], t: NDArray[np.float64] = T, rest: float = 0.25) -> NDArray[np.float64]:
    """Rms by which position, speed and acceleration are missed, over the largest of each; without the ends."""
    inner = slice(len(T) // 10, -len(T) // 10)
    found = RecordedReference(t, samples, rest).over(T)[inner]
    return np.asarray(np.sqrt(np.mean((found - TRUE.over(T)[inner]) ** 2, axis=0)) / SIZES)


def test_exact_samples_are_followed_exactly() -> None:
    assert np.all(away(TRUE.over(T)[:, 0]) < [1e-9, 1e-6, 1e-4])
    shifted = RecordedReference(T + 100.0, TRUE.over(T)[:, 0])
    assert shifted.over(T) == pytest.approx(RecordedReference(T, TRUE.over(T)[:, 0]).over(T)), "it begins at time 0"
    assert shifted.duration == pytest.approx(T[-1])


@pytest.mark.parametrize("kind", ["rounded", "noisy", "held"])
def test_what_is_no_motion_is_smoothed_out(kind: str) -> None:
    exact = TRUE.over(T)[:, 0]
    samples = {
        "rounded": np.round(exact / 2e-5) * 2e-5,
        "noisy": exact + 1e-5 * np.random.default_rng(0).standard_normal(len(T)),
        "held": TRUE.over(np.floor(T / 0.02 + 1e-6) * 0.02 + 8e-3)[:, 0],
    }[kind]
    assert np.std(samples - exact) > 4e-6
    missed = away(samples)
    raw = np.std(np.gradient(np.gradient(samples, T), T) - TRUE.over(T)[:, 2]) / SIZES[2]
    assert missed[0] < 1e-3
    assert missed[1] < 0.02
    assert missed[2] < min(0.1, 0.1 * raw)


def test_irregular_stamps_are_no_motion() -> None:
    t = np.sort(T + np.random.default_rng(0).uniform(-1e-3, 1e-3, len(T)))
    t -= t[0]
    assert np.all(away(TRUE.over(t)[:, 0], t) < [1e-6, 1e-4, 1e-2])


def test_steps_are_kept_where_the_loop_settles_between_them() -> None:
    steps = Reference(Steps(height=1e-3, dwell=1.0, duration=9.0))
    t = np.arange(0.0, 9.0, 1e-2)
    kept = RecordedReference(t, steps.over(t)[:, 0], rest_of(20.0)).over(np.arange(0.0, 9.0, 1e-3))
    assert set(np.unique(kept[:, 0])) == {0.0, 1e-3}
    assert not kept[:, 1:].any()
    smooth = RecordedReference(t, steps.over(t)[:, 0], rest_of(0.5)).over(t)
    assert smooth[:, 1].any(), "a slow loop takes the same for a motion"
    assert rest_of(0.0) == math.inf


def test_a_slow_motion_in_coarse_counts_is_a_motion() -> None:
    t = np.arange(0.0, 20.0, 1e-2)
    found = RecordedReference(t, np.floor(1e-3 * t / 1e-4) * 1e-4, rest_of(20.0)).over(t[200:-200])
    assert found[:, 1] == pytest.approx(1e-3, rel=0.2)


def test_before_and_after_it_holds_and_a_constant_is_one() -> None:
    found = RecordedReference(T, TRUE.over(T)[:, 0]).over([-1.0, 20.0])
    assert found[:, 0] == pytest.approx(TRUE.over([0.0, T[-1]])[:, 0])
    assert not found[:, 1:].any()
    for samples in (np.full(len(T), 0.3), np.array([0.3, 0.3]), np.array([0.3, 0.3, 0.3])):
        still = RecordedReference(T[: len(samples)], samples).over([0.0, 1.0])
        assert still == pytest.approx(np.array([[0.3, 0.0, 0.0]] * 2))
    with pytest.raises(InputError, match="1 samples of a reference, expected at least 2"):
        RecordedReference([0.0], [1.0])
