"""Attenuation: noise that is in the measured acceleration, too, makes an axis seem lighter than it is.

The encoder's noise is differentiated twice; a torque that is not logged moves the axis, and the controller answers. Either way
residual and acceleration correlate, and least squares take some of the noise away by a smaller inertia: the bias of errors in
variables, in a closed loop. How much the two have in common is seen at frequencies at which nothing else moves the axis, and is
taken off the normal equations (bias-compensated least squares; Soderstrom, Automatica 43 (2007) 939).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.parameters import Free, moved
from tcs_friction.diagnose.fit.second_body import motion_gain, swinging
from tcs_friction.physics.axis import Axis

ALIKE = 9  # frequencies, over which the power near one of them is averaged
FEWEST = 8  # quiet blocks at a frequency, from which it says something
QUIET = 10.0  # times the noise power: motion below it answers noise alone
LINE = 16.0  # times the noise power: a line, and no noise
KNOWN = 10.0  # times the power of quiet motion, that of all motion from which a recording says what the inertia is


@dataclass(frozen=True, eq=False)
class Attenuation:
    """What noise feigns at frequencies (m,), Hz.

    `whole`, `bodies` (m,): whitened squares that noise takes away for each unit by which the logarithm of the moving inertia is
    smaller, by the inertia or by bodies that swing on it. `inertia`: that of the axis whose noise it is, kg m^2.
    """

    inertia: float = 1.0
    frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    whole: np.ndarray = field(default_factory=lambda: np.zeros(0))
    bodies: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def feigned(self, axis: Axis) -> float:
        """Whitened squares that an axis owes to noise alone, by moving less inertia."""
        feigned = -math.log(axis.inertia / self.inertia) * float(np.sum(self.whole))
        if swinging(axis):
            feigned -= float(self.bodies @ np.log(np.abs(motion_gain(axis, self.frequency))))
        return feigned

    def in_torque(self, axis: Axis) -> np.ndarray:
        """Whitened squares at each frequency (m,) that an axis' torque residual owes to noise alone."""
        heavier = np.abs(motion_gain(axis, self.frequency)) * axis.inertia / self.inertia
        return -self.whole * np.log(heavier)

    def slope(self, axis: Axis, free: Sequence[Free]) -> np.ndarray:
        """Derivative of `feigned` by the free numbers (k,)."""
        slope, here = np.zeros(len(free)), self.feigned(axis)
        for k, f in enumerate(free):
            if f.owner == -2 or (f.owner >= 0 and axis.effects[f.owner].term.swings):
                slope[k] = (self.feigned(moved(axis, free, k, f.scale)) - here) / f.scale
        return slope


def attenuation(
    axis: Axis,
    driven: float,
    frequency: np.ndarray,
    residual: np.ndarray,
    inertial: np.ndarray,
    count: float,
    allowed: np.ndarray,
) -> Attenuation:
    """From spectra (blocks, m) of an axis' whitened residual and inertial torque, noise of the residual one, at `frequency` (m,).

    `driven`: all squares of the whitened inertial torque; `count`: whitened numbers that each frequency stands for; `allowed`
    (m,): share of the noise that the residual takes out of bodies by itself. Where hardly anything drives the axis its inertia is
    not known, and the one that predicts best stays.
    """
    power = np.abs(inertial) ** 2
    calm = ndimage.uniform_filter1d(power, ALIKE, axis=1, mode="nearest") < QUIET
    quiet = calm & (np.abs(residual) ** 2 < LINE)
    known = np.flatnonzero(np.sum(quiet, axis=0) >= FEWEST)
    answers = count * len(frequency) * np.mean(power, where=quiet) if len(known) else math.inf
    if driven < KNOWN * answers:
        return Attenuation()
    common = np.mean(-(np.conj(residual) * inertial).real[:, known], axis=0, where=quiet[:, known])
    common = ndimage.uniform_filter1d(common, ALIKE, mode="nearest")
    share = np.interp(frequency, np.append(0.0, frequency[known]), np.append(0.0, common))  # a loop has no error at rest
    return Attenuation(axis.inertia, frequency, 2.0 * count * share, 2.0 * count * (share - allowed))
