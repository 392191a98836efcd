"""The 1.2 m telescope's azimuth axis: the paper's errors without compensation, the bars with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.config import load_axis
from tcs_friction.control.compensator import LugreParameters
from tcs_friction.control.loop import LoopRun, simulate_loop, without_friction
from tcs_friction.control.reference import load_reference
from tcs_friction.control.tracking import ARCSEC, TrackingErrors, tracking_errors

CONFIG = Path(__file__).resolve().parents[2] / "config"
FILE = load_axis(CONFIG / "azimuth_1p2m.yaml")
RUN = load_reference(CONFIG / "azimuth_1p2m_run.yaml")
assert FILE.control is not None
CONTROL = FILE.control
SETTLE = 3.0


def run(
    compensation: str, feed_back: bool, seed: int, scales: np.ndarray | None = None, free: bool = False
) -> LoopRun:
    told = CONTROL.compensator.positive.packed()
    if scales is not None:
        told = tuple(float(x) for x in scales * told)
    friction = LugreParameters(*told)
    return simulate_loop(
        without_friction(FILE.axis) if free else FILE.axis,
        RUN,
        CONTROL.controller,
        replace(CONTROL.loop, compensation=compensation, feed_back=feed_back),
        CONTROL.observer,
        replace(CONTROL.compensator, positive=friction, negative=friction),
        seed,
    )


def errors(loop: LoopRun) -> TrackingErrors:
    return tracking_errors(loop.t, loop.reference_velocity, loop.error / ARCSEC, SETTLE)


def worst(result: TrackingErrors) -> float:
    return max(result.peak_positive, -result.peak_negative)


def relative_error(loop: LoopRun, late: float = 0.0) -> float:
    keep = (loop.t > SETTLE) & (loop.t < loop.t[-1] - 0.1)
    estimate = np.interp(loop.t[keep] + late, loop.t, loop.friction_estimate)
    return float(np.sqrt(np.mean((estimate - loop.friction[keep]) ** 2) / np.mean(loop.friction[keep] ** 2)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_errors_without_compensation_are_the_papers(seed: int) -> None:
    before = errors(run("none", False, seed))
    assert before.reversals == 4
    assert before.peak_positive == pytest.approx(0.8926, rel=0.1)
    assert before.peak_negative == pytest.approx(-0.8881, rel=0.1)
    assert before.rms == pytest.approx(0.1155, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_lugre_with_observer_meets_the_bars(seed: int) -> None:
    before, after = errors(run("none", False, seed)), errors(run("lugre", True, seed))
    ideal = errors(run("none", False, seed, free=True))
    assert worst(after) <= min(0.15, 0.12 * worst(before))
    assert after.rms <= min(0.05, 0.4 * before.rms, 1.5 * ideal.rms)


@pytest.mark.parametrize("seed", [0, 1])
def test_parameters_five_percent_off_still_help(seed: int) -> None:
    before = errors(run("none", False, seed))
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 6)
    for scales in (1.0 + 0.05 * signs, 1.0 - 0.05 * signs):
        after = errors(run("lugre", True, seed, scales))
        assert worst(after) <= 0.2 * worst(before)
        assert after.rms <= 0.5 * before.rms


@pytest.mark.parametrize(("compensation", "feed_back"), [("none", False), ("none", True), ("lugre", True)])
def test_observer_measures_friction_within_three_percent(compensation: str, feed_back: bool) -> None:
    loop = run(compensation, feed_back, 0)
    assert relative_error(loop) < 0.03
    assert relative_error(loop, CONTROL.observer.filter_delay) < 0.008


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_loop_bears_a_wrong_inertia(share: float) -> None:
    axis = replace(FILE.axis, inertia=share * FILE.axis.inertia)
    loop = simulate_loop(
        axis, RUN, CONTROL.controller, replace(CONTROL.loop, feed_back=True), CONTROL.observer
    )
    assert worst(errors(loop)) < 0.5


def test_kalman_observer_serves_in_the_same_place() -> None:
    observer = replace(CONTROL.observer, estimator="kalman")
    loop = simulate_loop(FILE.axis, RUN, CONTROL.controller, replace(CONTROL.loop, feed_back=True), observer)
    assert relative_error(loop, observer.filter_delay) < 0.01
    assert worst(errors(loop)) < worst(errors(run("none", True, 0)))
