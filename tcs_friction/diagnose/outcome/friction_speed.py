"""Friction against speed: what the recordings show of it, and what each model of the axis makes of the same motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.parameters import FreeNumber, Part, bound_reached, moved
from tcs_friction.numerics.by_speed import SpeedBins, TorqueBySpeed, linear_std, speed_bins, torque_by_speed
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Place

IMPROVED = "improved"


def friction_by_speed(balance: TorqueBalance, fit: Fit, axes: Mapping[str, Axis]) -> TorqueBySpeed | None:
    """Friction in bins of speed: measured, and of the axes by their names, `IMPROVED` among them; None without motion.

    Measured is the torque less inertia and all other effects of the improved axis, that is its friction and what it leaves. The
    improved axis is that of the fit, whose covariance says how sure its friction is.
    """
    data = balance.data
    velocity = data.joined("velocity")
    counted = (balance.train | balance.held_out) & ~data.resting
    bins = speed_bins(velocity, data.speed_threshold, counted)
    if not bins.count:
        return None
    models = {name: balance.terms.friction(axis) for name, axis in axes.items()}
    measured = models[IMPROVED] + balance.torque_residual(fit.axis)
    return torque_by_speed(bins, velocity, measured, models, {IMPROVED: _std(balance, fit, bins)}, IMPROVED)


def _std(balance: TorqueBalance, fit: Fit, bins: SpeedBins) -> np.ndarray:
    """Standard deviation (k,) of the fitted axis' mean friction in the bins, by the numbers that its friction depends on."""
    places = [k for k, number in enumerate(fit.free) if _acts_on_friction(number, fit.axis)]
    if not places:
        return np.zeros(bins.count)
    here = balance.terms.friction(fit.axis)
    columns = []
    for k in places:
        step = -fit.free[k].step if bound_reached(fit.axis, fit.free, k) == 1 else fit.free[k].step
        columns.append((balance.terms.friction(moved(fit.axis, fit.free, k, step)) - here) / step)
    return linear_std(bins, np.stack(columns, axis=1), fit.covariance[np.ix_(places, places)])


def _acts_on_friction(number: FreeNumber, axis: Axis) -> bool:
    item = number.item(axis)
    return number.part is Part.FRICTION or (item is not None and item.term.place is Place.SCALE)
