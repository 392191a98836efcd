"""A torque against speed: its mean in bins of speed, how it scatters there and how exactly the mean is known, beside models.

Bins have equal widths of asinh(v / width): of equal width near zero speed, by decades beyond it, as Stribeck friction and the
motion before sliding are seen at speeds that are decades apart. None reaches across zero, since friction has another sign there.
Samples of an axis that speeds up and of one that slows down are kept apart: after a reversal friction first has to build up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BINS, LEAST_BINS = 40, 6  # each way
ENOUGH = 8.0  # samples in a bin, if they spread evenly over both ways and directions
FEWEST = 4  # samples in a bin that is shown
DECADES = 4.0  # of speed at most that are told apart
SLOW_SHARE = 0.03  # of the moving samples, which lie in the even part of the scale
LINEAR_BINS = 3.0  # bins in the even part at least, each way
LAG = 8  # samples, after which the noise of a low-passed acceleration has forgotten itself
CLOUD = 4000  # samples that are shown by themselves
UNCORRELATED = 0.05  # autocorrelation below which samples count as independent


@dataclass(frozen=True, eq=False)
class Model:
    """A model's torque in the bins of a `TorqueBySpeed` (k,) along the same motion, and its standard deviation, if known (k,)."""

    torque: Array
    std: Array | None = None


@dataclass(frozen=True, eq=False)
class TorqueBySpeed:
    """Measured torque and models of it in bins of speed, units of the recording.

    speed (k,): mean speed in a bin, rising among the bins of each way. speeding_up (k,): whether |v| grew. measured (k,): mean
    torque. scatter (k,): standard deviation of the samples.
    error (k,): of the mean, by samples that are no more independent than the residual shows. models: by name.
    width: speed below which the scale is even. cloud: speed and torque of single samples (2, m).
    """

    speed: Array
    speeding_up: NDArray[np.bool_]
    measured: Array
    scatter: Array
    error: Array
    models: Mapping[str, Model]
    width: float
    cloud: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "models", MappingProxyType(dict(self.models)))

    def residual(self, name: str) -> Array:
        """(k,) measured less a model."""
        return self.measured - self.models[name].torque


@dataclass(frozen=True, eq=False)
class SpeedBins:
    """Which bin every sample is in (n,), from 0, or -1 for none; speeding_up (k,): of each bin. width: as in `TorqueBySpeed`."""

    index: NDArray[np.intp]
    speeding_up: NDArray[np.bool_]
    width: float

    @property
    def count(self) -> int:
        """How many bins there are."""
        return len(self.speeding_up)

    def mean(self, values: Array) -> Array:
        """Mean in each bin of values (n,) or of columns (n, p)."""
        if values.ndim > 1:
            return np.stack([self.mean(column) for column in values.T], axis=1)
        inside = self.index >= 0
        index = self.index[inside]
        return np.asarray(np.bincount(index, values[inside], self.count) / np.bincount(index, minlength=self.count))

    def std(self, values: Array) -> Array:
        """Standard deviation (k,) in each bin of values (n,)."""
        mean = self.mean(values)
        return np.sqrt(self.mean(np.square(values - mean[self.index])))

    def independent(self, correlated: float) -> Array:
        """Independent samples (k,) in each bin, if samples that follow one another are so for `correlated` of them."""
        change = np.flatnonzero(np.diff(self.index, prepend=self.index[:1] - 1))
        lengths = np.diff(np.append(change, len(self.index)))
        visited = self.index[change]
        inside = visited >= 0
        weights = np.maximum(lengths[inside] / correlated, 1.0)
        return np.asarray(np.bincount(visited[inside], weights=weights, minlength=self.count), np.float64)


def speed_bins(velocity: Array, resolution: float, counted: NDArray[np.bool_] | None = None) -> SpeedBins:
    """Bins for a motion (n,).

    resolution: speed that cannot be told from rest. counted (n,): samples that are used, by default all.
    Whether an axis speeds up is seen from samples before and after: the noise of the acceleration, which is in the measured
    friction too, must not decide on which side a sample counts.
    """
    counted = np.isfinite(velocity) if counted is None else counted & np.isfinite(velocity)
    counted = counted & (velocity != 0.0)
    speed = np.abs(velocity[counted])
    if not len(speed):
        return SpeedBins(np.full(len(velocity), -1, np.intp), np.zeros(0, bool), 1.0)
    fastest, moving = float(speed.max()), speed[speed > resolution]
    width = max(float(np.quantile(moving, SLOW_SHARE)) if len(moving) else 0.0, resolution, fastest * 10.0**-DECADES)
    bins = min(max(len(speed) / (4.0 * ENOUGH), LEAST_BINS), BINS)
    step = min(np.arcsinh(fastest / width) / bins, np.arcsinh(1.0) / LINEAR_BINS)
    place = np.floor(np.arcsinh(velocity[counted] / width) / step)
    at = np.arange(len(velocity))
    change = velocity[np.minimum(at + LAG, len(at) - 1)] - velocity[np.maximum(at - LAG, 0)]
    grows = (velocity * change > 0.0)[counted]
    keys = np.stack([grows, place])
    found, index, counts = np.unique(keys, axis=1, return_inverse=True, return_counts=True)
    shown = counts >= FEWEST
    chosen = np.full(len(velocity), -1, np.intp)
    chosen[counted] = np.where(shown, np.cumsum(shown) - 1, -1)[index.ravel()]
    return SpeedBins(chosen, found[0, shown] > 0.0, width)


def torque_by_speed(
    bins: SpeedBins, velocity: Array, measured: Array, models: Mapping[str, Array], stds: Mapping[str, Array], best: str
) -> TorqueBySpeed:
    """Measured torque (n,) and models of it (n,) along the same motion, in bins.

    stds: of models in the bins (k,), by name. best: the model whose residual says how noisy the measured torque is.
    """
    residual = measured - models[best]
    inside = np.flatnonzero(bins.index >= 0)
    few = inside[:: max(1, len(inside) // CLOUD)]
    return TorqueBySpeed(
        speed=bins.mean(velocity),
        speeding_up=bins.speeding_up,
        measured=bins.mean(measured),
        scatter=bins.std(measured),
        error=bins.std(residual) / np.sqrt(np.maximum(bins.independent(correlated_samples(residual[inside])), 1.0)),
        models={name: Model(bins.mean(torque), stds.get(name)) for name, torque in models.items()},
        width=bins.width,
        cloud=np.stack([velocity[few], measured[few]]),
    )


def correlated_samples(residual: Array) -> float:
    """Over how many samples a residual (n,) repeats itself: the sum of its autocorrelation until that is gone, at least 1."""
    n = len(residual)
    if n < FEWEST or not np.ptp(residual) > 0.0:
        return 1.0
    size = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(residual - residual.mean(), size)) ** 2
    correlation = np.fft.irfft(power, size)[: n // 2]
    correlation /= correlation[0]
    gone = np.flatnonzero(correlation < UNCORRELATED)
    return max(1.0, float(1.0 + 2.0 * correlation[1 : gone[0] if len(gone) else None].sum()))


def linear_std(bins: SpeedBins, derivatives: Array, covariance: Array) -> Array:
    """Standard deviation (k,) of a model's mean torque in bins: derivatives by its parameters (n, p), their covariance (p, p)."""
    slopes = bins.mean(derivatives)
    return np.asarray(np.sqrt(np.maximum(np.einsum("kp,pq,kq->k", slopes, covariance, slopes), 0.0)))
