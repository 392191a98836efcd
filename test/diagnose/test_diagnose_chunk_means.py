"""Chunk means: their whitening makes regressions chi-squared, and its adjoint and sparse columns are right."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_torque_cases import DT, coloured, conditioned, settled
from scipy import stats

from tcs_friction.diagnose.dataset.basis import Hats
from tcs_friction.diagnose.remainder.chunk_means import ChunkMeans, regress


def test_whitening_makes_uniform_p_values() -> None:
    """Forty regressions of coloured noise on slow waves in time."""
    balance, fit = settled(conditioned(np.random.default_rng(9)))
    t = balance.data.joined("t")
    waves = np.stack([np.cos(2 * np.pi * t * k / 50.0) for k in range(1, 9)], axis=1)
    rng, p_values = np.random.default_rng(10), []
    for _ in range(40):
        noise = coloured(rng, len(t))
        chunks = ChunkMeans(balance, fit.noise, noise)
        found = regress(chunks.whiten(chunks.mean(waves)), chunks.whiten(chunks.mean(noise)))
        p_values.append(np.exp(found.log_p))
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_unwhiten_is_the_adjoint() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(11), seconds=60.0))
    chunks = ChunkMeans(balance, fit.noise, balance.residual(fit.axis, fit.noise))
    rng = np.random.default_rng(12)
    x, white = rng.standard_normal(len(balance.train)), rng.standard_normal(len(chunks.rows))
    forward = float(white @ chunks.whiten(chunks.mean(x)))
    assert forward == pytest.approx(float(chunks.unwhiten(white) @ x[chunks.samples]))


def test_scatter_is_the_mean_of_dense_columns() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(13), seconds=60.0))
    chunks = ChunkMeans(balance, fit.noise, balance.residual(fit.axis, fit.noise))
    q = balance.data.joined("position")
    index, value = Hats("position", float(q.min()), float(q.max()), 7).evaluate(q)
    dense = np.zeros((len(q), 7))
    np.add.at(dense, (np.arange(len(q))[:, None], index), value)
    sparse = chunks.scatter(index[chunks.samples], value[chunks.samples], 7)
    np.testing.assert_allclose(sparse, chunks.mean(dense), atol=1e-12)
    assert chunks.period == pytest.approx(chunks.width * DT)
