"""Estimates the noise model from the residual of an axis.

In: an axis and the noise model so far. Out: a new one. Three things are estimated one after the other:

1. the spectrum: a median of periodograms over blocks of time and over neighbouring frequencies, of the residual less its
   repeatable part, so that neither bursts nor lines (which may be the physics that is looked for) count as noise;
2. changes of level: seconds in which the whitened residual is louder than usual weigh less;
3. the bias of the inertia by noise in the acceleration (`errors_in_variables`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage, signal

from tcs_friction.conditioning import noise_floor as common
from tcs_friction.conditioning.noise_floor import BLOCK_EXPONENTS, block_length, periodograms, steady_power
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.errors_in_variables import QUIET_MOTION, attenuation_bias
from tcs_friction.diagnose.fit.noise import ComparedSamples, NoiseModel, whitening_filter
from tcs_friction.diagnose.fit.parameters import INERTIA
from tcs_friction.physics.axis import Axis

MOST_FROM_ENCODER = 0.9  # of the noise power at a frequency: the drive always adds a little
NEIGHBOURS = 3  # frequencies whose mean power says whether motion is driven there
LEVEL_SECONDS = 1.0  # over which the noise level may change
SHORTEST_LEVEL_WINDOW = 8  # samples
LOUDEST_NOISE = 4.0  # times the usual power; what is louder is missing physics and keeps its weight
PLACES = np.linspace(0.0, 1.0, 65)  # quantiles of the positions, over which an inertia is averaged
NO_NOISE = 1.5  # noise floors, from which a residual is no noise whatever it looks like: right models left at most 1.4 on MuJoCo
USUAL_DEVIATIONS = 3.0  # standard deviations of a level estimate that count as usual


def estimated(balance: TorqueBalance, axis: Axis, noise: NoiseModel) -> NoiseModel:
    """The noise model of an axis' residual; that residual is taken under the model so far."""
    residual = balance.residual(axis, noise)
    noise = with_spectrum(balance, noise, residual, axis.inertia)
    noise = replace(noise, local_weight=_local_weight(noise, residual))
    return with_bias(balance, axis, noise, residual)


