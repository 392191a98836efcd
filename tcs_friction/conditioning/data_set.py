"""What a diagnosis works on: recordings on one even time base, filtered, and divided into train and held-out data.

Motion and torque are evaluated at every sample of a stretch, because a bristle needs finer steps than a comparison. Torques are
compared at every `stride`-th sample, after `narrowed` has taken away what lies above the cutoff.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tcs_friction.conditioning.timing import LogTiming

MOVING = 3.0  # standard deviations of the velocity's noise: at rest one sample in 370 seems faster
RESOLVED = 2.0  # standard deviations of the velocity's noise over which a law's jump at rest is spread
LEAST_SPEED = 1e-12  # rad/s, so that nothing is divided by zero where a simulated motion has no noise
NARROWING_PERIODS = 2.0  # of the cutoff on each side: a Hann window so long stops 99 % at 1.4 cutoffs
HIGHEST_EDGE = 0.99  # of Nyquist's frequency; a filter's edge must be below it
COMPARED = ("train", "held_out", "untouched", "piece")  # arrays that have compared samples only


@dataclass(frozen=True, eq=False)
class Stretch:
    """A gap-free, evenly sampled, filtered piece of a recording.

    t (s, of the recording), position (rad), velocity (rad/s), acceleration (rad/s^2), torque (N m): (n,), evaluated samples.
    signals (1 + s, n): temperature (degC), then exogenous signals. train, held_out (m,): which compared samples may be fitted and
    which nothing is fitted to; untouched (m,): by which nothing is chosen either. In none are edges, and gaps between them.
    piece (m,): number of the block of the data, which is as long as a held-out one. resting (n,): where the axis rests and
    friction is unknown; nothing is compared there.
    reference (3, n): position, speed and acceleration that the controller was given, through the same filter; None: not recorded.
    """

    t: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    signals: np.ndarray
    train: NDArray[np.bool_]
    held_out: NDArray[np.bool_]
    untouched: NDArray[np.bool_]
    piece: NDArray[np.int64]
    resting: NDArray[np.bool_]
    reference: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class DataSet:
    """Recordings ready for torque balances.

    period: of the recorded samples, s. dt: between compared samples, s; every `stride`-th evaluated sample is compared.
    cutoff: up to which torques are compared, Hz. velocity_noise: rad/s rms left in the velocity. position_noise: rad rms before
    filtering. position_step: of the encoder, rad, where no noise blurs it, else 0. names: of the exogenous signals.
    temperature: whether it was recorded. notes: what was found and done, one line each. timings: of the torque of each recording.
    """

    stretches: tuple[Stretch, ...]
    period: float
    dt: float
    stride: int
    cutoff: float
    velocity_noise: float
    position_noise: float
    position_step: float
    names: tuple[str, ...]
    temperature: bool
    notes: tuple[str, ...]
    timings: tuple[LogTiming, ...] = ()

    @property
    def leeway(self) -> float:
        """s by which the torque may act sooner or later than it stands here, which is the log's sampling and no physics."""
        return max((timing.leeway for timing in self.timings), default=0.5 * self.period)

    @property
    def nyquist(self) -> float:
        """Hz, half the rate at which position and torque are new."""
        return 0.5 / max(self.period, 2.0 * self.leeway)

    def joined(self, name: str) -> np.ndarray:
        """One quantity of the stretches (..., n) at the samples that are compared, over all of them."""
        step = 1 if name in COMPARED else self.stride
        return np.concatenate([getattr(s, name)[..., ::step] for s in self.stretches], axis=-1)

    @cached_property
    def train(self) -> NDArray[np.bool_]:
        """(n,) Which compared samples may be fitted."""
        return _fixed(self.joined("train"))

    @cached_property
    def held_out(self) -> NDArray[np.bool_]:
        """(n,) Which compared samples are kept for the comparison of finished models."""
        return _fixed(self.joined("held_out"))

    @cached_property
    def untouched(self) -> NDArray[np.bool_]:
        """(n,) Which compared samples nothing looks at before all is decided; none of a short recording."""
        return _fixed(self.joined("untouched"))

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """(n,) Where the axis rests at compared samples, and friction is unknown."""
        return _fixed(self.joined("resting"))

    @cached_property
    def piece(self) -> NDArray[np.int64]:
        """(n,) Number of the block that each compared sample is in."""
        return _fixed(self.joined("piece"))

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """(s + 1,) Where each stretch begins among the compared samples, and their number."""
        return _fixed(np.cumsum([0, *(len(s.train) for s in self.stretches)], dtype=np.int64))

    @property
    def speed_threshold(self) -> float:
        """rad/s above which the direction of motion is known."""
        return MOVING * self.velocity_noise

    @property
    def speed_resolution(self) -> float:
        """rad/s over which the jump of a friction law at rest is spread: the sign of a slower motion is half noise."""
        return max(RESOLVED * self.velocity_noise, LEAST_SPEED)

    def moving(self, factor: float = 1.0) -> NDArray[np.bool_]:
        """(n,) Which compared samples are faster than `factor` times the speed threshold."""
        return np.asarray(np.abs(self.joined("velocity")) > factor * self.speed_threshold)

    def narrowed(self, x: np.ndarray) -> np.ndarray:
        """A torque (n,) of one stretch at the samples that are evaluated, low-passed at the cutoff where it is compared."""
        taps = len(self._narrowing) // 2
        filtered = signal.upfirdn(self._narrowing, x, down=self.stride, mode="edge")
        first = taps // self.stride
        return np.ascontiguousarray(filtered[first : first - (-len(x) // self.stride)])

    @cached_property
    def _narrowing(self) -> np.ndarray:
        """Low pass of torques at the evaluated samples: a whole number of compared samples on each side."""
        taps = self.stride * math.ceil(NARROWING_PERIODS / (self.cutoff * self.dt))
        edge = min(2.0 * self.cutoff * self.dt / self.stride, HIGHEST_EDGE)
        return np.asarray(signal.firwin(2 * taps + 1, edge, window="hann"))


def _fixed(values: np.ndarray) -> np.ndarray:
    values.setflags(write=False)
    return values
