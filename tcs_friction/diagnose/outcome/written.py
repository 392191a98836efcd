"""The axis that a diagnosis writes: with the effects that it names, and no others unless somebody asks for them.

What is described only may be a part of something else, and effects that cancel each other are known in their sum alone: whoever
compensates with them pushes with them. In: an explanation and what was found. Out: a fit without the others, all else refitted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose import rules
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.result import Found, Seen
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.physics.axis import Axis

NEVER = (rules.CANCELLED, rules.TOO_LARGE)  # rules whose effects are written for nobody


def named_only(balance: TorqueBalance, explanation: Explanation, every: Sequence[Found], believed: Axis) -> Fit:
    """The fit with the effects that are named alone."""
    dropped = {one.instance.identity for one in every if not one.established}
    mapped = {item.identity for item in explanation.improved.axis.effects if item.term.tabulated}
    return _without(balance, explanation, believed, dropped | mapped)


def with_described(balance: TorqueBalance, explanation: Explanation, every: Sequence[Found], believed: Axis) -> Fit:
    """The fit with all that predicts, but for effects that cancel each other."""
    refused = {one.instance.identity for one in every if any(refusal.rule in NEVER for refusal in one.refused)}
    return _without(balance, explanation, believed, refused)


def _without(balance: TorqueBalance, explanation: Explanation, believed: Axis, dropped: set[int]) -> Fit:
    """The improved fit without some effects, refitted; where none is left and the law is the believed one, the retuned fit."""
    fit = explanation.improved
    gone = [item for item in added_effects(fit.axis, believed) if item.identity in dropped]
    if not gone:
        return fit
    axis = fit.axis
    for item in gone:
        axis = axis.without_effect(item)
    retuned = explanation.retuned.axis
    if axis.friction.term is retuned.friction.term and not added_effects(axis, believed):
        return explanation.retuned
    return settle(balance, axis, fit.noise, rounds=1)


def seen(data: DataSet, axis: Axis) -> Seen:
    """What the recordings of a data set showed."""
    used = data.train | data.held_out
    position, velocity, torque = (data.joined(name)[used] for name in ("position", "velocity", "torque"))
    warm = data.joined("signals")[0][used]
    return Seen(
        (float(position.min()), float(position.max())),
        float(np.abs(velocity).max()),
        float(np.abs(torque).max()),
        (float(warm.min()), float(warm.max())) if data.temperature else None,
        (unit_of("position", axis), unit_of("velocity", axis), unit_of("torque", axis)),
    )