def with_spectrum(
    balance: TorqueBalance, noise: NoiseModel, residual: np.ndarray, inertia: float | None = None
) -> NoiseModel:
    """The model with the spectrum of a residual (n,), and with the axis' inertia the share of the encoder in it."""
    samples, data = noise.samples, balance.data
    frequency, power = noise_spectrum(balance, residual)
    share = noise.encoder_share
    if inertia is not None:
        encoder = 2.0 * data.period * data.position_noise**2  # rad^2/Hz, one-sided
        share = (inertia * (2.0 * math.pi * frequency) ** 2) ** 2 * encoder / power
        share = np.minimum(share, MOST_FROM_ENCODER)
    inside = frequency <= samples.cutoff
    power = np.where(inside, power, power[inside].max())  # what the low pass took away is no lack of noise
    half = samples.half_length
    count = 2 * max(2 * half, len(frequency))
    even = np.linspace(0.0, frequency[-1], count // 2 + 1)
    response = np.sqrt(2.0 * samples.dt / np.interp(even, frequency, power))
    window = signal.get_window("hann", 2 * half + 3, fftbins=False)[1:-1]

    def weights(gain: np.ndarray) -> np.ndarray:
        return np.asarray(window * np.roll(np.fft.irfft(gain, count), half)[: 2 * half + 1])

    changed = replace(noise, encoder_share=share)
    drive = response * (1.0 - changed.encoder_share_at(even))
    return replace(
        changed,
        whitening=whitening_filter(weights(response), samples),
        drive_whitening=whitening_filter(weights(drive), samples),
    )


def noise_spectrum(balance: TorqueBalance, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,), Hz, and robust one-sided power density (f,), N^2 m^2/Hz, of a residual (n,) less its repeatable part.

    Train data only.
    """
    samples = balance.samples
    residual = balance.repeatable.remove(residual)
    frequency, (blocks,) = _periodograms(samples, [residual])
    if not len(blocks):
        even = np.linspace(0.0, 0.5 / samples.dt, 17)
        return even, np.full(17, 2.0 * samples.dt * np.var(residual[samples.train]))
    return frequency, 2.0 * samples.dt * steady_power(blocks)


def noise_floor(balance: TorqueBalance, residual: np.ndarray) -> float:
    """N m rms of the noise in a residual (n,) less its repeatable part (see `conditioning.noise_floor`)."""
    frequency, power = noise_spectrum(balance, residual)
    steady = math.sqrt(float(np.trapezoid(power, frequency)))
    return common.noise_floor(residual, steady, (balance.train, balance.held_out))


def misfit(balance: TorqueBalance, residual: np.ndarray) -> float:
    """Power of a residual (n,) over that of its noise, at least one: how far a model is from the best that could be known."""
    floor = noise_floor(balance, residual)
    return max(1.0, float(np.mean(residual[balance.train] ** 2)) / max(floor**2, 1e-300))


def surprise(balance: TorqueBalance, residual: np.ndarray) -> float:
    """Minus twice the log-likelihood of a residual (n,) as noise of just its own spectrum, repeatable or not, but for a constant.

    Whittle's: the sum of the logarithms of its power at the frequencies that are compared. It compares models of one recording
    whatever noise models they were fitted under.
    """
    frequency, (blocks,) = _periodograms(balance.samples, [residual])
    power = np.mean(np.abs(blocks) ** 2, axis=0)[frequency <= balance.data.cutoff][1:] if len(blocks) else np.zeros(0)
    if not len(power):
        power = np.mean(residual[balance.train] ** 2, keepdims=True)
    return balance.samples.effective_count * float(np.mean(np.log(np.maximum(power, 1e-300))))


def _periodograms(
    samples: ComparedSamples, series: Sequence[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies (f,), Hz, and spectra (blocks, f) of windowed train data of series (n,); of white noise its deviation."""
    length = block_length(len(samples.rows))
    spectra = periodograms(series, samples.train, samples.stretches, length)
    return np.fft.rfftfreq(length, samples.dt), spectra


def driven_part(noise: NoiseModel, inertial: np.ndarray) -> np.ndarray:
    """An inertial torque (n,), N m, without what is no larger than answers to noise, block by block of time and by frequency."""
    result = np.zeros(len(inertial))
    white = noise.whitening.apply(inertial, noise.samples)
    for s in noise.samples.stretches:
        count = s.stop - s.start
        block = min(1 << BLOCK_EXPONENTS[1], count)
        _, _, spectra = signal.stft(white[s], nperseg=block, scaling="psd")
        power = ndimage.uniform_filter1d(np.abs(spectra) ** 2, NEIGHBOURS, axis=0, mode="nearest")
        _, _, spectra = signal.stft(inertial[s], nperseg=block)
        _, kept = signal.istft(np.where(power > QUIET_MOTION, spectra, 0.0), nperseg=block)
        result[s] = kept[:count]
    return result


def _local_weight(noise: NoiseModel, residual: np.ndarray) -> np.ndarray:
    """1/variance (n,) of the whitened residual relative to the record's: a recording is quieter at rest than in a manoeuvre."""
    samples = noise.samples
    white = noise.whitening.apply(residual, samples)
    window = max(SHORTEST_LEVEL_WINDOW, int(LEVEL_SECONDS / samples.dt))
    power = np.concatenate(
        [
            ndimage.uniform_filter1d(white[s] ** 2, min(window, s.stop - s.start), mode="nearest")
            for s in samples.stretches
        ]
    )
    usual = float(np.median(power[samples.rows]))
    independent = max(window * 2.0 * samples.cutoff * samples.dt, 1.0)
    spread = 1.0 + USUAL_DEVIATIONS * math.sqrt(2.0 / independent)
    return np.asarray(1.0 / np.clip(power / (usual * spread), 1.0, LOUDEST_NOISE))


def with_bias(balance: TorqueBalance, axis: Axis, noise: NoiseModel, residual: np.ndarray | None = None) -> NoiseModel:
    """The model with what of the noise in an axis' residual is in its acceleration, too."""
    if residual is None:
        residual = balance.residual(axis, noise)
    inertial = -balance.jacobian(axis, [INERTIA], noise, residual)[:, 0]
    white = [noise.on_all_samples(x) for x in (noise.whiten(residual), inertial)]
    frequency, spectra = _periodograms(noise.samples, white)
    inside = frequency < noise.samples.cutoff
    in_residual, in_motion = (x[:, inside] for x in spectra)
    driven, count = float(inertial @ inertial), len(noise.samples.rows) / len(frequency)
    frequency = frequency[inside]
    allowed = noise.encoder_share_at(frequency)
    position = np.quantile(balance.data.joined("position")[noise.samples.rows], PLACES)
    bias = attenuation_bias(axis, driven, frequency, in_residual, in_motion, count, allowed, position)
    return replace(noise, bias=bias)
