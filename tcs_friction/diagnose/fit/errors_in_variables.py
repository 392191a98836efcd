"""Bias of the inertia by noise in the measured acceleration (errors in variables), and its correction.

In: spectra of an axis' whitened residual and of its whitened inertial torque. Out: the squares that noise alone takes away
when an axis moves less inertia. A joint fit adds them back (bias-compensated least squares; Soderstrom, Automatica 43 (2007)
939).

The encoder's noise is differentiated twice and is in the acceleration. A torque that is not logged moves the axis, and the
controller answers it. Either way residual and acceleration correlate, and least squares reduce the residual by a smaller
inertia: attenuation. The correlation is measured at frequencies at which nothing else moves the axis.

Where bodies make the required torque G(f) times that of the inertia, maximum likelihood with the noise S of the drive and of the
encoder, of which the latter is the share e, has the cost

    sum |r|^2 / (S A^2) + log A^2 - c log |G|^2,   A^2 = 1 + e (|G|^2 - 1)

with c = 1 where all of the drive's noise is in the acceleration. Residuals are divided by A already; the logarithms are added
here, with the c that was measured. Without log A^2 a body without damping would explain anything near its antiresonance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.parameters import FreeNumber, Part, moved
from tcs_friction.diagnose.fit.second_body import motion_gain, resonant_bodies
from tcs_friction.physics.axis import Axis

SMOOTHED_BINS = 9  # frequencies averaged for one estimate of power: 18 degrees of freedom, a scatter of a third
FEWEST_QUIET_BLOCKS = 8  # at a frequency, from which their mean correlation is known to about a third of its own scatter
DETERMINED_BY = 10.0  # times the power of quiet motion that all motion must have for the recording to determine the inertia
QUIET_MOTION = 10.0  # times the noise power; motion below it answers noise alone, driven motion is orders of magnitude above
SPECTRAL_LINE = 16.0  # times the noise power; white noise exceeds it once in exp(16), so it is a line


@dataclass(frozen=True, eq=False)
class AttenuationBias:
    """Squares that noise takes away from an axis with less inertia, at frequencies (m,), Hz.

    whole (m,): whitened squares for each unit by which the logarithm of the moving inertia is smaller. count: whitened numbers
    that each frequency stands for. allowed (m,): share of the noise that residuals are corrected for where bodies swing.
    inertia: kg m^2, of the axis whose noise it is. determined: the inertia is, by motion that is driven; where it is not, noise
    takes squares away and gives none.
    """

    inertia: float = 1.0
    determined: bool = True
    frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    whole: np.ndarray = field(default_factory=lambda: np.zeros(0))
    count: float = 0.0
    allowed: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def squares(self, axis: Axis) -> float:
        """Whitened squares by which noise makes the residual of an axis smaller; negative for a heavier axis."""
        heavier, whole = axis.inertia / self.inertia, float(np.sum(self.whole))
        squares = max(-whole * math.log(heavier), -whole * (heavier - 1.0), -math.inf if self.determined else 0.0)
        if resonant_bodies(axis):
            gain = np.abs(motion_gain(axis, self.frequency)) ** 2
            common = np.minimum(self.whole, 2.0 * self.count)
            squares += float(self.count * np.sum(np.log(1.0 + self.allowed * (gain - 1.0))) - 0.5 * common @ np.log(gain))
        return squares

    def squares_of_torque(self, axis: Axis) -> np.ndarray:
        """The same for the torque residual, at each frequency (m,)."""
        heavier = np.abs(motion_gain(axis, self.frequency)) * axis.inertia / self.inertia
        return -self.whole * np.log(heavier)

    def gradient(self, axis: Axis, free: Sequence[FreeNumber]) -> np.ndarray:
        """Derivative of `squares` by the free numbers (k,)."""
        gradient, here = np.zeros(len(free)), self.squares(axis)
        for k, number in enumerate(free):
            effect = number.item(axis)
            if number.part is Part.INERTIA or (effect is not None and effect.term.resonates):
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
) -> AttenuationBias:
    """The bias from spectra (blocks, m) of an axis' whitened residual and inertial torque at `frequency` (m,), Hz.

    White noise has spectra of deviation one. driven: all squares of the whitened inertial torque. count: whitened numbers that
    each frequency stands for. allowed (m,): share of the noise that the residual corrects for bodies by itself. No bias is
    returned where no frequency is quiet for long enough.
    """
    power = np.abs(inertial) ** 2
    slow = ndimage.uniform_filter1d(power, SMOOTHED_BINS, axis=1, mode="nearest") < QUIET_MOTION
    quiet = slow & (np.abs(residual) ** 2 < SPECTRAL_LINE)
    known = np.flatnonzero(np.sum(quiet, axis=0) >= FEWEST_QUIET_BLOCKS)
    if not len(known):
        return AttenuationBias()
    determined = driven >= DETERMINED_BY * count * len(frequency) * float(np.mean(power, where=quiet))
    common = np.mean(-(np.conj(residual) * inertial).real[:, known], axis=0, where=quiet[:, known])
    common = ndimage.uniform_filter1d(common, SMOOTHED_BINS, mode="nearest")
    share = np.interp(frequency, np.append(0.0, frequency[known]), np.append(0.0, common))  # a loop has no error at rest
    return AttenuationBias(axis.inertia, determined, frequency, 2.0 * count * share, count, allowed)
