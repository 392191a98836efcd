"""Linear filters in the frequency domain, without phase shift or with a given response.

In: a series (n,) at even steps. Out: the same samples low-passed and differentiated,

    X_k(f) = (2 pi i f)^k X(f) / (1 + (f/cutoff)^8),        k = 0, 1, 2,

which is a fourth-order Butterworth low pass run forwards and backwards, and its exact time derivatives: differences between
samples would attenuate a velocity near the band's edge. An identification runs the same attenuation from sample to sample
(conditioning.motion), because it passes the torques of candidates through it, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import fft

ORDER = 8  # of the power of frequency: fourth order, forwards and backwards
PADDING_PERIODS = 10.0  # of the cutoff, added to a series at both ends; a step settles to 1e-6 in five
RINGING = 2.0  # s of zeros after a series, in which a filter may ring out: a resonance of 10 Hz with 4 % damping falls to 1 %


def low_pass(x: np.ndarray, dt: float, cutoff: float, derivatives: int = 0) -> list[np.ndarray]:
    """Zero-phase low-pass of x (n,) at `cutoff`, Hz, and so many time derivatives, each (n,); samples every `dt`, s.

    The ends are extended by odd reflection, and the line through them is taken out before the transform, which is periodic.
    """
    n = len(x)
    pad = min(n - 1, math.ceil(PADDING_PERIODS / cutoff / dt))
    extended = np.concatenate([2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]])
    trend = np.linspace(extended[0], extended[-1], len(extended))
    slope = (extended[-1] - extended[0]) / ((len(extended) - 1) * dt)
    size = fft.next_fast_len(len(extended), real=True)
    frequency = fft.rfftfreq(size, dt)
    spectrum = fft.rfft(extended - trend, size) / (1.0 + (frequency / cutoff) ** ORDER)
    omega = 2j * np.pi * frequency
    inside = slice(pad, pad + n)
    results = [fft.irfft(spectrum * omega**k, size)[inside] for k in range(derivatives + 1)]
    results[0] = results[0] + trend[inside]
    if derivatives:
        results[1] = results[1] + slope
    return results


def through(x: np.ndarray, dt: float, response: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """A series (n,) through a linear filter; `response` (m,), complex, at frequencies (m,), Hz. Before and after it are zeros."""
    size = fft.next_fast_len(len(x) + math.ceil(RINGING / dt), real=True)
    spectrum = fft.rfft(x, size) * response(fft.rfftfreq(size, dt))
    return np.asarray(fft.irfft(spectrum, size, overwrite_x=True)[: len(x)])
