"""From the fits to the result: verdict, named effects with their uncertainties, proof on held-out data.

In: the axis file and an `Explanation`: the retuned fit, the improved one, the structure that remains, the contests. Out: a
`Diagnosis`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.timing import TorqueActs
from tcs_friction.config import AxisFile
from tcs_friction.diagnose import rules
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.dataset.excitation import barred, lacking, limits, passed_once
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.noise_estimate import NO_NOISE, noise_floor
from tcs_friction.diagnose.outcome.agreement import FLOOR_ERROR, judged, stated, untimed
from tcs_friction.diagnose.outcome.atlas import AtlasEntry, atlas
from tcs_friction.diagnose.outcome.closed_loop import closed_loop
from tcs_friction.diagnose.outcome.experiment import next_experiment
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.free_run import (
    telling_horizon,
    usable_horizon,
    window_errors,
)
from tcs_friction.diagnose.outcome.friction_speed import friction_by_speed
from tcs_friction.diagnose.outcome.headline import headline
from tcs_friction.diagnose.outcome.moved import Moved, refused_by_motion
from tcs_friction.diagnose.outcome.parameter_table import parameter_table
from tcs_friction.diagnose.outcome.plots import evidence_of
from tcs_friction.diagnose.outcome.proof import found_effects
from tcs_friction.diagnose.outcome.result import Diagnosis, Errors, Found, Unexplained, Verdict
from tcs_friction.diagnose.outcome.statement import statement
from tcs_friction.diagnose.outcome.visible import visible
from tcs_friction.diagnose.outcome.written import named_only, seen, with_described
from tcs_friction.diagnose.rules import Refusal
from tcs_friction.diagnose.search.late_log import torque_acts
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis

WRONG_PARAMETERS = 1.05  # factor from the retuned residual to the believed one, from which parameters are called wrong
UNEXPLAINED_SHARE = 0.1  # of the power that the named effects explain, from which what remains is the verdict
TOLERANCE = 1e-3  # of the friction: half of what Coulomb torque is off by in the worst of good recordings (README, 0.19 %)
FAR_ABOVE = 2.0  # times what noise or an encoder's steps would leave, from which a residual cannot be theirs
_MovedUntouched = tuple[float, Mapping[str, float], Mapping[str, float]]  # horizon, s; free run and closed loop, by axis


def conclude(
    balance: TorqueBalance, file: AxisFile, explanation: Explanation, tolerance: float = TOLERANCE
) -> Diagnosis:
    """The diagnosis; the first place that looks at held-out data, and in the end at untouched ones.

    tolerance: share of the friction that may remain.
    """
    return _Conclusion(balance, file, _without_a_map_that_predicts_worse(balance, explanation), tolerance).diagnosis()


def _without_a_map_that_predicts_worse(balance: TorqueBalance, explanation: Explanation) -> Explanation:
    """The same with the effects alone, where the map on top of them makes the held-out residual larger."""
    held = judged(balance, explanation.improved.axis)
    mapped, unmapped = (
        rms(balance.residual(fit.axis, explanation.improved.noise)[held]) for fit in (explanation.improved, explanation.unmapped)
    )
    return replace(explanation, improved=explanation.unmapped) if mapped > (1.0 + FLOOR_ERROR) * unmapped else explanation


@dataclass(frozen=True)
class _Conclusion:
    """What the parts of a result are made from."""

    balance: TorqueBalance
    file: AxisFile
    explanation: Explanation
    tolerance: float = TOLERANCE

    def diagnosis(self) -> Diagnosis:
        fit, data, believed = self.explanation.improved, self.balance.data, self.file.axis
        timing = torque_acts(data, fit)
        axes = {"believed": believed, "retuned": self.explanation.retuned.axis, "improved": fit.axis}
        residuals = {name: self._residual(axis) for name, axis in axes.items()}
        errors = {name: self._errors(residual) for name, residual in residuals.items()}
        located = atlas(self.balance, fit.noise, believed, residuals["retuned"])
        floor = noise_floor(self.balance, residuals["improved"])
        every = found_effects(self.balance, self.explanation, believed, floor)
        horizon = telling_horizon(data, axes["improved"], axes["retuned"])
        free, loop = Moved.of(partial(window_errors, data, horizon=horizon), axes), self._followed(axes)
        every = tuple(one.unless(self._effects_predict_worse()) for one in every)
        every = refused_by_motion(every, [free, *([loop] if loop else [])], self.explanation, unit_of("position", believed))
        worse = tuple(one for one in every if any(refusal.rule in (rules.MOVES, rules.BELIEVED_BEST) for refusal in one.refused))
        found = tuple(one for one in every if one.established)
        described = tuple(one for one in every if not one.established)
        unexplained = self._worth_it(self._unexplained(errors, floor, described))
        constant = self._left_by_a_constant(errors)
        if not (found or unexplained.present) and (constant is not None or _retuning_fails(errors, floor)):
            left = math.sqrt(max(errors["believed"].held_out ** 2 - floor**2, 0.0))
            unexplained = Unexplained(True, left, {"coordinates": ["time"]})
        written, complete = (of(self.balance, self.explanation, every, believed) for of in (named_only, with_described))
        runs = free.typical()
        told = self._moved_untouched(axes, horizon, loop is not None)
        moves_better = runs["improved"] <= runs["retuned"] and not (loop and loop.improved_is_worse)
        verdict = self._verdict(errors, unexplained, found, moves_better)
        late = fit.axis.lateness if _is_worse(errors["believed"], errors) else 0.0
        added = [item for item in fit.axis.effects if not item.term.tabulated]
        lines = (*limits(data, believed), *passed_once(data, added), *self._untimed(), *self._early_log(found))
        lines += self._otherwise_elsewhere(errors["improved"])
        if constant is not None:
            unit = unit_of("torque", believed)
            lines += (f"anything, since a constant torque leaves only {constant:.3g} {unit}: inertia or units may be wrong",)
        law = fit.axis.friction.term.words if fit.axis.friction.term is not believed.friction.term else ""
        mapped = any(item.term.tabulated for item in fit.axis.effects)
        return Diagnosis(
            verdict=verdict,
            headline=headline(verdict, found, unexplained, law),
            statement=statement(
                verdict, found, unexplained, errors, floor, lines, unit_of("torque", believed), mapped, late, law, worse
            ),
            effects=found,
            described=described,
            unexplained=unexplained,
            noise_floor=min(floor, errors["improved"].stated),
            believed=errors["believed"],
            retuned=errors["retuned"],
            improved=errors["improved"],
            horizon=told[0] if told else horizon,
            free_run=told[1] if told else runs,
            closed_loop=told[2] if told else loop.typical() if loop else {},
            atlas=tuple(_atlas_mapping(entry) for entry in located),
            next_experiment=self._experiment(found, floor),
            limits=lines,
            timing=timing,
            refused=self.explanation.refused,
            axis_file=_with_timing(self.file.with_axis(_in_step(written.axis)), timing),
            complete_file=_with_timing(self.file.with_axis(_in_step(complete.axis)), timing),
            written=self._errors(self._residual(written.axis)),
            seen=seen(data, believed),
            parameters=parameter_table(believed, self.explanation.retuned, fit),
            visible=visible(self.balance, fit, barred(lacking(data, believed)), self.tolerance),
            evidence=evidence_of(
                self.balance,
                fit,
                self.explanation.rounds,
                self.explanation.contests,
                residuals,
                located,
                self._notes(),
                self.explanation.lacks,
                friction_by_speed(self.balance, fit, axes),
                frozenset(one.instance.identity for one in found),
            ),
        )

    def _effects_predict_worse(self) -> Refusal | None:
        """Where the held-out residual is larger with all effects than without any, by more than a floor is known to."""
        retuned, improved = (
            self._errors(self._residual(x.axis)).held_out for x in (self.explanation.retuned, self.explanation.unmapped)
        )
        if improved <= (1.0 + FLOOR_ERROR) * retuned or not rules.ALL_PREDICT.asked:
            return None
        unit = unit_of("torque", self.file.axis)
        words = f"all effects together predict held-out data worse than none: {improved:.2g} {unit} against {retuned:.2g}"
        return Refusal(rules.ALL_PREDICT, words, {"with": improved, "without": retuned})

    def _followed(self, axes: Mapping[str, Axis]) -> Moved | None:
        """How the axes move in the closed loop; None without one, or where none of them predicts what was recorded of it."""
        loop = closed_loop(self.balance.data, self.file, usable_horizon(self.balance.data))
        followed = Moved.of(loop.errors, axes) if loop is not None else None
        return followed if loop and followed and any(map(loop.predicts, followed.errors.values())) else None

    def _moved_untouched(self, axes: Mapping[str, Axis], horizon: float, looped: bool) -> _MovedUntouched | None:
        """How the axes move in untouched data, over the horizon (s) that held-out data chose; None where none are untouched."""
        data = self.balance.data
        horizon = usable_horizon(data, horizon, "untouched")
        if horizon * data.stride < data.dt:
            return None
        free = Moved.of(partial(window_errors, data, horizon=horizon, kept="untouched"), axes).typical()
        loop = closed_loop(data, self.file, horizon, "untouched") if looped else None
        return horizon, free, Moved.of(loop.errors, axes).typical() if loop else {}

    def _left_by_a_constant(self, errors: Mapping[str, Errors]) -> float | None:
        """What a constant torque leaves of the logged one in held-out data, where every axis leaves far more; else None."""
        torque = self.balance.data.joined("torque")[judged(self.balance, self.explanation.improved.axis)]
        left = float(np.std(torque)) if len(torque) else math.inf
        return left if min(one.held_out for one in errors.values()) > FAR_ABOVE * left else None

    def _residual(self, axis: Axis) -> np.ndarray:
        return self.balance.residual(axis, self.explanation.improved.noise)

    def _errors(self, residual: np.ndarray) -> Errors:
        """Rms on train, held-out and untouched data; on train data twice where none are held out."""
        axis = self.explanation.improved.axis
        held, apart = judged(self.balance, axis), stated(self.balance, axis)
        found = Errors(rms(residual[self.balance.train]), rms(residual[held]), rms(residual[apart]) if apart.any() else None)
        of = apart if apart.any() else held
        spread = float(np.std(self.balance.data.joined("torque")[of])) if of.any() else 0.0
        return replace(found, fit=100.0 * (1.0 - found.stated / spread)) if spread > 0.0 else found

    def _notes(self) -> tuple[str, ...]:
        fits = {"retuned": self.explanation.retuned, "improved": self.explanation.improved}
        unfinished = [name for name, fit in fits.items() if fit.outcome is Outcome.BUDGET_SPENT]
        lines = (f"the fit of the {name} model was still gaining when its last step was taken" for name in unfinished)
        timing = torque_acts(self.balance.data, self.explanation.improved)
        return (*self.balance.data.notes, *dict.fromkeys(one.words for one in timing), *lines)

    def _untimed(self) -> tuple[str, ...]:
        """One line for each event that begins where no data were fitted."""
        found = untimed(self.balance, self.explanation.improved.axis)
        return tuple(f"when the {item.term.words} began: data from {a:.4g} to {b:.4g} s were not fitted" for item, a, b in found)

    def _early_log(self, found: Sequence[Found]) -> tuple[str, ...]:
        """One line where a delay is named and nobody states when the logged torque acts."""
        delays = [one.instance.values[one.instance.term.alignment] for one in found if one.instance.term.alignment]
        if not delays or all(timing.stated for timing in self.balance.data.timings):
            return ()
        return (f"whether the torque is {1e3 * delays[0]:.3g} ms late or stamped as much too early, which look alike",)

    def _otherwise_elsewhere(self, errors: Errors) -> tuple[str, ...]:
        """One line where untouched data are missed by far more than those that decided."""
        unit, most = unit_of("torque", self.file.axis), FAR_ABOVE * max(errors.train, errors.held_out)
        if errors.stated <= most:
            return ()
        left = f"{errors.stated:.3g} {unit} are left there, {errors.held_out:.3g} of held-out ones"
        return (f"what happened in untouched data: {left}",)

    def _verdict(
        self,
        errors: Mapping[str, Errors],
        unexplained: Unexplained,
        found: Sequence[Found],
        moves_better: bool,
    ) -> Verdict:
        """What is left counts beside what the named effects explain, and a simulation with them has to move better.

        Collisions are real though none comes at its exact time: what they leave is in time and as large as they are, or larger.
        """
        fit = self.explanation.improved
        explained = errors["retuned"].train ** 2 - errors["improved"].train ** 2
        in_time = unexplained.where is not None and unexplained.where["coordinates"] == ["time"]
        collisions = [math.inf if in_time else f.torque_rms**2 for f in found if f.instance.term.collides]
        allowed = max([UNEXPLAINED_SHARE * explained, *collisions])
        if unexplained.present and (not found or unexplained.torque_rms**2 > allowed):
            return Verdict.UNEXPLAINED
        if found:
            return Verdict.MISSING_PHYSICS if moves_better else Verdict.UNEXPLAINED
        aligned = self._as_timed(fit.axis.lateness)
        if fit.axis.friction.term is not self.file.axis.friction.term:
            left = self._errors(self._residual(aligned)).train
            return Verdict.PARAMETERS if left > WRONG_PARAMETERS * errors["improved"].train else Verdict.MATCH
        gain = (self.balance.squares(aligned, fit.noise) - fit.squares) / fit.squares.dispersion
        worse = _is_worse(self._errors(self._residual(aligned)), errors)
        return Verdict.PARAMETERS if gain > chance(len(fit.free)) and worse else Verdict.MATCH

    def _as_timed(self, late: float) -> Axis:
        """The believed axis with the torque so much later, s, or as it stands, whichever leaves less.

        A recording that does not tell the timing may have it anywhere, and what that leaves is no fault of the parameters.
        """
        axes = (self.file.axis, replace(self.file.axis, lateness=late))
        return min(axes, key=lambda axis: self._errors(self._residual(axis)).train)

    def _unexplained(self, errors: Mapping[str, Errors], floor: float, described: Sequence[Found]) -> Unexplained:
        """Structure that remains; where none is found, a residual far above the noise is structure in time.

        What a coarse encoder's steps may imitate, louder in slow motion than in fast, is none. Effects that are described only
        belong to what remains, if more is missed without them than the noise floor is known to.
        """
        left = self._structure(errors, floor)
        missed = math.hypot(*(one.missed_without for one in described))
        if not described or missed**2 < FLOOR_ERROR * floor**2:
            return left
        torque = math.hypot(left.torque_rms, missed)
        largest = dict(described[0].where)
        return Unexplained(True, torque, {**largest, "coordinates": [largest["coordinate"]]})

    def _worth_it(self, left: Unexplained) -> Unexplained:
        """What remains; where it is within the tolerance it is there, and no verdict."""
        fit = self.explanation.improved
        friction = rms(self.balance.terms.friction(fit.axis)[self.balance.train])
        return replace(left, present=False) if left.torque_rms < self.tolerance * friction else left

    def _structure(self, errors: Mapping[str, Errors], floor: float) -> Unexplained:
        """What is left when everything found is taken away, in the data that were fitted or in those held out.

        The improved model has the structure's map. Where it leaves far more than noise, that belongs to what is left, too.
        """
        structure, left = self.explanation.structure, max(errors["improved"].train, errors["improved"].held_out)
        mapped = structure.torque_rms if structure is not None else 0.0
        beyond = math.sqrt(left**2 - floor**2) if left >= NO_NOISE * floor else 0.0
        in_map = structure is not None and mapped >= beyond
        coordinates = structure.coordinates if structure is not None and in_map else ("time",)
        quantisation = self.balance.quantisation_torque(self.explanation.improved.axis)
        if coordinates == ("time",) and (max(mapped, beyond) == 0.0 or left < FAR_ABOVE * quantisation):
            return Unexplained()
        place = {
            "coordinate": coordinates[0],
            "coordinates": list(coordinates),
            "range": None,
            "period": structure.period if structure is not None and in_map else None,
            "frequency": None,
        }
        return Unexplained(True, math.hypot(mapped, beyond), place)

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


def _in_step(axis: Axis) -> Axis:
    """The axis of a fit without what is the log's."""
    return replace(axis, lateness=0.0) if axis.lateness else axis


def _with_timing(file: AxisFile, timing: Sequence[TorqueActs]) -> AxisFile:
    """The file with when the logged torque acts, where it is held, that was found, and it is the same in all recordings."""
    held = [one for one in timing if one.determined and one.timing.between is Between.HELD]
    found = {one.acts for one in held if not one.timing.stated}
    if len(found) != 1 or file.signals is None or len(held) < len(timing):
        return file
    torque = replace(file.signals.torque, acts=round(found.pop(), 9))
    return replace(file, signals=replace(file.signals, torque=torque))


def _is_worse(one: Errors, errors: Mapping[str, Errors]) -> bool:
    """Whether an axis' residual is larger than the retuned one's by more than goes unnoticed."""
    return one.train > WRONG_PARAMETERS * errors["retuned"].train


def _retuning_fails(errors: Mapping[str, Errors], floor: float) -> bool:
    """Whether the believed axis misses more than noise, and everything fitted predicts data that were held out worse."""
    believed, best = errors["believed"].held_out, min(errors[name].held_out for name in ("retuned", "improved"))
    return best > (1.0 + FLOOR_ERROR) * believed and believed > FAR_ABOVE * floor


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
