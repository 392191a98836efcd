"""The noise floor: what of a residual no model could explain, in one definition for every analysis.

    floor^2 = integral of S(f),     S: median of periodograms over blocks of time, then over neighbouring frequencies

The median passes over bursts and lines, which may be physics that a model lacks; what is left is there all the time and at all
frequencies around. It is a bound from below where physics that is missing is there all the time, too, and it is never above what
a model leaves of any part of the data: that is explained. Source of the median of periodograms: B. Allen et al., FINDCHIRP,
Phys. Rev. D 85 (2012), section IV.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, signal

Array = NDArray[np.float64]

MEDIAN_OF_CHI_SQUARED = math.log(2.0)  # of two degrees of freedom, over its mean: median of a periodogram
BLOCKS_WANTED = 24.0  # of the periodogram: their median scatters by 0.3 before neighbouring frequencies are joined
BLOCK_EXPONENTS = (5, 10)  # blocks of 32 to 1024 samples
SMOOTHED_SHARE = 32  # the median over frequencies spans this part of the spectrum
LEAST_POWER = 1e-12  # of the largest: a spectrum must not vanish


def block_length(count: int) -> int:
    """Samples of a periodogram's block where `count` samples are known."""
    lowest, highest = BLOCK_EXPONENTS
    return 1 << max(lowest, min(highest, int(math.log2(max(count / BLOCKS_WANTED, 1 << lowest)))))


def periodograms(series: Sequence[Array], known: NDArray[np.bool_], stretches: Sequence[slice], length: int) -> list[Array]:
    """Spectra (blocks, length/2 + 1) of series (n,) in windows of known samples (n,) of stretches.

    A spectrum of white noise has its standard deviation.
    """
    window = signal.get_window("hann", length)
    window /= math.sqrt(np.sum(window**2))
    begins = [
        begin
        for s in stretches
        for begin in range(s.start, s.stop - length + 1, length // 2)
        if known[begin : begin + length].all()
    ]
    spectra = []
    for x in series:
        pieces = np.stack([x[begin : begin + length] for begin in begins]) if begins else np.empty((0, length))
        spectra.append(fft.rfft(window * (pieces - pieces.mean(axis=1, keepdims=True)), axis=1))
    return spectra


def steady_power(blocks: Array) -> Array:
    """(f,) robust power of spectra (blocks, f): of white noise its variance at each frequency."""
    power = np.median(np.abs(blocks) ** 2, axis=0) / MEDIAN_OF_CHI_SQUARED
    power[0] = power[1]  # the blocks' means were taken away
    width = max(3, (len(power) - 1) // SMOOTHED_SHARE * 2 + 1)
    power = ndimage.median_filter(power, width, mode="reflect")
    return np.maximum(power, LEAST_POWER * power.max())


def integrated(power: Array) -> float:
    """Root of the mean of a power (f,) at even frequencies up to half the rate: the rms of noise that has it."""
    return math.sqrt(float(np.trapezoid(power)) / max(len(power) - 1, 1))


def noise_floor(residual: Array, steady: float | None = None, parts: Sequence[NDArray[np.bool_]] = ()) -> float:
    """Rms of the noise in a residual (n,), N m: what is there steadily, at most what is left of it or of any of its parts.

    steady: rms of what is there steadily, where that is known better than from the residual in one piece. parts: masks (n,), of
    the fitted data and of those that were held out, say.
    """
    if not len(residual):
        return 0.0
    if steady is None:
        blocks = periodograms([residual], np.ones(len(residual), bool), [slice(0, len(residual))], block_length(len(residual)))[0]
        steady = integrated(steady_power(blocks)) if len(blocks) else math.inf
    left = [float(np.sqrt(np.mean(residual[part] ** 2))) for part in parts or [np.ones(len(residual), bool)] if part.any()]
    return min([steady, *left])
