"""Each effect with its uncertainty and what proves it: `Found`.

In: an `Explanation`. Out: the effects that it adds to the believed axis, those that the believed friction law lacks among them,
largest torque first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise_estimate import NO_NOISE
from tcs_friction.diagnose.fit.parameters import Form, amplitudes, moved
from tcs_friction.diagnose.outcome.agreement import FLOOR_ERROR, agreement_on, judged
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.other_form import gain_in_other_forms
from tcs_friction.diagnose.outcome.plots import where
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.remainder.remainder import CANCELLED, COMPLETE
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.diagnose.search.matched_filter import in_step
from tcs_friction.diagnose.search.plausibility import own_torque
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.rivals import NEARLY
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Parameter, Place, Role

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
        found = [replace(one, established=one.established and not proof.cancelled(one.instance)) for one in found]
    found = [replace(one, established=one.established and not proof.in_the_mean_of_a_signal(one, found)) for one in found]
    named = [one for one in found if one.established]
    found = [replace(one, established=one.established and not proof.outshone(one, named, max(floor, left))) for one in found]
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
        return self._proven(item, kinds, self._parameters(item), self._size(item), gain, fit.numbers_of(item))

    def lacked(self, lack: Lack) -> Found:
        """What the believed law lacks of the improved axis' law, with its proof."""
        fit, item = self.fit, lack.effect
        count = max(len(fit.free) - len(lack.without.free), 1)
        return self._proven(item, (), self._parameters_of_law(lack), self._size(item), lack.gain, count)

    def outshone(self, one: Found, named: Sequence[Found], left: float) -> bool:
        """Whether an effect is within what is left (N m) and small beside a named one, which does the same in another form.

        A wave whose amplitude changes in the turn has others on either side of it; at steady speed they are vibrations, or ring.
        What acts through a signal acts in its mean, too.
        """
        if one.torque_rms >= left:
            return False
        item, larger = one.instance, [other.instance for other in named if _far_larger(other, one)]
        swings = item.term.periodic or item.term.place is Place.BODY
        if any(other.signals or (other.term.periodic and swings) for other in larger):
            return True
        return bool(larger) and self._done_in_another_form(item, larger)

    def in_the_mean_of_a_signal(self, one: Found, found: Sequence[Found]) -> bool:
        """Whether a torque over the position may be what acts through a recorded signal, which has another size at every place.

        Wind on a panel that turns is gravity in the mean. What acts through the signal does then in another form what that torque
        does, or is larger and itself not established.
        """
        others = [other for other in found if other.instance.signals] if one.instance.term.slow_over_position else []
        if any(one.torque_rms < other.torque_rms for other in others if not other.established):
            return True
        return bool(others) and self._done_in_another_form(one.instance, [other.instance for other in others])

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
        certainty = 1.0 - 0.5 * math.exp(-min(max(0.5 * (gain - penalty), 0.0), LARGEST_EXPONENT))
        agreement = agreement_on(self.balance, fit, alone, item)
        certainty *= agreement.explained if item.term.collides else agreement.probability  # collisions scatter between pieces
        left = rms(before[held]), rms(after[held])
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
            established=certainty >= NAMED
            and left[1] <= (1.0 + FLOOR_ERROR) * left[0]
            and _resolved(item, parameters)
            and not self._echoes(item, size),
        )

    def cancelled(self, item: Instance) -> bool:
        """Whether others take away most of an effect's torque: where the model is wrong otherwise, only their sum is known."""
        items = [one for one in self.fit.axis.effects if one is not item]
        if item not in self.fit.axis.effects or not items:
            return False
        torques = np.stack([own_torque(self.balance, self.fit, one)[self.balance.train] for one in (item, *items)])
        gram = torques @ torques.T
        sums = (np.array([1.0, *chosen]) for chosen in itertools.product((0.0, 1.0), repeat=len(items)))
        return any(float(one @ gram @ one) < CANCELLED * gram[0, 0] for one in sums)

    def _echoes(self, item: Instance, size: float) -> bool:
        """Whether an effect is so small beside another like it that it may be what the other's form does not meet.

        Alike are waves over the position of one order, and scales of friction along one coordinate. size: its torque, N m rms.
        """
        return any(size < ECHO * self._size(one) for one in self.fit.axis.effects if self._alike(item, one))

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

    def _parameters_of_law(self, lack: Lack) -> dict[str, dict[str, Any]]:
        """What a law says of an effect that completes it, with standard deviations to first order."""
        fit, term = self.fit, lack.effect.term
        covariance = fit.covariance * fit.squares.dispersion

        def stated(axis: Axis) -> dict[str, float]:
            return dict(term.of_law(axis.friction.values_of_law))

        here = stated(fit.axis)
        slopes = {
            name: np.array(
                [
                    (stated(moved(fit.axis, fit.free, k, n.step))[name] - value) / n.step
                    for k, n in enumerate(fit.free)
                ]
            )
            for name, value in here.items()
        }
        return {
            name: {
                "value": value,
                "std": math.sqrt(max(float(slopes[name] @ covariance @ slopes[name]), 0.0)),
                "unit": term.parameter(name).unit_for(fit.axis.kind, fit.axis.torque_unit),
            }
            for name, value in here.items()
        }

    def _parameters(self, item: Instance) -> dict[str, dict[str, Any]]:
        """Value, standard deviation and unit of every parameter that was free."""
        fit = self.fit
        numbers = {(n.name, n.form): k for k, n in enumerate(fit.free) if n.effect == item.identity}
        covariance = fit.covariance * fit.squares.dispersion
        result: dict[str, dict[str, Any]] = {}
        for parameter, phase in amplitudes(item.term.parameters):
            if parameter.role is Role.FIXED or item.values[parameter.name] == parameter.default:
                continue
            for each, deviation in _deviations(parameter, phase, item, numbers, covariance):
                unit = each.unit_for(fit.axis.kind, fit.axis.torque_unit)
                if item.term.discontinuous and item.term.coordinate == "time" and each.role is Role.SHAPE:
                    deviation = max(deviation, self._moment_within(item.values[each.name]))
                if each.name == item.term.alignment:  # the log may have the torque at either end of its leeway
                    deviation = math.hypot(deviation, self.balance.data.leeway / math.sqrt(3.0))
                result[each.name] = {"value": item.values[each.name], "std": deviation, "unit": unit}
        return result

    def _moment_within(self, moment: float) -> float:
        """Standard deviation (s) of a moment between two fitted samples, at one of which it is, or in what the low pass blurs."""
        t = self.balance.data.joined("t")[self.balance.samples.rows]
        after = int(np.clip(np.searchsorted(t, moment), 1, len(t) - 1))
        gap = max(float(t[after] - t[after - 1]), 1.0 / self.balance.data.cutoff)
        return gap / math.sqrt(3.0)


