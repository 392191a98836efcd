"""What the chosen effects leave, and whether a learned map does as well as they do.

In: the retuned fit and a fit with effects. Out: a `Remainder`: the structure that the effects leave and, where it does as
well as they do together, a map on the retuned axis that stands for them. Physics outside the vocabulary makes parts of it
look like effects, often large ones that cancel each other; none of them is named then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.diagnose import rules
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.noise_estimate import misfit, with_spectrum
from tcs_friction.diagnose.remainder.maps import Structure, remaining_structure
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import instance

CANCELLED = 0.4  # of the single effects' power that is left of them together, below which they are said to cancel each other
MANY = 3  # effects, that may be parts of one map though nothing remains
COMPLETE = 1.25  # times the noise floor, that a map leaves which explains all
TIE = 0.2  # of the noise power, by which effects with a map must beat a map alone


@dataclass(frozen=True, eq=False)
class MapInstead:
    """A learned map on the retuned axis that does as well as the effects: the fit with it, and what it is a map of."""

    fit: Fit
    structure: Structure
    complete: bool  # whether it leaves nothing but noise


@dataclass(frozen=True, eq=False)
class Remainder:
    """What a fit leaves: structure or None, and a map that does as well as its effects or None."""

    fit: Fit
    structure: Structure | None
    instead: MapInstead | None

    @property
    def further_effects_are_map(self) -> bool:
        """Whether further effects would be parts of the map: it explains all, over the coordinates of what remains."""
        if self.instead is None or self.structure is None or not self.instead.complete:
            return False
        return self.instead.structure.coordinates == self.structure.coordinates


def remainder_of(balance: TorqueBalance, retuned: Fit, fit: Fit) -> Remainder:
    """What a fit with effects leaves in the train data."""
    structure = remaining_structure(balance, fit, fit.noise)
    instead = _map_instead(balance, retuned, fit, structure) if rules.MAP_INSTEAD.asked else None
    return Remainder(fit, structure, instead)


def _map_instead(
    balance: TorqueBalance, retuned: Fit, fit: Fit, structure: Structure | None
) -> MapInstead | None:
    """A learned map on the retuned axis, where it does as well as the effects of a fit.

    Only where structure remains, the effects are many or cancel each other is this asked.
    """
    found = added_effects(fit.axis, retuned.axis)
    if not found:
        return None
    if structure is None and len(found) < MANY and _power_left_by_cancellation(balance, fit, retuned) > CANCELLED:
        return None
    best = fit if structure is None else with_map(balance, fit, structure)
    noise = with_spectrum(balance, best.noise, balance.residual(best.axis, best.noise), best.axis.inertia)
    whole = remaining_structure(balance, retuned, noise)
    if whole is None or whole.table is None or len(whole.coordinates) < 2:
        return None  # what depends on one coordinate alone has names in the vocabulary
    alone = with_map(balance, replace(retuned, squares=balance.squares(retuned.axis, noise)), whole)
    with_effects = balance.squares(best.axis, alone.noise)
    lost = (alone.squares - with_effects) / with_effects.dispersion
    needed = chance(len(best.free) - len(alone.free))
    power = [np.mean(balance.residual(x.axis, alone.noise)[balance.train] ** 2) for x in (alone, best)]
    if lost > max(needed, TIE * balance.samples.effective_count) or power[0] > (1.0 + TIE) * power[1]:
        return None
    rules.MAP_INSTEAD.decides()
    complete = misfit(balance, balance.residual(alone.axis, alone.noise)) < COMPLETE**2
    return MapInstead(alone, whole, bool(complete))


def _power_left_by_cancellation(balance: TorqueBalance, fit: Fit, retuned: Fit) -> float:
    """Power of the torque of all effects found together over the sum of their own; small where they cancel each other."""
    full = balance.residual(fit.axis, fit.noise)
    found = added_effects(fit.axis, retuned.axis)

    def power(fewer: Axis) -> float:
        return float(np.var(balance.residual(fewer, fit.noise) - full))

    without = fit.axis
    for item in found:
        without = without.without_effect(item)
    together = power(without)
    single = sum(power(fit.axis.without_effect(item)) for item in found)
    return together / max(single, 1e-300)


def with_map(balance: TorqueBalance, fit: Fit, structure: Structure) -> Fit:
    """The fit with the structure's table as a learned map, refitted; as it is where that explains no more."""
    if structure.table is None:
        return fit
    term = next(term for term in effects().values() if term.tabulated)
    axis = fit.axis.with_effect(instance(term, {}, table=structure.table))
    refitted = settle(balance, axis, fit.noise, rounds=1)
    left = [rms(balance.residual(x.axis, x.noise)[balance.train]) for x in (refitted, fit)]
    return refitted if left[0] < left[1] else fit
