"""The noise model: frozen, its whitening its own adjoint, and squares that compare under one model only."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from concealed_torque_cases import axis, coloured, conditioned, settled

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, under
from tcs_friction.diagnose.fit.noise import Squares, white_noise
from tcs_friction.diagnose.fit.noise_estimate import estimated, misfit, noise_floor


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    return settled(conditioned(np.random.default_rng(1)))


def test_a_noise_model_is_frozen(fitted: tuple[TorqueBalance, Fit]) -> None:
    noise = fitted[1].noise
    for one, name in ((noise, "whitening"), (noise.whitening, "weights"), (noise.samples, "rows"), (noise.bias, "whole")):
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, None)


def test_squares_compare_under_one_noise_model_only(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    heavier = replace(fit.axis, inertia=1.1 * fit.axis.inertia)
    assert balance.squares(heavier, fit.noise) - fit.squares > 0.0
    assert fit.squares - balance.squares(heavier, fit.noise) < 0.0
    other = estimated(balance, heavier, fit.noise)
    for one, two in ((balance.squares(heavier, other), fit.squares), (fit.squares, balance.squares(fit.axis, other))):
        with pytest.raises(ValueError, match="different noise models"):
            one - two
    assert under(balance, fit, other).squares - balance.squares(heavier, other) != 0.0
    assert under(balance, fit, other).noise is other


def test_even_an_equal_model_is_another_one(fitted: tuple[TorqueBalance, Fit]) -> None:
    """A model is what a fit was made under; two that happen to agree have not been compared."""
    balance, fit = fitted
    with pytest.raises(ValueError, match="different noise models"):
        fit.squares - balance.squares(fit.axis, replace(fit.noise))


def test_dispersion_is_squares_per_independent_sample_and_at_least_one(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    count = balance.samples.effective_count
    assert Squares(3.0 * count, fit.noise).dispersion == pytest.approx(3.0)
    assert Squares(0.5 * count, fit.noise).dispersion == 1.0


@pytest.mark.parametrize("local", [False, True])
def test_whitening_is_its_own_adjoint(fitted: tuple[TorqueBalance, Fit], local: bool) -> None:
    balance, fit = fitted
    rng = np.random.default_rng(2)
    count, rows = len(balance.train), len(balance.samples.rows)
    noise = replace(fit.noise, local_weight=rng.uniform(0.2, 1.0, count)) if local else fit.noise
    x, white = rng.standard_normal(count), rng.standard_normal(rows)
    assert white @ noise.whiten(x) == pytest.approx(noise.unwhiten(white) @ x)
    both = noise.whiten(np.stack([x, 2.0 * x], axis=1))
    np.testing.assert_allclose(both, np.stack([noise.whiten(x), 2.0 * noise.whiten(x)], axis=1), atol=1e-12)


def test_whitened_noise_has_variance_one_at_every_frequency(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    fresh = balance.data.narrowed(coloured(np.random.default_rng(3), len(balance.train)))  # as every torque is
    power = fit.noise.spectrum(fresh) / balance.samples.white_level
    inside = balance.samples.frequencies < balance.samples.cutoff
    for band in np.array_split(power[inside], 8):
        assert np.mean(band) == pytest.approx(1.0, abs=0.3)
    assert np.sum(fit.noise.spectrum(fresh)) == pytest.approx(np.sum(fit.noise.whiten(fresh) ** 2))


def test_rows_keep_their_distance_from_what_is_held_out(fitted: tuple[TorqueBalance, Fit]) -> None:
    samples = fitted[0].samples
    for distance in (-samples.half_length, 0, samples.half_length):
        assert fitted[0].data.train[samples.rows + distance].all()


def test_the_ends_of_a_recording_that_no_fit_sees_are_not_judged(fitted: tuple[TorqueBalance, Fit]) -> None:
    samples = fitted[0].samples
    train = np.flatnonzero(samples.train)
    assert (train[0], train[-1]) == (samples.rows[0], samples.rows[-1])
    assert train[0] >= samples.half_length
    assert not (samples.train & samples.held_out).any()


def test_before_anything_is_known_noise_is_white_of_one_newton_metre(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance = fitted[0]
    noise = white_noise(balance.samples)
    x = np.random.default_rng(4).standard_normal(len(balance.train))
    np.testing.assert_allclose(noise.whiten(x), x[balance.samples.rows], atol=1e-12)
    residual = balance.residual(axis(), noise)[balance.samples.rows]
    assert balance.squares(axis(), noise).value == pytest.approx(np.sum(residual**2))


def test_the_floor_is_the_noise_and_misfit_what_is_above_it(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, _ = fitted
    noise = coloured(np.random.default_rng(5), len(balance.train))
    wave = 0.6 * np.sin(2.0 * np.pi * 3.1 * balance.data.joined("t"))
    assert noise_floor(balance, noise) == pytest.approx(0.3, rel=0.15)
    assert noise_floor(balance, noise + wave) == pytest.approx(noise_floor(balance, noise), rel=0.15)
    assert misfit(balance, noise) == pytest.approx(1.0, abs=0.3)
    assert misfit(balance, noise + wave) == pytest.approx(1.0 + 0.18 / 0.09, rel=0.3)
