"""Cross-validation: what a candidate gains it has to gain on pieces of the data that it was not fitted to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import Torque, conditioned, settled, unfitted
from scipy import optimize

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.search.candidates import Candidate, fitted_candidates
from tcs_friction.diagnose.search.cross_validation import (
    simplest,
    squares_as_fitted,
    squares_left_out,
    with_best_confirmed,
)
from tcs_friction.diagnose.search.hypotheses import starts
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.start import Start
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    return settled(conditioned(np.random.default_rng(1), lambda m: np.full(len(m.t), 0.3), seconds=80.0))


def with_bias(fitted: tuple[TorqueBalance, Fit], bias: float) -> Fit:
    balance, fit = fitted
    return unfitted(balance, fit.axis.with_effect(instance(effect("torque_bias"), {"bias": bias})), fit.noise)


def bias_candidates(torque: Torque) -> tuple[TorqueBalance, Fit, list[Candidate], float]:
    """The balance, the base, a bias fitted to it as the only candidate, the dispersion."""
    balance, base = settled(conditioned(np.random.default_rng(2), torque, seconds=80.0))
    projected = ProjectedResidual(balance, base)
    found = starts(projected, effect("torque_bias"), None)
    return balance, base, fitted_candidates(balance, base, found, projected.dispersion), projected.dispersion


def test_squares_on_pieces_add_up_to_those_of_the_fit(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    squares = squares_as_fitted(balance, fit)
    residual = balance.residual(fit.axis, fit.noise)
    assert squares.white.sum() == pytest.approx(fit.squares.value - fit.noise.bias.squares(fit.axis))
    assert squares.plain.sum() == pytest.approx(np.sum(residual[balance.train] ** 2))
    held_out = np.unique(balance.samples.pieces[balance.held_out])
    assert (squares.white[held_out] == 0.0).all()
    assert len(held_out) > 1


def test_each_piece_is_predicted_from_all_others(fitted: tuple[TorqueBalance, Fit]) -> None:
    """The closed form is what a fit without the piece finds: here the bias alone, minimised numerically."""
    balance, _ = fitted
    start = with_bias(fitted, 0.1)
    (item,) = start.axis.effects
    number = next(n for n in start.free if n.effect == item.identity)
    lone = replace(start, free=(number,))
    squares = squares_left_out(balance, lone, [item])

    def white(bias: float) -> np.ndarray:
        changed = replace(start.axis, effects=(item.replace(bias=bias),))
        return start.noise.whiten(balance.residual(changed, start.noise))

    at = balance.samples.pieces[balance.samples.rows]
    for piece in np.unique(at)[:3]:
        others = optimize.minimize_scalar(lambda b: float(np.sum(white(b)[at != piece] ** 2)), (0.0, 0.5))  # noqa: B023
        assert others.x == pytest.approx(0.3, abs=0.15)
        assert squares.white[piece] == pytest.approx(float(np.sum(white(others.x)[at == piece] ** 2)), rel=1e-6)


def test_a_piece_that_was_left_out_is_never_predicted_better(fitted: tuple[TorqueBalance, Fit]) -> None:
    """Than by the optimum over all of them, in sum; what is no effect of the others stays out of it."""
    balance, _ = fitted
    fit = with_bias(fitted, 0.3)
    left_out, all_in = squares_left_out(balance, fit, fit.axis.effects), squares_as_fitted(balance, fit)
    assert left_out.white.sum() > 0.999 * all_in.white.sum()
    none = squares_left_out(balance, fit, [])
    np.testing.assert_allclose(none.white, all_in.white)
    np.testing.assert_allclose(none.plain, all_in.plain)


def test_a_torque_that_is_there_all_the_time_is_confirmed() -> None:
    balance, base, candidates, dispersion = bias_candidates(lambda m: np.full(len(m.t), 0.3))
    (confirmed,) = with_best_confirmed(balance, base, candidates, dispersion)
    assert candidates[0].score > 0.0
    assert confirmed.score > 0.0
    assert 0.5 * candidates[0].gain < confirmed.gain <= candidates[0].gain


def test_a_torque_that_was_there_once_is_no_bias() -> None:
    """Over all data it gains as much as a real one; a fit to the other pieces does not foresee it."""
    balance, base, candidates, dispersion = bias_candidates(lambda m: 4.0 * ((m.t > 25.5) & (m.t < 29.5)))
    (refused,) = with_best_confirmed(balance, base, candidates, dispersion)
    assert candidates[0].score > 0.0
    assert refused.score <= 0.0


def test_no_candidates_are_none(fitted: tuple[TorqueBalance, Fit]) -> None:
    assert with_best_confirmed(*fitted, [], 1.0) == []


def test_of_candidates_that_cannot_be_told_apart_the_simplest_is_taken(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted

    def candidate(gain: float, name: str, **values: float) -> Candidate:
        item = instance(effect(name), values)
        own = unfitted(balance, fit.axis.with_effect(item), fit.noise)
        return Candidate(gain, 10.0, own, Start((item,), gain, 1, 1.0, np.empty((0, 0))))

    wave = candidate(100.0, "cogging", order=20.0, amplitude=1.0, phase=0.0)
    near, far = candidate(99.0, "torque_bias", bias=1.0), candidate(60.0, "torque_bias", bias=1.0)
    assert simplest(balance, [wave, near]) is near
    assert simplest(balance, [wave, far]) is wave
    hopeless = [candidate(gain, "torque_bias", bias=1.0) for gain in (5.0, 7.0)]
    assert simplest(balance, hopeless) is hopeless[1]
