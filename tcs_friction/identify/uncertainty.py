"""How well the data determine what was fitted: covariance that survives coloured residuals, and the least possible one."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded
from scipy.signal import fftconvolve
from scipy.stats import norm
from scipy.stats import t as student


def correlation_length(residual: np.ndarray) -> int:
    """Samples after which the residual (m,) has forgotten itself: three times its integrated correlation time, at most m/8."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    length = len(residual)
    if power <= 0.0 or length < 16:
        return 1
    spectrum = np.abs(np.fft.rfft(centred, 2 * length)) ** 2
    correlation = np.fft.irfft(spectrum)[: length // 2] / power
    below = np.flatnonzero(correlation < 2.0 / np.sqrt(length))
    end = int(below[0]) if len(below) else length // 2
    integrated = 0.5 + float(correlation[1:end].sum())
    return int(np.clip(6.0 * integrated, 1, length // 8))


def independent_samples(residual: np.ndarray) -> float:
    """As many independent samples as these correlated ones (m,) are worth."""
    return min(len(residual), 3.0 * len(residual) / correlation_length(residual))


def few_samples(residual: np.ndarray, parameters: int) -> float:
    """Factor of standard deviations that were estimated from few samples: Student's quantile over the normal one, at 95 %."""
    freedom = max(independent_samples(residual) - parameters, 1.0)
    return float(student.ppf(0.975, freedom) / norm.ppf(0.975))


def curvature_inverse(jacobian: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(p, p) inverse of the squares' curvature by derivatives: the covariance if errors are white, of deviation one."""
    slopes = jacobian * np.sqrt(weights)[:, None]
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-140)
    inverse: np.ndarray = np.linalg.pinv((slopes / size).T @ (slopes / size), hermitian=True) / np.outer(size, size)
    return inverse


def sandwich(jacobian: np.ndarray, residual: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of least-squares estimates whose residuals are correlated (Newey and West 1987).

    jacobian (m, p), residual (m,), weights (m,) of the (robust) fit. The lag window follows from the residual's own correlation.
    """
    counted = weights > 0.0
    slopes, errors, emphasis = jacobian[counted], residual[counted], weights[counted]
    if not slopes.size:
        return np.zeros((jacobian.shape[1], jacobian.shape[1]))
    size = np.maximum(np.sqrt(np.sum(emphasis[:, None] * slopes**2, axis=0)), 1e-140)
    slopes = slopes / size
    bread = np.linalg.pinv(slopes.T @ (emphasis[:, None] * slopes), rcond=1e-13, hermitian=True)
    scores = slopes * (emphasis * errors)[:, None]
    reach = correlation_length(errors) + 1
    bartlett = 1.0 - np.abs(np.arange(-reach + 1, reach)) / reach
    meat = scores.T @ fftconvolve(scores, bartlett[:, None], mode="same", axes=0)
    count, parameters = slopes.shape
    covariance = bread @ meat @ bread * count / max(count - parameters, 1)
    covariance *= few_samples(errors, parameters) ** 2
    result: np.ndarray = covariance / np.outer(size, size)
    return result


def cramer_rao(jacobian: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Least covariance (p, p) any unbiased estimate can have when the errors are Gaussian with this autocovariance.

    jacobian (m, p); noise (k,) autocovariance of the compared samples at lags 0, 1, ... (zero beyond).
    """
    count = len(jacobian)
    reach = min(count, len(noise))
    bands = np.zeros(
        (2 * reach - 1, count)
    )  # the covariance has no more diagonals, and a solver for those is linear in m
    for lag in range(reach):
        bands[reach - 1 - lag, lag:] = bands[reach - 1 + lag, : count - lag] = noise[lag]
    bands[reach - 1] *= 1.0 + 1e-9
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-140)
    slopes = jacobian / size
    information = slopes.T @ solve_banded((reach - 1, reach - 1), bands, slopes)
    result: np.ndarray = np.linalg.pinv(information, hermitian=True) / np.outer(size, size)
    return result


def correlations(covariance: np.ndarray) -> np.ndarray:
    """(p, p) correlation matrix."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-140))
    result: np.ndarray = covariance / np.outer(deviation, deviation)
    return result


def block_bootstrap(
    jacobian: np.ndarray, residual: np.ndarray, weights: np.ndarray, seed: int, draws: int = 400
) -> np.ndarray:
    """Covariance (p, p) by resampling blocks of residuals (Kuensch 1989), the model taken as linear around the estimate."""
    random = np.random.default_rng(seed)
    counted = weights > 0.0
    slopes, errors, emphasis = jacobian[counted], residual[counted], weights[counted]
    size = np.maximum(np.sqrt(np.sum(emphasis[:, None] * slopes**2, axis=0)), 1e-140)
    scaled = slopes / size
    bread = np.linalg.pinv(scaled.T @ (emphasis[:, None] * scaled), hermitian=True)
    block = max(2, correlation_length(errors))
    count = len(errors)
    pieces = -(-count // block)
    starts = random.integers(0, max(count - block, 1), (draws, pieces))
    index = (starts[:, :, None] + np.arange(block)).reshape(draws, -1)[:, :count] % count
    deviations = (errors[index] * emphasis) @ scaled @ bread
    covariance = np.cov(deviations, rowvar=False).reshape(len(size), len(size))
    covariance *= few_samples(errors, len(size)) ** 2
    result: np.ndarray = covariance / np.outer(size, size)
    return result
