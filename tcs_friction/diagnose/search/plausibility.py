"""Whether a fitted effect can be what it says: its size, its values, and whether the recording resolves it.

In: a fit and one of its effects. Out: the reason why it cannot be, or None.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.search.matched_filter import same_wave
from tcs_friction.diagnose.search.projection import survey
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place, Role, Survey

LARGEST_TORQUE = 1.2  # of the logged torque's rms: an effect that is larger cancels against another one
LEAST_OWN_GAIN = 0.5  # of the least gain that counts, that an effect's own torque must have: it cannot gain more by itself
HALF_A_STEP = 0.5  # of the encoder: the error of rounding is never larger
AT_BOUND = 1e-3  # relative distance from a declared bound that counts as none
SEARCH_MARGIN = 3.0  # factor beyond the values searched, within which an effect can be told from others


class Doubt(enum.Enum):
    """Why a fitted effect cannot be what it says."""

    ALIGNMENT = "it is within the log's alignment"
    TWICE = "it is one wave with another effect"
    WARNED = "its values are not physical"
    TOO_SMALL = "its torque is too small for its gain"
    TOO_LARGE = "its torque is larger than that of the drive"
    QUANTISATION = "it is within half a step of the encoder"
    AT_BOUND = "it ended at a bound"
    NOT_RESOLVED = "the recording cannot show it with such values"


def doubt(balance: TorqueBalance, fit: Fit, item: Instance, base: Axis) -> Doubt | None:
    """Why an effect of a fit cannot be what it says; `base`: the axis that it was searched on."""
    if item.term.alignment and item.values[item.term.alignment] < balance.alignment_leeway:
        return Doubt.ALIGNMENT
    if any(same_wave(balance, fit.axis, item, other) for other in fit.axis.effects if other is not item):
        return Doubt.TWICE
    return doubtful_size(balance, fit, item) or _unresolved(balance, fit, item) or _out_of_range(balance, base, item)


def doubtful_size(balance: TorqueBalance, fit: Fit, item: Instance) -> Doubt | None:
    """Why an effect's size or values cannot be."""
    if item.term.warn(item.values):
        return Doubt.WARNED
    torque = own_torque(balance, fit, item)
    white = fit.noise.whiten(torque)
    if float(white @ white) < LEAST_OWN_GAIN * chance(1):
        return Doubt.TOO_SMALL
    return Doubt.TOO_LARGE if rms(torque[balance.train]) > LARGEST_TORQUE * balance.torque_size else None


def own_torque(balance: TorqueBalance, fit: Fit, item: Instance) -> np.ndarray:
    """Torque (n,) that an effect of a fit adds, N m."""
    return balance.torque_residual(fit.axis.without_effect(item)) - balance.torque_residual(fit.axis)


def _unresolved(balance: TorqueBalance, fit: Fit, item: Instance) -> Doubt | None:
    """Whether the steps of a coarse encoder feign a wave: what it moves the axis by is within half a step.

    At steady speed the error of the steps repeats with time and position, and sampling makes it slow.
    """
    step = balance.data.position_step
    if not item.term.periodic or step == 0.0:
        return None
    if item.term.place is Place.SENSOR:
        error = max(abs(item.values[p.name]) for p in item.term.parameters if p.role is Role.LINEAR)
        return Doubt.QUANTISATION if error < HALF_A_STEP * step else None
    phase_rate = 2.0 * math.pi
    if item.term.periodic == "position":
        phase_rate = fit.axis.cycle * float(np.median(np.abs(balance.data.joined("velocity")[balance.train])))
    rate = phase_rate * item.order
    amplitude = math.sqrt(2.0) * rms(own_torque(balance, fit, item)[balance.train])
    return Doubt.QUANTISATION if amplitude < HALF_A_STEP * step * fit.axis.inertia * rate**2 else None


def _out_of_range(balance: TorqueBalance, base: Axis, item: Instance) -> Doubt | None:
    """Whether a fit ended at a declared bound, or far from all values that the effect is searched at in such a recording."""
    for parameter in item.term.parameters:
        value = item.values[parameter.name]
        if parameter.role in (Role.FIXED, Role.PHASE) or value == parameter.default or value == 0.0:
            continue
        near = AT_BOUND * abs(value)
        if abs(value - parameter.lower) < near or abs(value - parameter.upper) < near:
            return Doubt.AT_BOUND
    view = survey(balance, base)
    return None if within_search(item, view, item.values) else Doubt.NOT_RESOLVED


def within_search(item: Instance, view: Survey, names: Collection[str]) -> bool:
    """Whether these values of a term are near those that it is searched at in such a recording; beyond them it cannot be told."""
    scans = item.term.scan(view)
    for name in scans[0] if len(scans) else ():
        searched = {scan[name] for scan in scans}
        given = name in names and item.values[name] != item.term.parameter(name).default
        lowest, highest = min(searched) / SEARCH_MARGIN, max(searched) * SEARCH_MARGIN
        if given and len(searched) > 2 and not lowest < item.values[name] < highest:
            return False
    return True
