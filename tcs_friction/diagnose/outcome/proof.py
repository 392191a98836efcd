"""Each effect with its uncertainty and what proves it: `Found`.

In: an `Explanation`. Out: the effects that it adds to the believed axis, those that the believed friction law lacks among them,
largest torque first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcs_friction.diagnose import rules
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.dataset.excitation import passed_once
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise_estimate import NO_NOISE
from tcs_friction.diagnose.outcome.agreement import FLOOR_ERROR, Agreement, agreement_on, judged
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.found_parameters import parameters_of, parameters_of_law
from tcs_friction.diagnose.outcome.other_form import gain_in_other_forms
from tcs_friction.diagnose.outcome.plots import where
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.remainder.remainder import CANCELLED, COMPLETE
from tcs_friction.diagnose.rules import Refusal
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.diagnose.search.matched_filter import in_step
from tcs_friction.diagnose.search.plausibility import LARGEST_TORQUE, own_torque
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.rivals import NEARLY
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place, Role

NAMED = 0.9  # probability from which an effect is named, not only described: a wrong name is nine times as bad as none
RESOLVED = 2.0  # standard deviations from zero, that the size of an effect must be
ECHO = 0.2  # of an effect's torque, that another one like it must have: form, gain and timing of the larger are known no better
OUTSHONE = 0.3  # of another effect's torque, that one within what is left must have: its square is what other engines' effects at
# least left of theirs (see agreement), because their form differs
OUTSHONE_BY_SIGNAL = 0.5  # the same beside what acts through a recorded signal: wind, say, acts in another way as the axis turns
LARGEST_EXPONENT = 30.0  # of odds: exp(-30) is none


def found_effects(balance: TorqueBalance, explanation: Explanation, believed: Axis, floor: float) -> tuple[Found, ...]:
    """What an explanation adds to a believed axis, largest torque first; learned maps are no effects. floor: of noise, N m."""
    improved = explanation.improved
    left = rms(balance.residual(improved.axis, improved.noise)[judged(balance, improved.axis)])
    proof = _Proof(balance, explanation, bent=left >= NO_NOISE * floor)
    items = [item for item in added_effects(proof.fit.axis, believed) if not item.term.tabulated]
    found = [*map(proof.found, items), *map(proof.lacked, explanation.lacks)]
    if rms(proof.residual(proof.fit.axis)[balance.train]) > COMPLETE * floor:
        found = [one.unless(proof.cancelled(one.instance)) for one in found]
    found = [one.unless(proof.in_the_mean_of_a_signal(one, found)) for one in found]
    named = [one for one in found if one.established]
    found = [one.unless(proof.outshone(one, named, max(floor, left))) for one in found]
    return tuple(sorted(found, key=lambda one: -one.torque_rms))


@dataclass(frozen=True)
class _Proof:
    """What proofs are made from.

    bent: whether so much more than noise is left of held-out data that what else is wrong may bend gravity into a spring.
    """

    balance: TorqueBalance
    explanation: Explanation
    bent: bool = False

    @property
    def fit(self) -> Fit:
        return self.explanation.improved

    def residual(self, axis: Axis) -> np.ndarray:
        return self.balance.residual(axis, self.fit.noise)

    def found(self, item: Instance) -> Found:
        """One effect of the improved axis with its proof."""
        fit, contest = self.fit, self.explanation.contest(item)
        if contest is not None and self.bent and item.term.slow_over_position:
            contest = contest.bent
        equivalent = contest.equivalent if contest is not None else ()
        gain = contest.gain if contest is not None else 0.0
        kinds = tuple(kind for candidate in equivalent for kind in candidate.kinds)
        told = parameters_of(self.balance, fit, item)
        return self._proven(item, kinds, told, self._size(item), gain, fit.numbers_of(item))

    def lacked(self, lack: Lack) -> Found:
        """What the believed law lacks of the improved axis' law, with its proof."""
        fit, item = self.fit, lack.effect
        count = max(len(fit.free) - len(lack.without.free), 1)
        return self._proven(item, (), parameters_of_law(self.fit, lack), self._size(item), lack.gain, count)

    def outshone(self, one: Found, named: Sequence[Found], left: float) -> Refusal | None:
        """Where an effect is within what is left (N m) and small beside a named one, which does the same in another form.

        A wave whose amplitude changes in the turn has others on either side of it; at steady speed they are vibrations, or ring.
        What acts through a signal acts in its mean, too.
        """
        item, larger = one.instance, [other for other in named if _far_larger(other, one)]
        if one.torque_rms >= left or not larger or not rules.OUTSHONE.asked:
            return None
        swings = item.term.periodic or item.term.place is Place.BODY
        others = [other.instance for other in larger]
        like = any(other.signals or (other.term.periodic and swings) for other in others)
        if not (like or self._done_in_another_form(item, others)):
            return None
        largest = max(larger, key=lambda other: other.torque_rms)
        words = f"{largest.instance.term.words} in another form may do it: {self._measured(largest.torque_rms, one.torque_rms)}"
        return Refusal(rules.OUTSHONE, words, {"own": one.torque_rms, "larger": largest.torque_rms, "left": left})

    def in_the_mean_of_a_signal(self, one: Found, found: Sequence[Found]) -> Refusal | None:
        """Where a torque over the position may be what acts through a recorded signal, which has another size at every place.

        Wind on a panel that turns is gravity in the mean. What acts through the signal does then in another form what that torque
        does, or is larger and itself not established.
        """
        others = [other for other in found if other.instance.signals] if one.instance.term.slow_over_position else []
        if not others or not rules.SIGNAL_MEAN.asked:
            return None
        smaller = any(one.torque_rms < other.torque_rms for other in others if not other.established)
        if not (smaller or self._done_in_another_form(one.instance, [other.instance for other in others])):
            return None
        words = f"it may be the mean of {others[0].instance.term.words}: {self._measured(others[0].torque_rms, one.torque_rms)}"
        return Refusal(rules.SIGNAL_MEAN, words, {"own": one.torque_rms, "of_signal": others[0].torque_rms})

    def _measured(self, one: float, other: float) -> str:
        """One torque against another, N m rms, in words."""
        return f"{one:.2g} {unit_of('torque', self.fit.axis)} against {other:.2g}"

    def _done_in_another_form(self, item: Instance, larger: Sequence[Instance]) -> bool:
        """Whether another effect in another form than its term has gains nearly as much as one that is left out."""
        projected = ProjectedResidual(self.balance, self.explanation.without(item))
        change = projected.residual - self.balance.residual(self.explanation.unmapped.axis, projected.noise)
        own = projected.gain(projected.project(projected.noise.whiten(change))[:, None])[0]
        return any(gain_in_other_forms(projected, self._torque(other), other) > NEARLY * own for other in larger)

    def _torque(self, item: Instance) -> np.ndarray:
        """Torque (n,) of an effect of the improved axis or its law, N m."""
        lack = next((lack for lack in self.explanation.lacks if lack.effect is item), None)
        axis = self.fit.axis.without_effect(item) if lack is None else lack.without.axis
        return self.residual(axis) - self.residual(self.fit.axis)

    def _proven(
        self,
        item: Instance,
        equivalent: tuple[Kind, ...],
        parameters: Mapping[str, Mapping[str, Any]],
        size: float,
        gain: float,
        count: int,
    ) -> Found:
        """An effect with this torque (size, N m rms), which `count` free numbers and this gain tell from the fit without it.

        A map has no part in it: what it predicts is no proof of an effect.
        """
        fit, alone = self.explanation.unmapped, self.explanation.without(item)
        before, after = self.residual(alone.axis), self.residual(fit.axis)
        held = judged(self.balance, fit.axis)
        penalty = count * math.log(self.balance.samples.effective_count)
        agreement = agreement_on(self.balance, fit, alone, item)
        shares = self._shares(item, agreement, gain - penalty)
        certainty = math.prod(share for share, _ in shares)
        left = rms(before[held]), rms(after[held])
        doubts = (
            self._predicts_worse(*left),
            _not_resolved(item, parameters),
            self._echo(item, size),
            self._too_large(size),
        )
        return Found(
            instance=item,
            equivalent=equivalent,
            probability=certainty / (1 + len(equivalent)),
            parameters=parameters,
            where=where(item, fit.axis),
            torque_rms=size,
            before=left[0],
            after=left[1],
            delta_bic=penalty - gain,
            agreement=agreement,
            refused=(*_below_named(shares), *filter(None, doubts)),
        )

    def _shares(self, item: Instance, agreement: Agreement, beyond: float) -> list[tuple[float, Refusal]]:
        """The probabilities whose product is that of a name, each with what refuses the name where it is small.

        beyond: gain beyond chance. Collisions scatter between pieces, so that they need not come back with the same size, and a
        place that was passed once has nothing to come back to: it was named only if it accounts for all that was there.
        """
        once = bool(passed_once(self.balance.data, [item]))
        by_chance = Refusal(rules.BEYOND_CHANCE, f"chance may give its gain, which is {beyond:.3g} beyond it", {"beyond": beyond})
        deviation = agreement.deviation if math.isfinite(agreement.deviation) else 0.0
        again = "nothing that was not fitted shows it"
        if math.isfinite(agreement.deviation):
            again = f"of it {agreement.multiple:.2f} ± {deviation:.2f} comes back in data that were not fitted"
        back = {"multiple": agreement.multiple, "std": deviation, "pieces": float(agreement.pieces)}
        could = f"what is left could be it: {self._measured(agreement.left, agreement.gone)}"
        shares = [
            (1.0 - 0.5 * math.exp(-min(max(0.5 * beyond, 0.0), LARGEST_EXPONENT)), by_chance),
            (1.0 if item.term.collides or once else agreement.comes_back, Refusal(rules.COMES_BACK, again, back)),
            (agreement.explained, Refusal(rules.LEFT, could, {"left": agreement.left, "own": agreement.gone})),
        ]
        return [(share if refusal.rule.asked else 1.0, refusal) for share, refusal in shares]

    def _too_large(self, size: float) -> Refusal | None:
        """Where a torque, N m rms, is larger than the drive's: a map or another effect takes it away again."""
        limit = LARGEST_TORQUE * self.balance.torque_size
        if size <= limit or not rules.TOO_LARGE.asked:
            return None
        words = f"its torque is larger than the drive's: {self._measured(size, self.balance.torque_size)}"
        return Refusal(rules.TOO_LARGE, words, {"own": size, "drive": self.balance.torque_size})

    def _predicts_worse(self, before: float, after: float) -> Refusal | None:
        """Where held-out residuals without and with an effect, N m rms, say that it predicts worse."""
        if after <= (1.0 + FLOOR_ERROR) * before or not rules.PREDICTS.asked:
            return None
        words = f"held-out data are predicted worse with it: {self._measured(after, before)}"
        return Refusal(rules.PREDICTS, words, {"with": after, "without": before})

    def cancelled(self, item: Instance) -> Refusal | None:
        """Where others take away most of an effect's torque: where the model is wrong otherwise, only their sum is known."""
        items = [one for one in self.fit.axis.effects if one is not item]
        if item not in self.fit.axis.effects or not items or not rules.CANCELLED.asked:
            return None
        torques = np.stack([own_torque(self.balance, self.fit, one)[self.balance.train] for one in (item, *items)])
        gram = torques @ torques.T
        sums = (np.array([1.0, *chosen]) for chosen in itertools.product((0.0, 1.0), repeat=len(items)))
        least = min(float(one @ gram @ one) for one in sums)
        if least >= CANCELLED * gram[0, 0]:
            return None
        own, summed = (math.sqrt(max(power, 0.0) / torques.shape[1]) for power in (gram[0, 0], least))
        words = f"others take most of it away, and only their sum is known: {self._measured(summed, own)}"
        return Refusal(rules.CANCELLED, words, {"own": own, "sum": summed})

    def _echo(self, item: Instance, size: float) -> Refusal | None:
        """Where an effect is so small beside another like it that it may be what the other's form does not meet.

        Alike are waves over the position of one order, and scales of friction along one coordinate. size: its torque, N m rms.
        """
        largest = max((self._size(one) for one in self.fit.axis.effects if self._alike(item, one)), default=0.0)
        if size >= ECHO * largest or not rules.ECHO.asked:
            return None
        words = f"the form of a larger one like it may not be met: {self._measured(largest, size)}"
        return Refusal(rules.ECHO, words, {"own": size, "larger": largest})

    def _alike(self, item: Instance, other: Instance) -> bool:
        if other is item or other.term.tabulated:
            return False
        if item.term.place is Place.SCALE is other.term.place:
            return item.term.coordinate == other.term.coordinate
        waves = item.term.periodic == "position" == other.term.periodic
        return waves and in_step(self.balance, self.fit.axis, item, other)

    def _size(self, item: Instance) -> float:
        """Its rms where the recording is compared with the model: not where friction is unknown, as at rest."""
        return rms(self._torque(item)[self.balance.train | self.balance.held_out])


