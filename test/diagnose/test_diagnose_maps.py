"""What a model leaves: maps found where there are some, nothing where there is noise, prediction on held-out data."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import NOISE, Motion, Torque, conditioned, settled

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.remainder.maps import Structure, remaining_structure
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance


def improved(balance: TorqueBalance, fit: Fit, structure: Structure) -> np.ndarray:
    """The residual (n,) with the table as a learned map."""
    assert structure.table is not None
    item = instance(effect("learned_map"), {}, table=structure.table)
    return balance.residual(fit.axis.with_effect(item), fit.noise)


def find(torque: Torque | None, seed: int) -> tuple[TorqueBalance, Fit, Structure | None]:
    rng = np.random.default_rng(seed)
    # the residual is rotor - required: a concealed opposing torque raises the torque that the drive has to give
    balance, fit = settled(conditioned(rng, torque))
    return balance, fit, remaining_structure(balance, fit, fit.noise)


@pytest.mark.parametrize("seed", range(8))
def test_noise_has_no_structure(seed: int) -> None:
    assert find(None, seed)[2] is None


def test_a_constant_is_no_map() -> None:
    assert find(lambda m: np.full(len(m.t), 3.0), 1)[2] is None


@pytest.mark.parametrize(
    ("torque", "coordinates", "period"),
    [
        (lambda m: 12.0 * m.v * np.sin(3.0 * m.q), ("position", "velocity"), 2.0 * np.pi / 3.0),
        (
            lambda m: 1.5 * np.cos(40.0 * m.q) * np.cos(2 * np.pi * m.t / 90.0),
            ("position", "time"),
            np.pi / 20.0,
        ),
        (lambda m: 2.0 * np.exp(-(((m.q - 1.0) / 0.3) ** 2)), ("position",), None),
        (lambda m: 0.8 * np.cos(30.0 * m.v), ("velocity",), None),
        (lambda m: 12.0 * (np.abs(m.v) - np.mean(np.abs(m.v))), ("velocity",), None),  # fewer columns with any other beside it
    ],
    ids=["speed and position", "fading wave", "hill", "wavy speed", "growing with speed"],
)
def test_finds_maps_and_they_predict_held_out_data(
    torque: Torque, coordinates: tuple[str, ...], period: float | None
) -> None:
    balance, fit, structure = find(torque, 3)
    assert structure is not None
    assert set(structure.coordinates) == set(coordinates)
    assert structure.p_value < 1e-3
    if period is not None:
        assert structure.period == pytest.approx(period, rel=0.02)
    before, after = balance.residual(fit.axis, fit.noise), improved(balance, fit, structure)
    power = np.mean(np.stack([before, after])[:, balance.held_out] ** 2, axis=1) - NOISE**2
    assert power[1] < 0.3 * power[0]
    power = np.mean(np.stack([before, after])[:, balance.train] ** 2, axis=1)
    assert structure.torque_rms == pytest.approx(np.sqrt(power[0] - power[1]), rel=0.2)


def test_needs_the_torque_to_be_material() -> None:
    small = 0.1 * NOISE * np.sqrt(2.0)
    structure = find(lambda m: small * np.cos(7.0 * m.q), 4)[2]
    assert structure is None


def test_once_is_no_map() -> None:
    """A torque in one stretch of time only predicts nothing, wherever the axis was then: a torque of unknown cause."""
    structure = find(lambda m: 1.5 * ((m.t > 20.0) & (m.t < 26.0)), 5)[2]
    assert structure is not None
    assert structure.coordinates == ("time",)
    assert structure.table is None


def test_slow_unknown_torque_is_structure_in_time() -> None:
    rng = np.random.default_rng(6)

    def wandering(m: Motion) -> np.ndarray:
        nodes = rng.uniform(-1.0, 1.0, int(m.t[-1] / 0.3) + 2)
        return np.interp(m.t, 0.3 * np.arange(len(nodes)), nodes)

    structure = find(wandering, 7)[2]
    assert structure is not None
    assert structure.coordinates == ("time",)
    assert structure.table is None
    assert structure.torque_rms == pytest.approx(0.47, rel=0.25)


def test_too_little_data_says_nothing() -> None:
    data = conditioned(np.random.default_rng(8), lambda m: 5.0 * np.sin(9.0 * m.q), seconds=6.0)
    balance, fit = settled(data)
    assert remaining_structure(balance, fit, fit.noise) is None