def _far_larger(other: Found, one: Found) -> bool:
    """Whether the torque of another effect is so much larger that what its form does not meet may be as large as one."""
    share = OUTSHONE_BY_SIGNAL if other.instance.signals else OUTSHONE
    return other is not one and one.torque_rms < share * other.torque_rms


def _resolved(item: Instance, parameters: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether one of the numbers that an effect's torque is proportional to is told from zero."""
    sizes = [parameters[p.name] for p in item.term.parameters if p.role is Role.LINEAR and p.name in parameters]
    return not sizes or any(abs(size["value"]) > RESOLVED * size["std"] for size in sizes)


def _deviations(
    parameter: Parameter,
    phase: Parameter | None,
    item: Instance,
    numbers: Mapping[tuple[str, Form], int],
    covariance: np.ndarray,
) -> list[tuple[Parameter, float]]:
    """Standard deviation of a parameter and of its phase, of those that were free; linear about the optimum."""
    value = item.values[parameter.name]
    if phase is None:
        for form, scale in ((Form.LOGARITHM, abs(value)), (Form.PLAIN, 1.0)):
            if (parameter.name, form) in numbers:
                k = numbers[parameter.name, form]
                return [(parameter, scale * math.sqrt(covariance[k][k]))]
        return []
    if (parameter.name, Form.COSINE) not in numbers:
        return []
    both = [numbers[parameter.name, form] for form in (Form.COSINE, Form.SINE)]
    block, angle = covariance[np.ix_(both, both)], item.values[phase.name]
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-math.sin(angle), math.cos(angle)]) / max(value, 1e-300)
    return [
        (each, math.sqrt(max(float(direction @ block @ direction), 0.0)))
        for each, direction in ((parameter, along), (phase, across))
    ]
