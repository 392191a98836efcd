"""What a model leaves: maps found where there are some, nothing where there is noise, prediction on held-out data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from structure_cases import DT, NOISE, Motion, Torque, coloured, conditioned, settled

from tcs_friction.diagnose.dataset.basis import Even, Hats, Odd, One, Product, Wave
from tcs_friction.diagnose.fit.balance import Balance, Fit
from tcs_friction.diagnose.remainder.chunk_means import Coarse, regress
from tcs_friction.diagnose.remainder.maps import Structure, remaining_structure
from tcs_friction.diagnose.remainder.remainder import mapped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Table, instance


def improved(balance: Balance, fit: Fit, structure: Structure) -> np.ndarray:
    """The residual (n,) with the table as a learned map."""
    assert structure.table is not None
    item = instance(effect("learned_map"), {}, table=structure.table)
    return balance.residual(fit.axis.with_effect(item))


def find(torque: Torque | None, seed: int) -> tuple[Balance, Fit, Structure | None]:
    rng = np.random.default_rng(seed)
    # the residual is rotor - required: a concealed opposing torque raises the torque that the drive has to give
    balance, fit = settled(conditioned(rng, torque))
    return balance, fit, remaining_structure(balance, fit)


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
    ],
    ids=["speed and position", "fading wave", "hill", "wavy speed"],
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
    before, after = balance.residual(fit.axis), improved(balance, fit, structure)
    power = np.mean(np.stack([before, after])[:, balance.held_out] ** 2, axis=1) - NOISE**2
    assert power[1] < 0.3 * power[0]
    power = np.mean(np.stack([before, after])[:, balance.train] ** 2, axis=1)
    assert structure.torque_rms == pytest.approx(np.sqrt(power[0] - power[1]), rel=0.2)


def test_needs_the_torque_to_be_material() -> None:
    small = 0.1 * NOISE * np.sqrt(2.0)
    structure = find(lambda m: small * np.cos(7.0 * m.q), 4)[2]
    assert structure is None


def test_once_is_no_map() -> None:
    """A torque in one stretch of time only predicts nothing, wherever the axis was then."""
    structure = find(lambda m: 1.5 * ((m.t > 20.0) & (m.t < 26.0)), 5)[2]
    assert structure is None or "time" in structure.coordinates


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
    assert remaining_structure(balance, fit) is None


def test_coarse_whitening_makes_uniform_p_values() -> None:
    """Forty regressions of coloured noise on slow waves in time."""
    balance, _ = settled(conditioned(np.random.default_rng(9)))
    t = balance.data.joined("t")
    waves = np.stack([np.cos(2 * np.pi * t * k / 50.0) for k in range(1, 9)], axis=1)
    rng, p_values = np.random.default_rng(10), []
    for _ in range(40):
        noise = coloured(rng, len(t))
        coarse = Coarse(balance, noise)
        fit = regress(coarse.whiten(coarse.mean(waves)), coarse.whiten(coarse.mean(noise)))
        p_values.append(np.exp(fit.log_p))
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_unwhiten_is_the_adjoint() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(11), seconds=60.0))
    coarse = Coarse(balance, balance.residual(fit.axis))
    rng = np.random.default_rng(12)
    x, white = rng.standard_normal(len(balance.train)), rng.standard_normal(len(coarse.rows))
    forward = float(white @ coarse.whiten(coarse.mean(x)))
    assert forward == pytest.approx(float(coarse.unwhiten(white) @ x[coarse.samples]))


def test_scatter_is_the_mean_of_dense_columns() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(13), seconds=60.0))
    coarse = Coarse(balance, balance.residual(fit.axis))
    q = balance.data.joined("position")
    index, value = Hats("position", float(q.min()), float(q.max()), 7).evaluate(q)
    dense = np.zeros((len(q), 7))
    np.add.at(dense, (np.arange(len(q))[:, None], index), value)
    sparse = coarse.scatter(index[coarse.samples], value[coarse.samples], 7)
    np.testing.assert_allclose(sparse, coarse.mean(dense), atol=1e-12)
    assert coarse.period == pytest.approx(coarse.width * DT)


@pytest.mark.parametrize(
    "product",
    [
        Product(Hats("position", -1.0, 2.0, 9), One()),
        Product(Hats("position", -1.0, 2.0, 9), Odd("velocity", 0.3)),
        Product(Hats("position", -1.0, 2.0, 9), Even("velocity", 0.3)),
        Product(Wave("position", -1.0, 2.0, 5.0), Hats("velocity", -0.2, 0.2, 5)),
    ],
    ids=["hats", "odd", "even", "wave"],
)
def test_table_shows_the_map(product: Product) -> None:
    """Bilinear interpolation of the grid is the map itself (waves: nearly)."""
    rng = np.random.default_rng(14)
    coefficients = rng.standard_normal(product.count)
    x, y = rng.uniform(-1.0, 2.0, 200), rng.uniform(-0.2, 0.2, 200)
    index, value = product.evaluate(x, y)
    direct = np.sum(value * coefficients[index], axis=1)
    grid = product.grid(coefficients)
    one, two = product.first, product.second
    if grid.ndim == 1:
        shown = np.interp(x, np.linspace(one.lower, one.upper, len(grid)), grid)
    else:
        columns = [np.interp(x, np.linspace(one.lower, one.upper, len(grid)), c) for c in grid.T]
        nodes = np.linspace(two.lower, two.upper, grid.shape[1])
        shown = np.array([np.interp(b, nodes, row) for b, row in zip(y, np.transpose(columns), strict=True)])
    np.testing.assert_allclose(shown, direct, atol=0.05 if isinstance(one, Wave) else 1e-9)


def test_a_map_that_makes_it_worse_is_not_taken() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(12), lambda m: 2.0 * np.sin(3.0 * m.q)))
    q = balance.data.joined("position")
    grid = np.linspace(q.min(), q.max(), 200)
    for sign in (1.0, -1.0):
        table = Table(("position",), (float(q.min()),), (float(q.max()),), sign * 2.0 * np.sin(3.0 * grid))
        found = mapped(balance, fit, Structure(("position",), 0.0, 1.4, 1.0, None, table))
        assert (found is fit) == (sign < 0.0)