def _far_larger(other: Found, one: Found) -> bool:
    """Whether the torque of another effect is so much larger that what its form does not meet may be as large as one."""
    share = OUTSHONE_BY_SIGNAL if other.instance.signals else OUTSHONE
    return other is not one and one.torque_rms < share * other.torque_rms


def _below_named(shares: Sequence[tuple[float, Refusal]]) -> list[Refusal]:
    """What refuses a name whose probability is a product of shares: each that is too small alone, or else the smallest."""
    if math.prod(share for share, _ in shares) >= NAMED:
        return []
    alone = [refusal for share, refusal in shares if share < NAMED]
    return alone or [min(shares, key=lambda one: one[0])[1]]


def _not_resolved(item: Instance, parameters: Mapping[str, Mapping[str, Any]]) -> Refusal | None:
    """Where none of the numbers that an effect's torque is proportional to is told from zero."""
    names = [p.name for p in item.term.parameters if p.role is Role.LINEAR and p.name in parameters]
    told = any(abs(parameters[name]["value"]) > RESOLVED * parameters[name]["std"] for name in names)
    if told or not names or not rules.SIZE_TOLD.asked:
        return None
    value, std = (float(parameters[names[0]][key]) for key in ("value", "std"))
    words = f"its {names[0]} is not told from zero: {value:.2g} ± {std:.2g}"
    return Refusal(rules.SIZE_TOLD, words, {"value": value, "std": std})
