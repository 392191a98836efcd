"""When the logged torque acts, before anything else is known: the timing with which the motion explains most of it.

The torque that a motion requires is nearly linear in few columns: acceleration, velocity, one, and bristles of several widths
with their rates. How much of a torque they explain that acts later or earlier follows for all times at once from correlations,
which are products of Fourier transforms; the best of them is the best of all, not the nearest. Its timing is where a fit begins,
which finds the rest within a period.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.stats import chi2

from tcs_friction.conditioning.motion import Motion, Timing
from tcs_friction.conditioning.timing import LONGEST
from tcs_friction.identify import kernels

WIDTHS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Of bristles, as shares of the travel: from the finest that any bearing of a long axis shows to a soft cable."""
PER_PERIOD = 2  # timings that are tried
CHANCE = 1e-3  # probability that another timing explains so much more where the motion's own is right (likelihood ratio)
RANK = 1e-9  # of the largest, below which columns are the same
UNRESOLVED = float(np.finfo(float).eps) / RANK  # of a torque's squares: rounding, which the inverse makes larger by 1 / RANK


@dataclass(frozen=True)
class Lag:
    """By how much later (s) than in a motion its torque acts, to half a period, as the inertia's torque tells.

    told: whether that torque is large enough to tell any. better: whether it is another timing by more than chance.
    """

    late: float
    told: bool
    better: bool


def likely_timing(motion: Motion) -> Timing:
    """The timing that explains a motion's torque best, to half a period; its own unless another is better by more than chance.

    It is told by the inertia's torque: without that, any timing is as good, and a controller's answers to disturbances decide.
    """
    lag = likely_lag(motion)
    if not (lag.told and lag.better):
        return motion.timing
    return replace(motion.timing, acts=motion.timing.acts + lag.late)


def likely_lag(motion: Motion) -> Lag:
    """The lag with which a motion's torque is explained best."""
    period = motion.grids[0].logged.period
    reach = max(LONGEST, 3.0 * period)
    per_sample = max(1, round(PER_PERIOD / (motion.rate * period)))
    lags = np.arange(-int(np.ceil(reach * motion.rate * per_sample)), int(np.ceil(reach * motion.rate * per_sample)) + 1)
    columns = _columns(motion)
    left, still = _left(motion, columns, lags, per_sample), _left(motion, columns[1:], lags, per_sample)
    best, here = int(np.argmin(left)), int(np.flatnonzero(lags == 0)[0])
    independent = 2.0 * motion.bandwidth * len(motion) / motion.rate
    gained = independent * np.log(np.array([left[here], still[best]]) / left[best])
    better, told = gained >= chi2.ppf(1.0 - CHANCE, 1)
    return Lag(-float(lags[best]) / (motion.rate * per_sample), bool(told), bool(better))


def _left(motion: Motion, columns: np.ndarray, lags: np.ndarray, per_sample: int) -> np.ndarray:
    """(l,) Share of the squares of a torque that is moved by lags which columns (k, n) do not explain."""
    explained, energy = np.zeros(len(lags)), np.full(len(lags), 1e-300)
    for part in motion.stretches:
        own = _explained(columns[:, part], motion.torque[part], lags, per_sample)
        explained, energy = explained + own[0], energy + own[1]
    return np.maximum(1.0 - explained / energy, UNRESOLVED)


def _columns(motion: Motion) -> np.ndarray:
    """(k, n) what a required torque is made of."""
    rows = [motion.acceleration, motion.velocity, np.ones(len(motion))]
    out = np.empty((len(motion), 8))
    travel, start = motion.travel, np.zeros(len(motion.bounds) - 1)
    for width in WIDTHS:
        bristle = np.array([1.0, 1.0, 1.0, 1.0 / (width * max(float(np.ptp(motion.position)), 1e-300)), 0.0, 0.0])
        kernels.sensitivities(np.ascontiguousarray(motion.velocity), travel, motion.bounds, bristle, start, out)
        rows += [out[:, 0].copy(), np.gradient(out[:, 0])]
    return np.array(rows)


def _explained(columns: np.ndarray, torque: np.ndarray, lags: np.ndarray, per_sample: int) -> tuple[np.ndarray, np.ndarray]:
    """(l,) Squares of a torque that columns (k, n) explain if it is moved by lags of 1/per_sample samples, and all of them."""
    reach, count = int(np.abs(lags).max()) // per_sample + 1, len(torque)
    inside, torque = slice(reach, count - reach), torque - torque.mean()
    if count - 2 * reach <= len(columns):
        return np.zeros(len(lags)), np.zeros(len(lags))
    masked, part = np.zeros_like(columns), columns[:, inside]
    vary = np.ptp(part, axis=1) > 0.0  # the column of ones stays; without their means, the others are farther apart
    masked[:, inside] = part - (part.mean(axis=1) * vary)[:, None]
    masked /= np.maximum(np.linalg.norm(masked, axis=1), 1e-300)[:, None]
    whitening = np.linalg.pinv(masked @ masked.T, rcond=RANK, hermitian=True)
    length = fft.next_fast_len(count, real=True)
    spectra = np.conj(fft.rfft(masked, length)) * fft.rfft(torque, length)
    products = per_sample * fft.irfft(spectra, length * per_sample)[:, lags % (length * per_sample)]
    squares = np.concatenate([[0.0], np.cumsum(torque**2)])
    first = reach + lags // per_sample
    energy = squares[first + count - 2 * reach] - squares[first]
    return np.einsum("kl,kj,jl->l", products, whitening, products), energy
