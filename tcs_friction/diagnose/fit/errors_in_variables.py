"""Bias of the inertia by noise in the measured acceleration (errors in variables), and its correction.

In: spectra of an axis' whitened residual and of its whitened inertial torque. Out: the squares that noise alone takes away
when an axis moves less inertia. A joint fit adds them back (bias-compensated least squares; Soderstrom, Automatica 43 (2007)
939).

The encoder's noise is differentiated twice and is in the acceleration. A torque that is not logged moves the axis, and the
controller answers it. Either way residual and acceleration correlate, and least squares reduce the residual by a smaller
inertia: attenuation. The correlation is measured at frequencies at which nothing else moves the axis.

Where bodies make the required torque G(f) times that of the inertia, maximum likelihood with the noise S of the drive and of the
encoder, of which the latter is the share e, has the cost

    sum |r|^2 / (S A^2) + log A^2 - log |J G s^2 + C|^2,   A^2 = 1 + e (|G|^2 - 1)

with the controller C: what it multiplies by the motion turns into noise, and the last logarithm is that of the Jacobian. C is not
known. The acceleration has the noise of the residual times the sensitivity T = 1 / (1 + C / (J G_0 s^2)) of the loop, which is
measured with the bodies G_0 of the axis so far; but for a constant, the logarithm is that of |G T + G_0 (1 - T)|^2. Residuals are
divided by A already; the logarithms are added here. Without log A^2 a body without damping would explain anything near its
antiresonance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.parameters import FreeNumber, Part, moved
from tcs_friction.diagnose.fit.second_body import log_inertia, motion_gain, resonant_bodies
from tcs_friction.physics.axis import Axis

SMOOTHED_BINS = 9  # frequencies averaged for one estimate of power: 18 degrees of freedom, a scatter of a third
FEWEST_QUIET = 72  # blocks at neighbouring frequencies, from which their mean correlation is known to a tenth of the noise power
DETERMINED_BY = 10.0  # times the power of quiet motion that all motion must have for the recording to determine the inertia
QUIET_MOTION = 10.0  # times the noise power; motion below it answers noise alone, driven motion is orders of magnitude above
LEAST_JACOBIAN = 1e-6  # where it vanishes, the loop is at the edge of stability
SPECTRAL_LINE = 16.0  # times the noise power; white noise exceeds it once in exp(16), so it is a line


@dataclass(frozen=True, eq=False)
class AttenuationBias:
    """Squares that noise takes away from an axis with less inertia, at frequencies (m,), Hz.

    sensitivity (m,): of the loop, complex: what the acceleration has of the noise in the residual. log_inertia, gain (m,): mean
    logarithm of the inertia and the bodies' gain of the axis whose noise it is. position (k,): a sample of where the axis is.
    count: whitened numbers that each frequency stands for. allowed (m,): share of the noise that residuals are corrected for
    where bodies swing. weight (m,): of the squares at each frequency. determined: the inertia is, by motion that is driven;
    where it is not, noise takes squares away and gives none.
    """

    frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sensitivity: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))
    log_inertia: float = 0.0
    gain: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))
    position: np.ndarray = field(default_factory=lambda: np.zeros(1))
    count: float = 0.0
    allowed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    weight: np.ndarray | float = 1.0
    determined: bool = True

    @property
    def whole(self) -> np.ndarray:
        """Whitened squares (m,) for each unit by which the logarithm of the moving inertia is smaller."""
        return np.asarray(2.0 * self.count * self.weight * self.sensitivity.real)

    def squares(self, axis: Axis) -> float:
        """Whitened squares by which noise makes the residual of an axis smaller; negative for a heavier axis."""
        heavier, whole = self._log_heavier(axis), float(np.sum(self.whole))
        squares = max(-whole * heavier, -whole * math.expm1(heavier), -math.inf if self.determined else 0.0)
        if resonant_bodies(axis) or np.any(self.gain != 1.0):
            amplified = np.log(1.0 + self.allowed * (np.abs(motion_gain(axis, self.frequency)) ** 2 - 1.0))
            squares += float(np.sum(self.count * self.weight * amplified - self._by_bodies(axis)))
        return squares

    def _log_heavier(self, axis: Axis) -> float:
        """Mean logarithm of the inertia that moves, over that of the axis whose noise it is."""
        return log_inertia(axis, self.position) - self.log_inertia

    def _by_bodies(self, axis: Axis) -> np.ndarray:
        """Squares (m,) of the Jacobian's logarithm with the bodies of an axis, but for a constant."""
        gain = motion_gain(axis, self.frequency)
        jacobian = np.abs(gain * self.sensitivity + self.gain * (1.0 - self.sensitivity))
        return np.asarray(2.0 * self.count * self.weight * np.log(np.maximum(jacobian, LEAST_JACOBIAN)))

    def squares_of_torque(self, axis: Axis) -> np.ndarray:
        """The same for the torque residual, at each frequency (m,)."""
        return -self.whole * self._log_heavier(axis) - self._by_bodies(axis)

    def gradient(self, axis: Axis, free: Sequence[FreeNumber]) -> np.ndarray:
        """Derivative of `squares` by the free numbers (k,)."""
        gradient, here = np.zeros(len(free)), self.squares(axis)
        for k, number in enumerate(free):
            effect = number.item(axis)
            moves = effect is not None and (effect.term.resonates or effect.term.inertia_over is not None)
            if number.part is Part.INERTIA or moves:
                gradient[k] = (self.squares(moved(axis, free, k, number.step)) - here) / number.step
        return gradient


