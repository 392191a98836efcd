"""The noise of a drive, from what a fit leaves of the torque.

    r = d - J a_n       d: the drive's noise, coloured by a first-order filter; a_n: the encoder's noise, differentiated twice

The encoder's share has the density J^2 (2 pi f)^4 S_n, known from the position's noise; it takes over at some frequency, and
below that the drive's spectrum shows. What a law leaves at reversals comes in bursts: the median over segments passes over
them. The spectrum's logarithm is fitted, so that all frequencies count alike, and lines that a model leaves count little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import welch

LONGEST, FEWEST = 1024, 64  # samples of Welch's segments
SEGMENTS = 16  # into which the longest series is divided, before they overlap
BLURRED = 2  # first frequencies, into which the window spreads what hardly changes
SLOWER = 2.0  # times below the first frequency: a noise whose bandwidth lies lower has hardly anything in the band
BEYOND = 2.0  # times the band's end: a noise whose bandwidth lies higher is white in it, and how far it goes is not seen
OUTLYING = 2.0  # standard deviations of the spectrum's logarithm, from which a line counts less
LEAST_PASSED = 0.1  # of the power: what a filter takes more of is rounding and side lobes


@dataclass(frozen=True)
class DriveNoise:
    """rms: N m. bandwidth: Hz, of the first-order filter. left: rms (N m) that it and the encoder leave behind the filters."""

    rms: float
    bandwidth: float
    left: float


def drive_noise(
    residuals: Sequence[np.ndarray],
    rate: float,
    period: float,
    position_noise: float,
    inertia: float,
    passed: Callable[[np.ndarray], np.ndarray] = np.ones_like,
) -> DriveNoise | None:
    """The noise of a drive; None where no series is long enough for a spectrum, or nothing is left.

    Parameters
    ----------
    residuals: torque that a model leaves, N m, of each stretch; at `rate`, samples/s.
    period: s, at which the drive's noise is renewed and the encoder read.
    position_noise: rad rms, white. inertia: kg m^2.
    passed: share of the power that filters have left at frequencies (m,), Hz.
    """
    length = int(np.clip(max(map(len, residuals), default=0) // SEGMENTS, FEWEST, LONGEST))
    long = [one for one in residuals if len(one) >= length]
    if not long:
        return None
    spectra = [welch(one, rate, nperseg=length, average="median") for one in long]
    counts = np.array([len(one) / length for one in long])
    frequency, density = spectra[0][0], np.average([power for _, power in spectra], axis=0, weights=counts)
    share = passed(frequency)
    used = (np.arange(len(frequency)) > BLURRED) & (share > LEAST_PASSED) & (density > 0.0)
    if np.count_nonzero(used) <= BLURRED:
        return None
    f, aim = frequency[used], np.log(density[used] / share[used])

    def modelled(numbers: np.ndarray, f: np.ndarray) -> np.ndarray:
        size, bandwidth = np.exp(numbers)
        encoder = inertia**2 * (2.0 * np.pi * f) ** 4 * 2.0 * period * position_noise**2
        return np.asarray(size**2 * first_order(f, bandwidth, period) + encoder)

    def misfit(numbers: np.ndarray) -> np.ndarray:
        return np.log(modelled(numbers, f)) - aim

    size = np.sqrt(float(np.exp(np.median(aim))) * f[-1])
    bounds = np.log([[1e-6 * size, f[0] / SLOWER], [1e3 * size, BEYOND * f[-1]]])
    starts = [np.log([size, bandwidth]) for bandwidth in np.geomspace(f[0], f[-1], 3)]
    scatter = OUTLYING / np.sqrt(counts.sum())
    fits = [least_squares(misfit, start, bounds=bounds, loss="soft_l1", f_scale=scatter) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    power = float(np.trapezoid(modelled(best, frequency) * share, frequency))
    rms, bandwidth = np.exp(best).tolist()
    return DriveNoise(rms, bandwidth, float(np.sqrt(power)))


def first_order(frequency: np.ndarray, bandwidth: float, period: float) -> np.ndarray:
    """One-sided density (1/Hz) at frequencies (m,), Hz, of first-order noise of unit variance that is held for `period`, s."""
    decay = np.exp(-2.0 * np.pi * bandwidth * period)
    turn = np.exp(-2j * np.pi * frequency * period)
    held = np.sinc(frequency * period) ** 2
    return np.asarray(2.0 * period * (1.0 - decay**2) / np.abs(1.0 - decay * turn) ** 2 * held)
