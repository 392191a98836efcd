"""Effects that belong together: a small wave at a multiple of another one's order, a constant torque beside a spring.

In: a fit. Out: a fit in which no wave is there twice, once as an effect and once as another's harmonic, and in which one term
does what two did: an offset beside a spring is the place in which it rests.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import (
    WITHOUT_ITERATIONS,
    WITHOUT_TOLERANCE,
    Fit,
    fit_jointly,
    settle,
)
from tcs_friction.diagnose.fit.noise_estimate import misfit
from tcs_friction.diagnose.search.hypotheses import starts
from tcs_friction.diagnose.search.matched_filter import ONE_WAVE, wave_angle
from tcs_friction.diagnose.search.plausibility import doubt
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.significance import DISTINGUISHABLE
from tcs_friction.diagnose.search.start import Start
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Role, Term

MINOR = 0.3  # of a wave's amplitude, below which one at a multiple of its order is its harmonic: a square wave's third has 1/3


def with_harmonics_joined(balance: TorqueBalance, fit: Fit, base: Axis) -> Fit:
    """The fit in which a small wave at a multiple of another one's order is its harmonic, and none is there twice.

    Where the two can be told apart, only if that explains as much. `base`: the axis whose effects stay as they are.
    """
    for one, other in itertools.permutations(added_effects(fit.axis, base), 2):
        joined = _joined(balance, fit, one, other)
        if joined is None:
            continue
        axis, apart = joined
        trial = settle(balance, axis, fit.noise, rounds=1)
        lost = trial.squares - balance.squares(fit.axis, trial.noise)
        residual = balance.residual(trial.axis, trial.noise)
        if not apart or lost < DISTINGUISHABLE * misfit(balance, residual):
            return with_harmonics_joined(balance, trial, base)
    return fit


def with_offsets_joined(balance: TorqueBalance, fit: Fit, base: Axis, excluded: frozenset[str] = frozenset()) -> Fit:
    """The fit in which a spring that rests elsewhere does what two torques over the position did, if it explains as much.

    A constant torque beside a spring is its neutral place. Gravity beside a spring, or beside a constant torque, over a part of a
    turn may be a spring's, too. `base`: the axis whose effects stay as they are. `excluded`: ids of effects that the data cannot
    carry.
    """
    springs = [term for term in effects().values() if term.neutral and term.id not in excluded]
    for one, other in itertools.combinations(added_effects(fit.axis, base), 2):
        held = [item for item in (one, other) if item.term.neutral]
        if len(held) == 2 or not all(item.term.neutral or _shapeless(item) for item in (one, other)):
            continue
        fewer = fit.axis.without_effect(one).without_effect(other)
        bare = fit_jointly(balance, fewer, fit.noise, WITHOUT_ITERATIONS, WITHOUT_TOLERANCE)
        projected = ProjectedResidual(balance, bare)
        for start in filter(None, (_resting(projected, term) for term in ([held[0].term] if held else springs))):
            trial = settle(balance, bare.axis.with_effect(start.instance), fit.noise, rounds=1)
            lost = trial.squares - balance.squares(fit.axis, trial.noise)
            as_much = lost < DISTINGUISHABLE * misfit(balance, balance.residual(trial.axis, trial.noise))
            if as_much and doubt(balance, trial, trial.axis.effects[-1], bare.axis) is None:
                return with_offsets_joined(balance, trial, base, excluded)
    return fit


def _shapeless(item: Instance) -> bool:
    """Whether an effect is a torque over the position that has a size and no shape, as gravity has, or a constant one."""
    return item.term.slow_over_position and all(p.role in (Role.LINEAR, Role.PHASE) for p in item.term.parameters)


def _resting(projected: ProjectedResidual, term: Term) -> Start | None:
    """The best start of a spring whose neutral place is free; None without one."""
    usual = term.parameter(term.neutral).default
    return next((s for s in starts(projected, term, None) if s.instance.values[term.neutral] != usual), None)


def added_effects(axis: Axis, base: Axis) -> tuple[Instance, ...]:
    """The effects of an axis that another one does not have."""
    known = {item.identity for item in base.effects}
    return tuple(item for item in axis.effects if item.identity not in known)


def _joined(balance: TorqueBalance, fit: Fit, one: Instance, other: Instance) -> tuple[Axis, bool] | None:
    """The axis in which the second wave is a harmonic of the first, and whether data tell the two apart; None if it is none."""
    if one.term is not other.term or one.term.periodic != "position":
        return None
    ratio, angle = other.order / one.order, wave_angle(balance, fit.axis, one.term)
    parted = abs(ratio - round(ratio)) * one.order * float(np.ptp(angle))  # rad
    waves = [(wave, phase) for wave, phase in one.term.harmonics if phase is not None]
    if parted > 2.0 * math.pi or not 2 <= round(ratio) <= len(waves):
        return None
    amplitude, phase = waves[round(ratio) - 1]
    first, first_phase = waves[0]
    if one.values[amplitude.name] != 0.0:  # it is there twice
        changed = one.replace(**{amplitude.name: 0.0, phase.name: 0.0})
        effects = tuple(changed if item is one else item for item in fit.axis.effects)
        return replace(fit.axis, effects=effects), parted >= 2.0 * math.pi * ONE_WAVE
    active = [wave.name for wave, _ in waves if other.values[wave.name] != 0.0]
    if active != [first.name] or other.values[first.name] >= MINOR * one.values[first.name]:
        return None
    numbers = {amplitude.name: other.values[first.name], phase.name: other.values[first_phase.name]}
    changed = one.replace(**numbers)
    rest = fit.axis.without_effect(other)
    return replace(rest, effects=tuple(changed if item is one else item for item in rest.effects)), True
