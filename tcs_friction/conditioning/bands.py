"""The bands of a diagnosis: up to where torques are compared, and how densely motion and torque are sampled for it.

In: positions (n,) at even steps. Out: the cutoff, the position's noise, the encoder's step, and whole-numbered strides.

A torque that a motion requires contains its acceleration. White noise of the position has the density S, that of the
acceleration (2 pi f)^4 S: beyond the frequency at which the position's spectrum sinks into S an acceleration is noise. That
frequency ends the comparison. Friction is no linear function of the motion: products of it reach up to twice its band. The
motion is therefore kept in a band MOTION_BAND times as wide, and only the torques that follow from it are narrowed.

The identification estimates density and band in its own way (`motion`): it needs a band in which every single frequency is
above the noise, because one filter serves for motion and torque, where this one may contain gaps in the spectrum of a motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal

from tcs_friction.conditioning.white_noise import derivative_noise

MOTION_BAND = 2.0  # times the cutoff
SAMPLES_PER_PERIOD = 3.0  # of a band's edge: Nyquist's 2, and room for a filter to fall in
HIGHEST_CUTOFF = 0.2  # of the sampling rate, so that the motion's band ends below Nyquist's 0.5 of it
LOWEST_CUTOFF = 1.0  # Hz; nothing but drift is slower
LOWEST_LINES = 4.0  # first frequencies of the spectrum, which the window's side lobes blur
PASSED = 1.4  # cutoff over the highest frequency that shall pass: there the low pass has a gain of 0.94
LONGEST_SEGMENT, SHORTEST_SEGMENT = 2048, 64  # samples of Welch's segments
SEGMENTS = 4  # that a position is at least divided into, before they overlap
NOISE_BAND = 0.7  # of half the sampling rate, above which an axis does not move: what is there is noise
CLEAR = 5.0  # power over the noise's that counts as motion; a median of noise alone reaches it once in 270 000 frequencies
SMOOTHED = 9  # frequencies, over which the power's median is taken
MOSTLY_CLEAR = 0.8  # of the frequencies below the highest that counts
LATE = 0.95  # quantile of the time between samples, within which a line through them must do
SAME_POSITION = 1e-12  # of the travel: positions that differ by less are the same
UNEVEN = 0.01  # of a step, by which a multiple of it may miss: rounding in a log
MOST_WHOLE = 0.99  # of the differences between positions must be multiples of a step
BLURRED = 0.5  # of a step; Gaussian noise so large leaves exp(-2 pi^2 0.5^2) = 0.7 % of the steps' error (Widrow & Kollar 2008)


@dataclass(frozen=True)
class Bands:
    """What recordings allow.

    cutoff: up to which torques are compared, Hz. motion: the band of the motion, Hz.
    position_noise: rad rms before filtering. velocity_noise: rad/s rms in the motion's band.
    step: every step-th recorded sample is evaluated. stride: every stride-th of those is compared.
    """

    cutoff: float
    motion: float
    position_noise: float
    velocity_noise: float
    step: int
    stride: int


def bands(positions: Sequence[np.ndarray], period: float, spacing: float) -> Bands:
    """The bands that all positions, each (n,), have in common, sampled every `period`, s; `spacing`, s: see `usual_spacing`."""
    cutoffs, noises = zip(*(choose_cutoff(position, period) for position in positions), strict=True)
    highest = HIGHEST_CUTOFF / (period * max(round(spacing / period), 1))
    cutoff, noise = min(float(np.median(cutoffs)), highest), float(np.median(noises))
    motion = min(MOTION_BAND * cutoff, MOTION_BAND * HIGHEST_CUTOFF / period)
    step = max(1, int(1.0 / (MOTION_BAND * SAMPLES_PER_PERIOD * cutoff * period)))
    stride = max(1, int(1.0 / (SAMPLES_PER_PERIOD * cutoff * period * step)))
    velocity_noise = derivative_noise(2.0 * period * noise**2, motion, 1)
    return Bands(cutoff, motion, noise, velocity_noise, step, stride)


def usual_spacing(times: Sequence[np.ndarray]) -> float:
    """s between samples, of times (n,) of several series, that all but a few keep: what lies between them is interpolated."""
    return max(float(np.quantile(np.diff(t), LATE)) for t in times)


def position_spectrum(position: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies (Hz), power density of the position and the level of its white noise floor, both in rad^2/Hz, one-sided.

    Welch's method on second differences, whose spectrum is divided by theirs, |2 sin(pi f dt)|^4: a position's spectrum falls so
    steeply that the window would spread its low frequencies over the noise.
    """
    length = min(LONGEST_SEGMENT, max(SHORTEST_SEGMENT, len(position) // SEGMENTS))
    frequency, power = signal.welch(np.diff(position, 2), 1.0 / dt, nperseg=length)
    frequency, power = frequency[1:], power[1:] / (2.0 * np.sin(np.pi * frequency[1:] * dt)) ** 4
    return frequency, power, float(np.median(power[int(NOISE_BAND * len(power)) :]))


def choose_cutoff(position: np.ndarray, dt: float) -> tuple[float, float]:
    """Cutoff (Hz), PASSED times where the position sinks into its noise (the filter halves there), and that noise (rad rms)."""
    frequency, power, floor = position_spectrum(position, dt)
    above = ndimage.median_filter(power, SMOOTHED) > CLEAR * floor
    share = np.cumsum(above) / np.arange(1, len(above) + 1)
    clear = np.nonzero(above & (share > MOSTLY_CLEAR))[0]
    cutoff = PASSED * frequency[clear[-1]] if len(clear) else frequency[0]
    lowest = max(LOWEST_LINES * frequency[0], LOWEST_CUTOFF)
    return float(np.clip(cutoff, lowest, HIGHEST_CUTOFF / dt)), math.sqrt(floor * 0.5 / dt)


def step_of(position: np.ndarray) -> float:
    """The step (rad) of which differences of positions (n,) are multiples, as a coarse encoder's are; 0 if there is none."""
    values = np.unique(position)
    steps = np.diff(values)
    steps = steps[steps > SAME_POSITION * (values[-1] - values[0])]
    if not len(steps):
        return 0.0
    step = float(np.quantile(steps, 1.0 - MOST_WHOLE, method="lower"))  # a few may be off: a log's first value, say
    multiples = steps / step
    whole = np.abs(multiples - np.round(multiples)) < UNEVEN
    return step if np.mean(whole) > MOST_WHOLE else 0.0


def visible_step(positions: Sequence[np.ndarray], noise: float) -> float:
    """The largest step (rad) of positions, each (n,), that noise (rad rms) does not blur; 0 if there is none."""
    step = max(step_of(position) for position in positions)
    return step if noise < BLURRED * step else 0.0
