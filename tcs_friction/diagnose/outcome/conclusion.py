"""From the fits to the result: verdict, named effects with their uncertainties, proof on held-out data.

In: the axis file and an `Explanation`: the retuned fit, the improved one, the structure that remains, the contests. Out: a
`Diagnosis`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.dataset.excitation import limits, passed_once
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise_estimate import noise_floor
from tcs_friction.diagnose.fit.parameters import Form, amplitudes, moved
from tcs_friction.diagnose.outcome.atlas import AtlasEntry, atlas
from tcs_friction.diagnose.outcome.experiment import next_experiment
from tcs_friction.diagnose.outcome.free_run import free_run, usable_horizon
from tcs_friction.diagnose.outcome.plots import evidence_of, where
from tcs_friction.diagnose.outcome.result import Diagnosis, Errors, Found, Unexplained, Verdict
from tcs_friction.diagnose.outcome.statement import statement
from tcs_friction.diagnose.remainder.maps import Structure
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.diagnose.search.hypotheses import Kind
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.diagnose.search.rivals import Contest
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Parameter, Role

WRONG_PARAMETERS = 1.05  # factor from the retuned residual to the believed one, from which parameters are called wrong
UNEXPLAINED_SHARE = 0.1  # of the power that the named effects explain, from which what remains is the verdict
ABOVE_NOISE = 2.0  # noise floors, from which a residual is no noise whatever it looks like
LARGEST_EXPONENT = 30.0  # of odds: exp(-30) is none


@dataclass(frozen=True, eq=False)
class Explanation:
    """What search and remainder found.

    retuned: fit of what the model has alone. improved: fit with effects and map. structure: what the effects leave, or what a map
    stands for. rounds: candidates of each round. contests: of every effect found. lacks: of the believed friction law.
    """

    retuned: Fit
    improved: Fit
    structure: Structure | None
    rounds: tuple[tuple[Candidate, ...], ...] = ()
    contests: tuple[Contest, ...] = ()
    lacks: tuple[Lack, ...] = ()

    def contest(self, item: Instance) -> Contest | None:
        """The contest of an effect, None if there was none."""
        return next((c for c in self.contests if c.effect == item.identity), None)


def conclude(balance: TorqueBalance, file: AxisFile, explanation: Explanation) -> Diagnosis:
    """The diagnosis; the first place that looks at held-out data."""
    return _Conclusion(balance, file, explanation).diagnosis()


@dataclass(frozen=True)
class _Conclusion:
    """What the parts of a result are made from."""

    balance: TorqueBalance
    file: AxisFile
    explanation: Explanation

    def diagnosis(self) -> Diagnosis:
        fit, data, believed = self.explanation.improved, self.balance.data, self.file.axis
        axes = {"believed": believed, "retuned": self.explanation.retuned.axis, "improved": fit.axis}
        residuals = {name: self._residual(axis) for name, axis in axes.items()}
        errors = {name: self._errors(residual) for name, residual in residuals.items()}
        located = atlas(self.balance, fit.noise, believed.kind, residuals["retuned"])
        items = [item for item in added_effects(fit.axis, believed) if not item.term.tabulated]
        parts = [*map(self._found, items), *map(self._lacked, self.explanation.lacks)]
        found = tuple(sorted(parts, key=lambda f: -f.torque_rms))
        floor = noise_floor(self.balance, residuals["improved"])
        unexplained = self._unexplained(errors, floor)
        verdict = self._verdict(errors, unexplained, found)
        late = fit.axis.actuation_delay - believed.actuation_delay if _is_worse(errors["believed"], errors) else 0.0
        lines = (*limits(data, believed), *passed_once(data, [i for i in fit.axis.effects if not i.term.tabulated]))
        mapped = any(item.term.tabulated for item in fit.axis.effects)
        return Diagnosis(
            verdict=verdict,
            statement=statement(verdict, found, unexplained, errors, floor, lines, believed.kind, mapped, late),
            effects=found,
            unexplained=unexplained,
            noise_floor=floor,
            believed=errors["believed"],
            retuned=errors["retuned"],
            improved=errors["improved"],
            horizon=usable_horizon(data),
            free_run={name: free_run(data, axis) for name, axis in axes.items()},
            atlas=tuple(_atlas_mapping(entry) for entry in located),
            next_experiment=self._experiment(found, floor),
            limits=lines,
            axis_file=self.file.with_axis(fit.axis),
            evidence=evidence_of(
                self.balance, fit, self.explanation.rounds, self.explanation.contests, residuals, located, self._notes()
            ),
        )

    def _residual(self, axis: Axis) -> np.ndarray:
        return self.balance.residual(axis, self.explanation.improved.noise)

    def _errors(self, residual: np.ndarray) -> Errors:
        """Rms on train and on held-out data; on train data twice where none are held out."""
        train, held = residual[self.balance.train], residual[self.balance.held_out]
        return Errors(rms(train), rms(held) if len(held) else rms(train))

    def _notes(self) -> tuple[str, ...]:
        fits = {"retuned": self.explanation.retuned, "improved": self.explanation.improved}
        unfinished = [name for name, fit in fits.items() if fit.outcome is Outcome.BUDGET_SPENT]
        lines = (f"the fit of the {name} model was still gaining when its last step was taken" for name in unfinished)
        return (*self.balance.data.notes, *lines)

    def _verdict(self, errors: Mapping[str, Errors], unexplained: Unexplained, found: Sequence[Found]) -> Verdict:
        """What is left counts beside what the named effects explain.

        Collisions are real though none comes at its exact time: what is left may be as large as they are.
        """
        fit = self.explanation.improved
        explained = errors["retuned"].train ** 2 - errors["improved"].train ** 2
        collisions = [f.torque_rms**2 for f in found if f.instance.term.collides]
        allowed = max([UNEXPLAINED_SHARE * explained, *collisions])
        if unexplained.present and (not found or unexplained.torque_rms**2 > allowed):
            return Verdict.UNEXPLAINED
        if found:
            return Verdict.MISSING_PHYSICS
        aligned = replace(self.file.axis, actuation_delay=fit.axis.actuation_delay)
        gain = (self.balance.squares(aligned, fit.noise) - fit.squares) / fit.squares.dispersion
        worse = _is_worse(self._errors(self._residual(aligned)), errors)
        return Verdict.PARAMETERS if gain > chance(len(fit.free)) and worse else Verdict.MATCH

    def _unexplained(self, errors: Mapping[str, Errors], floor: float) -> Unexplained:
        """Structure that remains; where none is found, a residual far above the noise is structure in time.

        What a coarse encoder's steps may feign, louder in slow motion than in fast, is none.
        """
        structure, left = self.explanation.structure, errors["improved"].train
        coordinates = structure.coordinates if structure is not None else ("time",)
        quantisation = self.balance.quantisation_torque(self.explanation.improved.axis)
        if coordinates == ("time",) and left < ABOVE_NOISE * quantisation:
            return Unexplained()
        if structure is None and left < ABOVE_NOISE * floor:
            return Unexplained()
        torque = structure.torque_rms if structure is not None else math.sqrt(max(left**2 - floor**2, 0.0))
        place = {
            "coordinate": coordinates[0],
            "coordinates": list(coordinates),
            "range": None,
            "period": structure.period if structure is not None else None,
            "frequency": None,
        }
        return Unexplained(True, torque, place)

    def _found(self, item: Instance) -> Found:
        """One effect of the improved axis with its proof."""
        fit, contest = self.explanation.improved, self.explanation.contest(item)
        alone = contest.without if contest is not None else self.explanation.retuned
        equivalent = contest.equivalent if contest is not None else ()
        gain = contest.gain if contest is not None else 0.0
        kinds = tuple(kind for candidate in equivalent for kind in candidate.kinds)
        torque = self._residual(fit.axis.without_effect(item)) - self._residual(fit.axis)
        return self._proven(item, kinds, self._parameters(item), torque, alone, gain, fit.numbers_of(item))

    def _lacked(self, lack: Lack) -> Found:
        """What the believed law lacks of the improved axis' law, with its proof."""
        fit = self.explanation.improved
        torque = self._residual(lack.without.axis) - self._residual(fit.axis)
        count = max(len(fit.free) - len(lack.without.free), 1)
        return self._proven(
            lack.effect, (), self._parameters_of_law(lack), torque, lack.without, lack.gain, count
        )

    def _proven(
        self,
        item: Instance,
        equivalent: tuple[Kind, ...],
        parameters: Mapping[str, Mapping[str, Any]],
        torque: np.ndarray,
        alone: Fit,
        gain: float,
        count: int,
    ) -> Found:
        """An effect with this torque (n,), which `count` free numbers and this gain tell from the fit without it."""
        fit = self.explanation.improved
        before, after = self._residual(alone.axis), self._residual(fit.axis)
        held = self.balance.held_out if self.balance.held_out.any() else self.balance.train
        penalty = count * math.log(self.balance.samples.effective_count)
        certainty = 1.0 - 0.5 * math.exp(-min(max(0.5 * (gain - penalty), 0.0), LARGEST_EXPONENT))
        return Found(
            instance=item,
            equivalent=equivalent,
            probability=certainty / (1 + len(equivalent)),
            parameters=parameters,
            where=where(item, fit.axis),
            torque_rms=rms(torque),
            before=rms(before[held]),
            after=rms(after[held]),
            delta_bic=penalty - gain,
        )

    def _parameters_of_law(self, lack: Lack) -> dict[str, dict[str, Any]]:
        """What a law says of an effect that completes it, with standard deviations to first order."""
        fit, term = self.explanation.improved, lack.effect.term
        covariance = fit.covariance * fit.squares.dispersion

        def stated(axis: Axis) -> dict[str, float]:
            return dict(term.of_law(axis.friction.values))

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
                "unit": term.parameter(name).unit_for(fit.axis.kind),
            }
            for name, value in here.items()
        }

    def _parameters(self, item: Instance) -> dict[str, dict[str, Any]]:
        """Value, standard deviation and unit of every parameter that was free."""
        fit = self.explanation.improved
        numbers = {(n.name, n.form): k for k, n in enumerate(fit.free) if n.effect == item.identity}
        covariance = fit.covariance * fit.squares.dispersion
        result: dict[str, dict[str, Any]] = {}
        for parameter, phase in amplitudes(item.term.parameters):
            if parameter.role is Role.FIXED or item.values[parameter.name] == parameter.default:
                continue
            for each, deviation in _deviations(parameter, phase, item, numbers, covariance):
                unit = each.unit_for(fit.axis.kind)
                result[each.name] = {"value": item.values[each.name], "std": deviation, "unit": unit}
        return result

    def _experiment(self, found: Sequence[Found], floor: float) -> dict[str, Any] | None:
        """What to record next to tell the first effect that has equivalents from the best of them."""
        for one in found:
            contest = self.explanation.contest(one.instance)
            for rival in contest.equivalent if contest is not None else ():
                assert contest is not None
                base = contest.without.axis
                experiment = next_experiment(base, one.instance, rival.items[0], self.balance.data, floor)
                if experiment is not None:
                    return experiment
        return None


def _is_worse(one: Errors, errors: Mapping[str, Errors]) -> bool:
    """Whether an axis' residual is larger than the retuned one's by more than goes unnoticed."""
    return one.train > WRONG_PARAMETERS * errors["retuned"].train


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


def _atlas_mapping(entry: AtlasEntry) -> dict[str, Any]:
    return {
        "coordinate": entry.coordinate,
        "unit": entry.unit,
        "statistic": entry.statistic,
        "p_value": entry.p_value,
        "range": None if entry.range is None else list(entry.range),
        "period": entry.period,
        "share": entry.share,
    }
