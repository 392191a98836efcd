"""Torque in bins of speed: means, errors that are as large as they say, and both ways of a hysteresis."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.numerics.by_speed import (
    TorqueBySpeed,
    correlated_samples,
    linear_std,
    speed_bins,
    torque_by_speed,
)
from tcs_friction.numerics.envelope import envelope

T = np.arange(0.0, 200.0, 0.01)
VELOCITY = 0.1 * np.sin(0.7 * T) * np.exp(-3.0 * np.sin(0.05 * T) ** 2)
RESOLUTION = 1e-5


def stribeck(velocity: np.ndarray) -> np.ndarray:
    return np.sign(velocity) * (60.0 + 30.0 * np.exp(-((velocity / 1e-3) ** 2))) + 500.0 * velocity


def found(noise: np.ndarray) -> TorqueBySpeed:
    true = stribeck(VELOCITY)
    return torque_by_speed(speed_bins(VELOCITY, RESOLUTION), VELOCITY, true + noise, {"law": true}, {}, "law")


def test_points_are_the_torque_at_their_speed() -> None:
    result = found(np.zeros(len(T)))
    narrow = np.abs(result.speed) > 3e-3  # where a bin is narrow against the curve
    np.testing.assert_allclose(result.measured[narrow], stribeck(result.speed[narrow]), rtol=0.01)
    np.testing.assert_allclose(result.residual("law"), 0.0, atol=1e-9)
    assert result.speed.min() == pytest.approx(VELOCITY.min(), rel=0.05)
    assert result.speed.max() == pytest.approx(VELOCITY.max(), rel=0.05)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_means_miss_the_truth_by_as_much_as_their_errors_say(memory: float) -> None:
    rng = np.random.default_rng(0)
    missed = []
    for _ in range(20):
        noise = rng.standard_normal(len(T))
        if memory:
            for k in range(1, len(noise)):
                noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory**2) * noise[k]
        result = found(2.0 * noise)
        missed.append(result.residual("law") / result.error)
    assert 0.8 < np.std(np.concatenate(missed)) < 1.25


def test_no_bin_reaches_across_zero_and_each_way_is_in_order() -> None:
    result = found(np.zeros(len(T)))
    assert (np.sign(result.measured) == np.sign(result.speed)).all()
    for way in (True, False):
        assert (np.diff(result.speed[result.speeding_up == way]) > 0.0).all()


def test_a_hysteresis_shows_as_two_branches() -> None:
    acceleration = np.gradient(VELOCITY, T)
    torque = np.where(VELOCITY * acceleration > 0.0, 1.0, -1.0)
    result = torque_by_speed(speed_bins(VELOCITY, RESOLUTION), VELOCITY, torque, {"none": 0.0 * T}, {}, "none")
    fast = np.abs(result.speed) < 0.03  # at the top it is neither for a few samples
    assert result.measured[result.speeding_up & fast].mean() > 0.9
    assert result.measured[~result.speeding_up & fast].mean() < -0.9


def test_noise_of_the_acceleration_does_not_sort_the_samples() -> None:
    rng = np.random.default_rng(1)
    velocity = np.where(T < 100.0, 0.05, -0.05) + 1e-5 * rng.standard_normal(len(T))
    torque = -1e3 * np.gradient(velocity, T)  # of a measured acceleration, which is all noise
    result = torque_by_speed(speed_bins(velocity, 1e-4), velocity, torque, {"none": 0.0 * T}, {}, "none")
    assert len(result.speed)
    assert (np.abs(result.measured) < 4.0 * result.error).all()


def test_samples_that_do_not_count_and_rest_are_in_no_bin() -> None:
    velocity = VELOCITY.copy()
    velocity[:1000] = 0.0
    counted = T < 150.0
    bins = speed_bins(velocity, RESOLUTION, counted)
    assert (bins.index[:1000] == -1).all()
    assert (bins.index[~counted] == -1).all()
    assert bins.count == bins.index.max() + 1


def test_without_motion_there_are_no_bins() -> None:
    assert speed_bins(np.zeros(100), RESOLUTION).count == 0


def test_neighbours_that_are_alike_count_as_one() -> None:
    white = np.random.default_rng(2).standard_normal(40_000)
    assert correlated_samples(white) == pytest.approx(1.0, abs=0.2)
    assert correlated_samples(np.repeat(white[:4000], 10)) == pytest.approx(10.0, rel=0.2)
    assert correlated_samples(np.zeros(50)) == 1.0


def test_a_models_error_follows_from_those_of_its_parameters() -> None:
    bins = speed_bins(VELOCITY, RESOLUTION)
    derivatives = np.stack([np.sign(VELOCITY), VELOCITY], axis=1)
    covariance = np.array([[4.0, -3.0], [-3.0, 9.0]])
    std = linear_std(bins, derivatives, covariance)
    speed = np.abs(bins.mean(VELOCITY))
    np.testing.assert_allclose(std, np.sqrt(4.0 - 6.0 * speed + 9.0 * speed**2), rtol=1e-9)


def test_an_envelope_keeps_peaks_gaps_and_ends() -> None:
    y = np.sin(np.arange(50_000.0))
    y[31_415], y[20_000:20_100] = 7.0, np.nan
    kept = envelope(y, 1000)
    assert len(kept) <= 1002
    assert np.nanmax(y[kept]) == 7.0
    assert np.isnan(y[kept]).any()
    assert (kept[0], kept[-1]) == (0, len(y) - 1)
