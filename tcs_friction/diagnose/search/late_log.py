"""What the timing of a fit says of the log: whether its torque is held, when it acts, whether it is out of step.

What is held has its middle half a renewal before or after its stamp, a momentary value at its stamp. A fit says which is nearest.

A log may be out of step with its position by more than conventions of stamping allow. No physics lets a torque act before it is
logged: where the fit would have it so, the log is late, by a filter of the drive or by how it was written. A torque that acts
later than its stamp is a matter of the log only where torque and position have clocks of their own; elsewhere it is what a delay
does. Either may also stand for friction that builds up late or for a body that lags. So this is one more explanation of the whole
recording, which is searched for effects like the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.timing import LONGEST, LogTiming, TorqueActs
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.parameters import Part
from tcs_friction.diagnose.search.significance import chance

MIDWAY = 0.5  # of the leeway, half a renewal: the middle of what is held lies that far from the stamp, a momentary value's at it
AT_END = 0.999  # of a reach: steps end at its bound but for rounding, and a value within a thousandth of it tells nothing either

Prepare = Callable[[tuple[LogTiming, ...]], DataSet]


def as_timed(balance: TorqueBalance, retuned: Fit, prepare: Prepare) -> tuple[TorqueBalance, Fit]:
    """The balance and its fit with torques taken as held where the fit has them nearer to a hold's middle than to their stamps.

    A fit that does not know the middle by a standard deviation says nothing. prepare: makes the data set with timings.
    """
    data, off = balance.data, abs(retuned.axis.lateness) - _deviation(retuned)
    if not any(one.between is Between.LINE for one in data.timings) or off <= MIDWAY * data.leeway:
        return balance, retuned
    again = TorqueBalance(prepare(tuple(replace(timing, between=Between.HELD) for timing in data.timings)), balance.inertia_known)
    return again, settle(again, retuned.axis, retuned.noise, rounds=1)


def out_of_step(balance: TorqueBalance, retuned: Fit, prepare: Prepare) -> tuple[TorqueBalance, Fit] | None:
    """The recording as it is if its log is out of step, with a retuned fit; None where nothing asks for that.

    prepare: makes the data set with timings of the torque.
    """
    data, late = balance.data, retuned.axis.lateness
    own_clock = all(timing.own_clock for timing in data.timings)
    sooner, later = late <= -AT_END * data.leeway, own_clock and late >= AT_END * data.leeway
    if data.leeway == 0.0 or not (sooner or later):
        return None
    reach = (-data.leeway - (LONGEST if sooner else 0.0), data.leeway + (LONGEST if later else 0.0))
    wide = TorqueBalance(data, balance.inertia_known, reach)
    fit = settle(wide, retuned.axis, retuned.noise, rounds=1)
    gained = (wide.squares(retuned.axis, fit.noise) - fit.squares) / fit.squares.dispersion
    at_bound = not AT_END * reach[0] < fit.axis.lateness < AT_END * reach[1]  # friction that builds up late goes as far as it may
    if at_bound or gained < chance(1, math.ceil(LONGEST / data.leeway)):
        return None
    timings = tuple(replace(timing, acts=timing.acts + fit.axis.lateness, between=Between.HELD) for timing in data.timings)
    again = TorqueBalance(prepare(timings), balance.inertia_known)
    return again, settle(again, replace(fit.axis, lateness=0.0), fit.noise, rounds=1)


def torque_acts(data: DataSet, fit: Fit) -> tuple[TorqueActs, ...]:
    """When the torque of each recording acts according to a fit.

    A fit tells it where that is surer than anywhere within the leeway. A delay that was found has taken over what would tell.
    """
    std, found = _deviation(fit), []
    for timing in data.timings:
        widest = timing.leeway / math.sqrt(3.0)
        determined = timing.stated or std < widest
        found.append(TorqueActs(timing.acts + fit.axis.lateness, min(std, widest), determined, timing))
    return tuple(found)


def _deviation(fit: Fit) -> float:
    """Standard deviation of the lateness of a fit, s; infinite where nothing tells it."""
    k = next((k for k, number in enumerate(fit.free) if number.part is Part.ALIGNMENT), None)
    return math.inf if k is None else math.sqrt(max(fit.covariance[k, k], 0.0) * fit.squares.dispersion)
