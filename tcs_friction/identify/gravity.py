"""Whether a recording shows gravity: torque over the position as a sine, and as neither a constant nor a straight line.

Over a short travel a sine, a cosine and a constant are nearly dependent: two of them cancel, with sizes that no torque of the
recording has. So a constant is added to gravity only where it earns its place, and only as large as the torques that were seen.
What does not tell gravity from a straight line may still show the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcs_friction.conditioning.motion import Motion
from tcs_friction.identify.linear_balance import SIGNIFICANT, Balance, linear_balance

CLEARLY = 10.0  # by which Bayes' information criterion has to be better: very strong evidence (Kass & Raftery 1995)
PLAIN, LINE, DRIFT = ("constant",), ("constant", "line"), ("constant", "drift")
GRAVITY, BOTH = ("gravity",), ("constant", "gravity")


@dataclass(frozen=True, eq=False)
class PositionTorque:
    """What the position does, as far as it is told.

    balance: of the torque with it. gravity: sine and cosine, N m. spring: N m/rad, of a straight line that may be either.
    """

    balance: Balance
    gravity: tuple[float, float] | None = None
    spring: float | None = None


def position_torque(motion: Motion, kind: str, largest: float) -> PositionTorque:
    """Of an axis of that kind, whose largest torque is `largest`, N m.

    Gravity where it does clearly better than a straight line, a straight line where that does clearly better than a constant and
    than a drift over time, which is the same for an axis that never comes back.
    """
    plain, line, drift = (linear_balance(motion, shape) for shape in (PLAIN, LINE, DRIFT))
    if kind == "rotary":
        alone, both = linear_balance(motion, GRAVITY), linear_balance(motion, BOTH)
        for one, others in ((both, (plain, line, drift, alone)), (alone, (plain, line, drift))):
            if all(one.gain(other) > CLEARLY for other in others) and _possible(one, motion, largest):
                return PositionTorque(one, gravity=(float(one.values[-2]), float(one.values[-1])))
    rate = float(line.values[-1])
    if min(line.gain(plain), line.gain(drift)) > CLEARLY and abs(rate) * np.ptp(motion.position) <= 2.0 * largest:
        return PositionTorque(line, spring=rate)
    return PositionTorque(plain)


def _possible(balance: Balance, motion: Motion, largest: float) -> bool:
    """Whether its gravity is known at all, and neither that nor its constant larger than any torque over the travel."""
    sine, cosine = balance.values[-2:]
    gravity = np.abs(sine * np.sin(motion.position) + cosine * np.cos(motion.position))
    known = math.hypot(sine, cosine) > SIGNIFICANT * math.hypot(*balance.std[-2:])
    sizes = [float(gravity.max()), *np.abs(balance.values[3:-2]).tolist()]
    return known and max(sizes) <= largest
