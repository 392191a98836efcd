"""The floor beneath every diagnosis of a world: the residual that the true model leaves on the held-out data.

The torque noise alone is no floor. The encoder's noise comes into every residual through the inertia, and what the
recording does not show of the bristle's first deflection does, too.
"""

from __future__ import annotations

from tcs_friction.diagnose.dataset.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.pipeline import FORGOTTEN
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording


def attainable(recording: Recording, believed: Axis, true: Axis) -> float:
    """Rms, N m, that the true model leaves on the data that a diagnosis from `believed` holds out.

    Its numbers start at the true ones and are fitted to the other data, as the diagnosis fits its own.
    """
    data = prepare([recording], memory=FORGOTTEN * believed.bristle)
    balance = TorqueBalance(data, believed.actuation_delay)
    fit = settle(balance, true, white_noise(balance.samples))
    return rms(balance.residual(fit.axis, fit.noise)[balance.held_out])
