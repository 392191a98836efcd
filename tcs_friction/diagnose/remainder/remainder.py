"""What the chosen effects leave: structure, and whether a learned map does as well as they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcs_friction.diagnose.fit.balance import Balance, Fit, rms
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.remainder.maps import Structure, remaining_structure
from tcs_friction.diagnose.search.candidates import chance
from tcs_friction.diagnose.search.stepwise import Selection
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

CANCELLED = 0.4  # of the single effects' power that is left of them together
COMPLETE = 1.25  # times the noise floor, that a map leaves which explains all
TIE = 0.2  # of the noise power, by which effects with a map must beat a map alone


class Remains:
    """What the chosen effects of a selection leave, looked at once for every choice."""

    def __init__(self, balance: Balance) -> None:
        self.balance = balance
        self.of: Fit | None = None
        self.structure: Structure | None = None
        self.plain = False

    def is_plain_map(self, selection: Selection) -> bool:
        """Whether a learned map on the retuned axis does as well as the chosen effects; then it is what is chosen."""
        if selection.chosen is not self.of:
            self._choose(selection, self._map(selection))
        return self.plain

    def are_hopeless(self, selection: Selection) -> bool:
        """Whether further effects would be parts of a map: it leaves but noise, and what they leave is over its axes."""
        found = self._map(selection)
        if found is not None:
            fit, plain = found
            complete = self.balance.misfit(fit.axis) < COMPLETE**2
            if not complete or self.structure is None or plain.coordinates != self.structure.coordinates:
                self.balance.weigh(selection.chosen.axis)
                return False
        self._choose(selection, found)
        return self.plain

    def _map(self, selection: Selection) -> tuple[Fit, Structure] | None:
        self.structure = remaining_structure(self.balance, selection.chosen)
        return _plain_map(self.balance, selection, self.structure)

    def _choose(self, selection: Selection, found: tuple[Fit, Structure] | None) -> None:
        self.plain = found is not None
        if found is None:
            self.balance.weigh(selection.chosen.axis)
        else:
            selection.chosen, self.structure = found
        self.of = selection.chosen


def _plain_map(
    balance: Balance, selection: Selection, structure: Structure | None
) -> tuple[Fit, Structure] | None:
    """A learned map on the retuned axis alone, where it does as well as the chosen effects; then none of them is named.

    Physics outside the vocabulary makes parts of it look like effects, often large ones that cancel each other: only where
    structure remains or the effects cancel is this asked.
    """
    fit, believed = selection.chosen, len(selection.retuned.axis.effects)
    if len(fit.axis.effects) == believed:
        return None
    if structure is None and _cancellation(balance, fit, believed) > CANCELLED:
        return None
    best = fit if structure is None else mapped(balance, fit, structure)
    balance.estimate_noise(balance.residual(best.axis), best.axis.inertia)
    plain = remaining_structure(balance, selection.retuned)
    if plain is None or plain.table is None or len(plain.coordinates) < 2:
        return None  # what depends on one coordinate alone has names in the vocabulary
    alone = mapped(balance, selection.retuned, plain)
    spread = max(1.0, balance.squares(best.axis) / balance.effective_count)
    lost = (balance.squares(alone.axis) - balance.squares(best.axis)) / spread
    needed = chance(len(best.free) - len(alone.free), 1.0)
    plainly = np.mean([balance.residual(x.axis)[balance.train] ** 2 for x in (alone, best)], axis=1)
    if lost > max(needed, TIE * balance.effective_count) or plainly[0] > (1.0 + TIE) * plainly[1]:
        return None
    return alone, plain


def _cancellation(balance: Balance, fit: Fit, believed: int) -> float:
    """Power of the torque of all found effects together over the sum of their own; small where they cancel each other."""
    full = balance.residual(fit.axis)
    effects = fit.axis.effects

    def torque(fewer: Axis) -> np.ndarray:
        difference = balance.residual(fewer) - full
        return difference - float(np.mean(difference))

    together = torque(replace(fit.axis, effects=effects[:believed]))
    single = [torque(fit.axis.without_effect(item)) for item in effects[believed:]]
    return float(np.var(together)) / max(sum(float(np.var(x)) for x in single), 1e-300)


def mapped(balance: Balance, fit: Fit, structure: Structure) -> Fit:
    """The fit with the structure's table as a learned map, refitted; as it is where that explains no more."""
    if structure.table is None:
        return fit
    axis = fit.axis.with_effect(instance(effect("learned_map"), {}, table=structure.table))
    refitted = settle(balance, axis, rounds=1)
    with_map, without = (rms(balance.residual(x.axis)[balance.train]) for x in (refitted, fit))
    if with_map < without:
        return refitted
    balance.weigh(fit.axis)
    return fit