def attenuation_bias(
    axis: Axis,
    driven: float,
    frequency: np.ndarray,
    residual: np.ndarray,
    inertial: np.ndarray,
    count: float,
    allowed: np.ndarray,
    position: np.ndarray | None = None,
) -> AttenuationBias:
    """The bias from spectra (blocks, m) of an axis' whitened residual and inertial torque at `frequency` (m,), Hz.

    White noise has spectra of deviation one. driven: all squares of the whitened inertial torque. count: whitened numbers that
    each frequency stands for. allowed (m,): share of the noise that the residual corrects for bodies by itself. position (k,): a
    sample of those in which the axis is. No bias is returned where no frequency is quiet for long enough.
    """
    power = np.abs(inertial) ** 2
    slow = ndimage.uniform_filter1d(power, SMOOTHED_BINS, axis=1, mode="nearest") < QUIET_MOTION
    quiet = slow & (np.abs(residual) ** 2 < SPECTRAL_LINE)
    common, known = _correlation(np.sum(-np.conj(residual) * inertial, axis=0, where=quiet), np.sum(quiet, axis=0))
    if not known.any():
        return AttenuationBias()
    determined = driven >= DETERMINED_BY * count * len(frequency) * float(np.mean(power, where=quiet))
    share = np.interp(frequency, np.append(0.0, frequency[known]), np.append(0.0, common[known]))  # a loop has no error at rest
    position = np.zeros(1) if position is None else position
    return AttenuationBias(
        frequency=frequency,
        sensitivity=share,
        log_inertia=log_inertia(axis, position),
        gain=motion_gain(axis, frequency),
        position=position,
        count=count,
        allowed=allowed,
        determined=determined,
    )


def _correlation(products: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean product (m,) of residual and motion in the quiet blocks at each frequency and those next to it, and where it is known.

    products: their sums (m,) over the quiet blocks (m,). The mean spans as many frequencies as have enough of them.
    """
    mean, known, width = np.zeros(len(blocks), complex), np.zeros(len(blocks), bool), SMOOTHED_BINS
    while not known.all() and width < 2 * len(blocks):
        total = width * ndimage.uniform_filter1d(products, width, mode="constant")
        count = width * ndimage.uniform_filter1d(blocks.astype(float), width, mode="constant")
        now = (count > FEWEST_QUIET - 0.5) & ~known
        mean[now], known, width = total[now] / count[now], known | now, 2 * width + 1
    return mean, known
