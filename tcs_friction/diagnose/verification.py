"""Effects of the sensor, judged by the torque balance of a recording that no fit has seen.

The tracking error cannot judge an error of the encoder: the same encoder measures it. A controller that is told the error moves
the axis better, and the encoder reads worse. In the torque balance the error is an acceleration that never was. If what is
believed of it is right, the model leaves less torque unexplained with it than without it, also in a recording made afterwards.
With a wrong sign, phase or order it leaves more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.control.guard import WINDOW, Gain
from tcs_friction.control.model_compensator import effect_names
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.noise import NoiseModel, white_noise
from tcs_friction.diagnose.fit.noise_estimate import estimated
from tcs_friction.diagnose.pipeline import FORGOTTEN
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Place
from tcs_friction.recording.recording import Recording

Array = NDArray[np.float64]


def sensor_effects(model: Axis) -> list[str]:
    """Names of the effects of an axis that act on what is measured."""
    return [name for name, item in effect_names(model).items() if item.term.place is Place.SENSOR]


def sensor_gains(recordings: Sequence[Recording], model: Axis, names: Sequence[str]) -> Mapping[str, Gain]:
    """What each of these effects of the sensor is worth in the torque balance of recordings that the model was not fitted to.

    A gain is the rms of the whitened residual in windows of a second, without the effect and with it, in standard deviations of
    the noise. The noise is that of the whole model, so that the part of it that is right counts in both.

    Raises InputError when the recordings cannot carry a torque balance.
    """
    law = model.friction.term
    data = prepare(recordings, held_out=False, memory=FORGOTTEN * model.bristle, at_rest=not law.without_memory)
    balance = TorqueBalance(data)
    noise = estimated(balance, model, white_noise(balance.samples))
    items = effect_names(model)
    complete = _left(balance, noise, model)
    return {name: Gain.of(_left(balance, noise, model.without_effect(items[name])), complete) for name in names}


def _left(balance: TorqueBalance, noise: NoiseModel, axis: Axis) -> Array:
    """Rms (w,) of the whitened residual in every window that has rows."""
    samples = noise.samples
    power = noise.whiten(balance.residual(axis, noise)) ** 2
    windows = samples.rows // max(1, round(WINDOW / samples.dt))
    count = np.bincount(windows)
    kept = count > 0
    return np.asarray(np.sqrt(np.bincount(windows, power)[kept] / count[kept]))
