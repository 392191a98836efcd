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

from tcs_friction.diagnose.bodies import motion_gain, swinging
from tcs_friction.diagnose.free import Free, moved
from tcs_friction.physics.axis import Axis

NEIGHBOURS = 129  # frequencies, over which the power near one of them is averaged
QUIET = 10.0  # times the noise power: motion below it answers noise alone
LINE = 16.0  # times the noise power: a line, and no noise
KNOWN = 10.0  # times the power of quiet motion, that of driven motion from which a recording says what the inertia is


@dataclass(frozen=True, eq=False)
class Attenuation:
    """What noise feigns at blocks of frequencies (m,), Hz.

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

    def slope(self, axis: Axis, free: Sequence[Free]) -> np.ndarray:
        """Derivative of `feigned` by the free numbers (k,)."""
        slope = np.zeros(len(free))
        for k, f in enumerate(free):
            if f.owner == -2 or (f.owner >= 0 and axis.effects[f.owner].term.swings):
                slope[k] = (self.feigned(moved(axis, free, k, f.scale)) - self.feigned(axis)) / f.scale
        return slope


def attenuation(
    axis: Axis, frequency: np.ndarray, residual: np.ndarray, inertial: np.ndarray, noise: float, allowed: np.ndarray
) -> Attenuation:
    """From the spectra of an axis' whitened residual and inertial torque, both (n,) complex at frequencies in even steps.

    `noise`: power of noise in the residual's; `allowed` (n,): share of it that the residual takes out of bodies by itself. Where
    hardly anything drives the axis its inertia is not known, and the one that predicts best stays.
    """
    power = np.abs(inertial) ** 2
    driven = ndimage.uniform_filter1d(power, NEIGHBOURS, mode="nearest") > QUIET * noise
    quiet = np.flatnonzero(~driven & (np.abs(residual) ** 2 < LINE * noise))
    if len(quiet) < NEIGHBOURS or np.sum(power[driven]) < KNOWN * np.sum(power[~driven]):
        return Attenuation()
    common = ndimage.uniform_filter1d(-(np.conj(residual) * inertial).real[quiet], NEIGHBOURS, mode="nearest")
    common = np.interp(np.arange(len(frequency)), quiet, common)
    starts = np.arange(0, len(frequency), NEIGHBOURS)
    counts = np.diff(np.append(starts, len(frequency)))
    whole, bodies = (4.0 * np.add.reduceat(x, starts) for x in (common, common - noise * allowed))
    return Attenuation(axis.inertia, np.add.reduceat(frequency, starts) / counts, whole, bodies)
