"""The residual's slow part: means over short chunks of train data, whitened, and regressions on them.

In: a residual (n,), N m, and its noise model. Out: chunk means (c,), whitened rows of them (m,), F tests of regressions.

What depends on motion, place or time is slow against the sampling: 20 means a second keep it, and a regression with hundreds
of columns costs little. The noise of chunk means is whitened by an autoregressive filter made from the robust noise spectrum
(Yule-Walker), so that squares compare with chi-squared and a filter costs only its few chunks at every gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, stats

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.noise import NoiseModel
from tcs_friction.diagnose.fit.noise_estimate import noise_spectrum
from tcs_friction.numerics.runs import runs

CHUNKS_PER_SECOND = 20.0  # at most: passes what is slower than 10 Hz
MOST_CHUNKS = 40_000  # bounds the memory of a regression with hundreds of columns
FLAT_BELOW = 0.3  # of the highest frequency of chunk means: a drive's torque noise is flat below its corner
NOISE_LEEWAY = 1.2  # factor by which noise power may exceed its robust estimate
FILTER_ORDER = 10  # of the whitening filter, chunks: half a second
CHUNKS_PER_COEFFICIENT = 40  # that the filter is made from at least
DEPENDENT = 1e-8  # of the largest eigenvalue: directions without data


class ChunkMeans:
    """Chunk means over the train data of a balance.

    Attributes: rows (m,): index of the chunks that are compared. run, t (c,): run of train data and mean time of every chunk.
    weight (m,): 1/standard deviation of the whitened noise.
    """

    def __init__(self, balance: TorqueBalance, noise: NoiseModel, residual: np.ndarray) -> None:
        self.balance = balance
        dt = balance.data.dt
        self.width = max(1, round(1.0 / (CHUNKS_PER_SECOND * dt)), -(-int(balance.train.sum()) // MOST_CHUNKS))
        self.period = self.width * dt
        begins, runs = [], []
        for number, (begin, end) in enumerate(_train_runs(balance)):
            starts = np.arange(begin, end - self.width + 1, self.width)
            begins.append(starts)
            runs.append(np.full(len(starts), number))
        self.begins = np.concatenate([np.zeros(0, np.int64), *begins])
        self.run = np.concatenate([np.zeros(0, np.int64), *runs])
        self.samples = (self.begins[:, None] + np.arange(self.width)).ravel()
        self.count = len(self.begins)
        order = min(FILTER_ORDER, max(1, self.count // CHUNKS_PER_COEFFICIENT))
        frequency, power = noise_spectrum(balance, residual)
        few = len(power) // 32  # the spectrum's first points miss what the blocks' mean took away
        power = np.concatenate([np.maximum(power[:few], power[few]), power[few:]])
        self.filter = _autoregression(frequency, power, dt, self.width, order)
        first = np.searchsorted(self.run, self.run, side="left")
        self.rows = np.flatnonzero(np.arange(self.count) - first >= order)
        self.weight = np.sqrt(self.mean(noise.local_weight)[self.rows])

    @cached_property
    def t(self) -> np.ndarray:
        """Mean time of each chunk, s."""
        return self.mean(self.balance.data.joined("t"))

    def mean(self, x: np.ndarray) -> np.ndarray:
        """Means of x (n,) or (n, k) over the chunks."""
        return np.asarray(x[self.samples].reshape(self.count, self.width, *x.shape[1:]).mean(axis=1))

    def scatter(self, index: np.ndarray, value: np.ndarray, size: int) -> np.ndarray:
        """Chunk means (chunks, size) of sparse columns: sample i has value[i, j] in column index[i, j]; chunk samples only."""
        chunk = np.repeat(np.arange(self.count), self.width)[:, None]
        sums = np.bincount((chunk * size + index).ravel(), value.ravel(), minlength=self.count * size)
        return sums.reshape(self.count, size) / self.width

    def whiten(self, x: np.ndarray) -> np.ndarray:
        """Whitened rows (m,) or (m, k) of chunk means (chunks,) or (chunks, k)."""
        y = sum(a * x[self.rows - lag] for lag, a in enumerate(self.filter))
        return np.asarray(y * (self.weight if x.ndim == 1 else self.weight[:, None]))

    def unwhiten(self, white: np.ndarray) -> np.ndarray:
        """The adjoint of chunk means and `whiten`: for every chunk sample (chunks * width,)."""
        full = np.zeros(self.count)
        for lag, a in enumerate(self.filter):
            full[self.rows - lag] += a * white * self.weight
        return np.repeat(full, self.width) / self.width


@dataclass(frozen=True)
class Regression:
    """Least squares of whitened rows on k columns: statistic and p-value (log), coefficients (k,) and their covariance."""

    statistic: float
    log_p: float
    coefficients: np.ndarray
    covariance: np.ndarray


def regress(columns: np.ndarray, white: np.ndarray) -> Regression:
    """F test of whitened columns (m, k) on a whitened residual (m,); a direction without data does not count."""
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh((columns / scale).T @ (columns / scale))
    keep = values > DEPENDENT * max(float(values[-1]), 1e-300)
    vectors = vectors[:, keep] / np.sqrt(values[keep])
    scores = vectors.T @ ((columns / scale).T @ white)
    gain, k = float(scores @ scores), int(keep.sum())
    rest = max(len(white) - k, 1)
    variance = max(float(white @ white) - gain, 1e-300) / rest
    statistic = gain / max(k, 1) / variance
    root = vectors / scale[:, None]
    return Regression(
        statistic,
        float(stats.f.logsf(statistic, max(k, 1), rest)),
        root @ scores,
        variance * (root @ root.T),
    )


@dataclass(frozen=True)
class Slow:
    """Power (N^2 m^2) of a residual below `knee` (Hz) in excess of a flat noise; statistic: measured over expected power
    there, with its p-value; floor: rms of the whole noise that is flat below the knee, N m."""

    power: float
    statistic: float
    p_value: float
    knee: float
    floor: float


def slow_excess(chunks: ChunkMeans, residual: np.ndarray, raw: np.ndarray) -> Slow:
    """Compare slow power with a noise that does not rise towards low frequencies. `raw`: the residual's chunk means.

    A drive's torque noise is flat below its corner, so the level in the upper part of the slow band bounds the noise below it.
    """
    frequency, power = noise_spectrum(chunks.balance, residual)
    highest = min(0.5 / chunks.period, chunks.balance.data.cutoff)
    knee = FLAT_BELOW * highest
    band = (frequency >= knee) & (frequency <= 2.0 * knee)
    level = float(np.median(power[band])) if band.any() else float(np.median(power))
    flat = np.where(frequency < knee, np.minimum(power, level), power)
    below = frequency < knee
    allowed = NOISE_LEEWAY * flat[below] * np.sinc(frequency[below] * chunks.period) ** 2
    expected = max(float(allowed.mean()) * knee, 1e-300)
    spectrum = np.fft.rfft(raw)[np.fft.rfftfreq(len(raw), chunks.period) < knee]
    actual = 2.0 * float(np.sum(np.abs(spectrum) ** 2)) / len(raw) ** 2
    count = 2.0 * knee * chunks.period * len(raw)  # independent numbers below the knee
    p_value = float(stats.chi2.sf(count * actual / expected, count))
    floor = math.sqrt(float(np.trapezoid(flat, frequency)))
    return Slow(max(0.0, actual - expected), actual / expected, p_value, knee, floor)


def _train_runs(balance: TorqueBalance) -> np.ndarray:
    """(k, 2) First and past-last sample of every run of train data within a stretch."""
    return np.concatenate([s.start + runs(balance.train[s]) for s in balance.samples.stretches])


def _autoregression(
    frequency: np.ndarray, power: np.ndarray, dt: float, width: int, order: int
) -> np.ndarray:
    """Whitening filter (order + 1,) of chunk means of `width` samples whose noise has this one-sided power density."""
    grid = np.linspace(0.0, 0.5 / (dt * width), 257)
    folded = np.zeros(len(grid))
    for alias in range(-(width // 2), width // 2 + 1):
        f = np.abs(grid + alias / (dt * width))
        f = np.where(f > 0.5 / dt, 1.0 / dt - f, f)
        below = np.sin(np.pi * f * dt) * width
        mean = np.where(
            below < 1e-9, 1.0, np.sin(np.pi * f * dt * width) / np.where(below < 1e-9, 1.0, below)
        )
        folded += 0.5 * np.interp(f, frequency, power) * mean**2
    correlation = np.fft.irfft(folded / (dt * width))[: order + 1]
    correlation[0] *= 1.0 + 1e-6
    prediction = linalg.solve_toeplitz(correlation[:order], correlation[1:])
    variance = float(correlation[0] - prediction @ correlation[1:])
    return np.asarray(np.concatenate([[1.0], -prediction]) / math.sqrt(max(variance, 1e-300)))
