"""The floor beneath every diagnosis of a world: the residual that the true model leaves on the held-out data.

The torque noise alone is no floor: the encoder's noise comes into every residual through the inertia. A law without a bristle
leaves more, since at rest the measured speed does not tell the direction in which it holds.
"""

from __future__ import annotations

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.pipeline import FORGOTTEN
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording


def attainable(recording: Recording, believed: Axis, true: Axis) -> float:
    """Rms, N m, that the true model leaves on the data that a diagnosis from `believed` holds out.

    The lesser of two: with its true numbers, and with numbers that are fitted to the other data from there, as the diagnosis
    fits its own. At rest a fit can be led away from the true numbers.
    """
    data = prepare([recording], memory=FORGOTTEN * believed.bristle)
    balance = TorqueBalance(data)
    fit = settle(balance, true, white_noise(balance.samples))
    return min(rms(balance.residual(axis, fit.noise)[balance.held_out]) for axis in (true, fit.axis))
