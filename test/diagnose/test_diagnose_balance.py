"""The torque balance: pure functions of axis and noise model, and a residual whose noise bodies do not amplify."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import pytest
from concealed_torque_cases import axis as sweeping_axis
from concealed_torque_cases import conditioned as sweep
from concealed_torque_cases import settled
from open_loop_cases import axis, conditioned, item, recorded
from scipy import sparse

from tcs_friction.diagnose.fit.balance import TorqueBalance, noise_amplification, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.fit.noise_estimate import estimated, noise_floor
from tcs_friction.diagnose.fit.parameters import Form
from tcs_friction.physics.terms import Instance


def test_noise_that_a_mode_amplifies_counts_as_much_as_without_it() -> None:
    """At the antiresonance the encoder's noise is most of the torque that the motion requires."""
    true = axis(item("flexible_mode", frequency=20.0, damping=0.03, inertia_ratio=0.3))
    balance = TorqueBalance(conditioned(recorded(true)))
    noise = white_noise(balance.samples)
    assert np.allclose(balance.residual(true, noise), balance.torque_residual(true))  # no noise is known yet
    for _ in range(2):
        noise = estimated(balance, true, noise)
    residual = balance.residual(true, noise)
    assert noise_floor(balance, residual) == pytest.approx(rms(residual[balance.train]), rel=0.12)
    gain = noise_amplification(true, noise, np.array([0.0, 20.0 * np.sqrt(0.7), 20.0]))
    assert gain[0] == pytest.approx(1.0)
    assert gain[1] > 2.5 > 1.0 > gain[2]
    assert np.array_equal(balance.residual(axis(), noise), balance.torque_residual(axis()))


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    return settled(sweep(np.random.default_rng(1), seconds=40.0))


def arrays(x: Any) -> Iterator[np.ndarray]:
    """All arrays and numbers within an object, but those of its cache."""
    if isinstance(x, np.ndarray):
        yield x.copy()
    elif sparse.issparse(x):
        yield x.toarray()
    elif isinstance(x, (int, float)):
        yield np.array(x)
    elif isinstance(x, (tuple, list)):
        for inner in x:
            yield from arrays(inner)
    elif is_dataclass(x):
        for field in fields(x):
            yield from arrays(getattr(x, field.name))
    elif type(x).__module__.startswith("tcs_friction.") and not isinstance(x, Enum):
        for name, inner in sorted(vars(x).items()):
            if name != "cache":
                yield from arrays(inner)


def test_nothing_of_a_balance_or_a_noise_model_changes_with_use(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    other = sweeping_axis().with_effect(item("flexible_mode", frequency=9.0, damping=0.05, inertia_ratio=0.3))
    balance.data.narrowed(balance.data.stretches[0].torque)  # the filter is made when it is first asked for
    before = list(arrays((balance, fit)))
    noise = estimated(balance, other, fit.noise)
    residual = balance.residual(other, noise)
    balance.jacobian(other, balance.free(other), noise, residual)
    balance.squares(other, noise)
    after = list(arrays((balance, fit)))
    assert len(before) == len(after) > 20
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_a_residual_does_not_depend_on_what_was_asked_before(fitted: tuple[TorqueBalance, Fit]) -> None:
    """With a body that swings it depends on the noise model, which is given and not remembered."""
    balance, fit = fitted
    swung = fit.axis.with_effect(item("flexible_mode", frequency=9.0, damping=0.05, inertia_ratio=0.3))
    loud, free = estimated(balance, swung, fit.noise), balance.free(swung)

    def asked() -> list[np.ndarray]:
        residual = balance.residual(swung, fit.noise)
        jacobian = balance.jacobian(swung, free, fit.noise, residual)
        model = estimated(balance, swung, fit.noise)
        squares = np.array(balance.squares(swung, fit.noise).value)
        return [residual, jacobian, squares, model.whitening.weights, model.local_weight, model.bias.whole]

    first = asked()
    estimated(balance, sweeping_axis(), loud)
    balance.residual(swung, loud)
    balance.terms.cache.results.clear()  # computed again and not remembered
    for one, again in zip(first, asked(), strict=True):
        np.testing.assert_array_equal(one, again)


@pytest.mark.parametrize(
    "wave",
    [
        item("position_dependent_inertia", amplitude=0.3, phase=1.0),
        item("position_dependent_friction", order=2.0, amplitude=0.3, phase=1.0),
        item("encoder_periodic_error", order=60.0, amplitude=2e-6, phase=1.0),
        item("torque_ripple", order=30.0, amplitude=0.02, phase=1.0),
        item("cogging", order=40.0, amplitude=0.5, phase=1.0),
    ],
    ids=lambda wave: wave.term.id,
)
def test_derivatives_by_the_amplitude_of_a_wave_are_those_of_small_changes(
    fitted: tuple[TorqueBalance, Fit], wave: Instance
) -> None:
    """Also where its unit is no torque, so that a change of one would be beyond all bounds, or a whole turn."""
    balance, fit = fitted
    waved = fit.axis.with_effect(wave)
    free = [n for n in balance.free(waved) if n.effect == wave.identity and n.form in (Form.COSINE, Form.SINE)]
    smaller = [replace(number, step=1e-2 * number.step) for number in free]
    residual = balance.residual(waved, fit.noise)
    coarse, fine = (balance.derivatives(waved, some, fit.noise, residual) for some in (free, smaller))
    assert coarse.shape[1] == 2
    assert np.linalg.norm(coarse - fine) < 0.02 * np.linalg.norm(fine)
