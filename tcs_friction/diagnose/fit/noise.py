"""The noise of a torque residual: a frozen model that every fit carries.

In: a residual r(t) (n,), N m, on the samples that are compared. Out: its whitened form w = h * r, whose squares add up to a
chi-squared, and the squares of a spectrum of it.

    |H(f)|^2 = 2 dt / S(f)        S: one-sided power density of the noise, N^2 m^2/Hz

The filter h is symmetric (zero phase), so that whitening is its own adjoint. Two fits can be compared only under one and the same
noise model: their squares are in units of it. Source: prewhitening, Ljung, System Identification (1999), section 7.4.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import fft, ndimage

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose.fit.errors_in_variables import AttenuationBias

MOST_TRIMMED = 0.01  # of the train data: the ends of a recording of minutes are less


@dataclass(frozen=True, eq=False)
class ComparedSamples:
    """Which samples of the stretches count in a fit.

    dt: s between samples. cutoff: Hz, up to which torques are compared. ends (s + 1,): where each stretch begins, and n.
    train, held_out, untouched (n,) bool. pieces (n,): number of the block of the data. rows (m,): train samples whose whole
    whitening filter, `half_length` samples on either side, lies in train data.
    """

    dt: float
    cutoff: float
    ends: np.ndarray
    train: np.ndarray
    held_out: np.ndarray
    untouched: np.ndarray
    pieces: np.ndarray
    half_length: int
    rows: np.ndarray

    @property
    def stretches(self) -> list[slice]:
        """The samples of each stretch."""
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(self.ends)]

    @property
    def effective_count(self) -> float:
        """Independent samples among the rows: the band ends at the cutoff."""
        return len(self.rows) * min(1.0, 2.0 * self.cutoff * self.dt)

    @property
    def frequencies(self) -> np.ndarray:
        """Frequencies of a spectrum over all samples: even steps up to half the rate, Hz."""
        return np.fft.rfftfreq(len(self.train), self.dt)

    @property
    def white_level(self) -> float:
        """Expected squares of white noise of unit variance in a `NoiseModel.spectrum` at each frequency."""
        return 2.0 * len(self.rows) / len(self.train)


def compared_samples(data: DataSet, half_length: int) -> ComparedSamples:
    """The samples of a data set that count in a fit with a whitening filter of `half_length` samples on either side.

    What begins or ends a recording, closer to its end than the filter's length, is in no row: no fit sees how the drive begins
    or stops there. It is not judged either, unless that would be more than MOST_TRIMMED of the train data.
    """
    usable = data.train | data.resting
    inside = [
        ndimage.minimum_filter1d(usable[a:b].astype(np.uint8), 2 * half_length + 1, mode="constant").astype(bool)
        for a, b in itertools.pairwise(data.ends)
    ]
    fitted = np.concatenate(inside) & data.train
    train = data.train.copy()
    for a, b in itertools.pairwise(data.ends):
        seen = np.flatnonzero(fitted[a:b])
        if len(seen):
            train[a : a + seen[0]] = train[a + seen[-1] + 1 : b] = False
    if train.sum() < (1.0 - MOST_TRIMMED) * data.train.sum():
        train = data.train
    rows = np.flatnonzero(fitted)
    return ComparedSamples(data.dt, data.cutoff, data.ends, train, data.held_out, data.untouched, data.piece, half_length, rows)


@dataclass(frozen=True, eq=False)
class Whitening:
    """A symmetric filter with its response for the transform of each stretch."""

    weights: np.ndarray  # (2 half + 1,)
    responses: tuple[tuple[int, np.ndarray], ...]  # size of the transform and real response, one for each stretch

    def apply(self, x: np.ndarray, samples: ComparedSamples) -> np.ndarray:
        """A series (n,) or (n, k) through the filter, stretch by stretch."""
        parts = []
        for stretch, (size, response) in zip(samples.stretches, self.responses, strict=True):
            spectrum = fft.rfft(x[stretch], size, axis=0)
            spectrum *= response if x.ndim == 1 else response[:, None]
            count = stretch.stop - stretch.start
            parts.append(fft.irfft(spectrum, size, axis=0, overwrite_x=True)[:count])
        return np.concatenate(parts)

    def squared_gain(self, frequency: np.ndarray, dt: float) -> np.ndarray:
        """Squared gain at frequencies (Hz) of any shape; beyond the last frequency that of it."""
        count = 8 * len(self.weights)
        response = np.abs(np.fft.rfft(self.weights, count)) ** 2
        return np.interp(frequency, np.fft.rfftfreq(count, dt), response)


def whitening_filter(weights: np.ndarray, samples: ComparedSamples) -> Whitening:
    """The filter with these symmetric weights (2 half + 1,)."""
    half = len(weights) // 2
    known: dict[int, np.ndarray] = {}
    responses = []
    for stretch in samples.stretches:
        size = int(fft.next_fast_len(stretch.stop - stretch.start + half, real=True))
        if size not in known:
            turned = np.zeros(size)
            turned[: half + 1], turned[size - half :] = weights[half:], weights[:half]
            known[size] = fft.rfft(turned).real
        responses.append((size, known[size]))
    return Whitening(weights, tuple(responses))


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of the torque residual on the samples that are compared.

    whitening: scaled so that whitened noise has variance one. drive_whitening: the same filter with each frequency weighted by
    the share of its noise that does not come from the encoder. encoder_share (f,): share of the encoder, through the inertia, in
    the noise power at even steps of frequency up to half the rate. local_weight (n,): 1/variance of the whitened noise relative
    to that of the whole record. bias: what noise in the acceleration does to squares.
    """

    samples: ComparedSamples
    whitening: Whitening
    drive_whitening: Whitening
    encoder_share: np.ndarray
    local_weight: np.ndarray
    bias: AttenuationBias = field(default_factory=AttenuationBias)

    @property
    def drive_bias(self) -> AttenuationBias:
        """The bias of squares that are weighted by the share of the noise that does not come from the encoder."""
        weight = (1.0 - self.encoder_share_at(self.bias.frequency)) ** 2
        return replace(self.bias, weight=weight)

    def encoder_share_at(self, frequency: np.ndarray) -> np.ndarray:
        """Share of the encoder in the noise power at frequencies (k,), Hz."""
        even = np.linspace(0.0, 0.5 / self.samples.dt, len(self.encoder_share))
        return np.interp(frequency, even, self.encoder_share)

    def whiten(self, x: np.ndarray, drive_only: bool = False) -> np.ndarray:
        """Whitened rows (m,) or (m, k) of a series (n,) or (n, k).

        `drive_only`: weighted by the share of the noise that does not come from the encoder.
        """
        filtered = (self.drive_whitening if drive_only else self.whitening).apply(x, self.samples)[self.samples.rows]
        return filtered * (self._local if x.ndim == 1 else self._local[:, None])

    def unwhiten(self, white: np.ndarray) -> np.ndarray:
        """The adjoint of `whiten`: the (n,) series whose scalar product with any x is that of `white` (m,) with whitened x."""
        return self.whitening.apply(self.on_all_samples(white * self._local), self.samples)

    @cached_property
    def _local(self) -> np.ndarray:
        """What the local weight makes of the rows (m,)."""
        return np.sqrt(self.local_weight[self.samples.rows])

    def spectrum(self, residual: np.ndarray) -> np.ndarray:
        """Whitened squares of a residual (n,) on the rows, at each of `samples.frequencies`."""
        count = len(self.samples.train)
        power = np.abs(np.fft.rfft(self.on_all_samples(self.whiten(residual)))) ** 2 / count
        power[1 : (count + 1) // 2] *= 2.0
        return np.asarray(power)

    def on_all_samples(self, white: np.ndarray) -> np.ndarray:
        """Whitened rows (m,) among zeros (n,)."""
        full = np.zeros(len(self.samples.train))
        full[self.samples.rows] = white
        return full


@dataclass(frozen=True, eq=False)
class Squares:
    """A whitened sum of squares, which can be compared under the same noise model only."""

    value: float
    noise: NoiseModel

    def __sub__(self, other: Squares) -> float:
        """The difference. Raises ValueError for squares under another noise model: they have another unit."""
        if self.noise is not other.noise:
            raise ValueError("squares under different noise models cannot be compared")
        return self.value - other.value

    @property
    def dispersion(self) -> float:
        """Squares per independent sample, at least one: how much larger than its estimate the noise is."""
        return max(1.0, self.value / self.noise.samples.effective_count)


def white_noise(samples: ComparedSamples) -> NoiseModel:
    """The model before anything is known: white noise of 1 N m."""
    unit = whitening_filter(np.array([1.0]), samples)
    return NoiseModel(samples, unit, unit, np.zeros(2), np.ones(len(samples.train)))
