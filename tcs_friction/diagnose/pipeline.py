"""The diagnosis from recordings to verdict: condition, retune, locate, hypothesise, select, prove."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.dataset.excitation import barred, check_units, limits, passed_once
from tcs_friction.diagnose.dataset.preprocessing import Conditioned, condition
from tcs_friction.diagnose.fit.balance import Balance, Fit, rms
from tcs_friction.diagnose.outcome.atlas import AtlasEntry, atlas
from tcs_friction.diagnose.outcome.experiment import next_experiment
from tcs_friction.diagnose.outcome.free_run import free_run, usable_horizon
from tcs_friction.diagnose.outcome.plots import evidence_of, where
from tcs_friction.diagnose.outcome.result import Diagnosis, Errors, Found, Unexplained
from tcs_friction.diagnose.outcome.statement import statement
from tcs_friction.diagnose.remainder.maps import Structure
from tcs_friction.diagnose.remainder.remainder import Remains, mapped
from tcs_friction.diagnose.search.candidates import chance
from tcs_friction.diagnose.search.stepwise import Rivals, Selection, contend, outstanding, select
from tcs_friction.physics.terms import Instance, Role
from tcs_friction.recording.recording import Recording

RETUNED = 1.05  # the believed residual over the retuned one from which parameters are called wrong
REST = 0.1  # of the power that the named effects explain, from which what remains is the verdict
FORGOTTEN = 10.0  # bristle deflections, after which friction has forgotten how they were before the recording
FAR = 2.0  # noise floors, from which a residual is not noise whatever it looks like

Progress = Callable[[float, str], None]


def diagnose(
    recordings: Sequence[Recording],
    file: AxisFile,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what the axis file lacks against recordings of the real axis.

    Held-out data are cut off before anything is fitted or chosen. `progress(share, what)` may raise to cancel.

    Raises InputError when the recordings cannot carry a torque balance.
    """

    def tell(share: float, what: str) -> None:
        if progress is not None:
            progress(share, what)

    tell(0.02, "conditioning the recording")
    data = condition(recordings, memory=FORGOTTEN * file.axis.bristle)
    check_units(data, file.axis)
    balance = Balance(data, file.axis.actuation_delay)
    tell(0.1, "retuning what the model has")
    impossible = barred(data, file.axis)
    remains = Remains(balance)
    selection = select(balance, file.axis, tell, impossible, remains.are_hopeless)
    tell(0.75, "looking for structure that remains")
    plain = remains.is_plain_map(selection)
    if not plain:
        selection.chosen = outstanding(balance, selection.chosen, len(file.axis.effects))
        plain = remains.is_plain_map(selection)
    structure = remains.structure
    if not plain:
        contend(balance, selection, len(file.axis.effects), tell)
    fit = selection.chosen if plain or structure is None else mapped(balance, selection.chosen, structure)
    tell(0.92, "proving on held-out data")
    return _Judge(data, balance, file, selection, fit, structure).diagnosis()


@dataclass(frozen=True)
class _Judge:
    """Everything a verdict needs, and the verdict."""

    data: Conditioned
    balance: Balance
    file: AxisFile
    selection: Selection
    fit: Fit
    structure: Structure | None

    def diagnosis(self) -> Diagnosis:
        axes = {"believed": self.file.axis, "retuned": self.selection.retuned.axis, "improved": self.fit.axis}
        residuals = {name: self.balance.residual(axis) for name, axis in axes.items()}
        errors = {name: self._errors(residual) for name, residual in residuals.items()}
        located = atlas(self.balance, self.selection.retuned.axis, residuals["retuned"])
        found = tuple(self._found(i) for i in range(len(self.file.axis.effects), len(self._vocabulary())))
        found = tuple(sorted(found, key=lambda f: -f.torque_rms))
        floor = self.balance.noise_floor(axes["improved"])
        unexplained = self._unexplained(errors, floor)
        verdict = self._verdict(errors, unexplained, found)
        late = self.fit.axis.actuation_delay - self.file.axis.actuation_delay if _worse(errors["believed"], errors) else 0.0
        runs = {name: free_run(self.data, axis) for name, axis in axes.items()}
        lines = (*limits(self.data, self.file.axis), *passed_once(self.data, self._vocabulary()))
        return Diagnosis(
            verdict=verdict,
            statement=statement(verdict, found, unexplained, errors, floor, lines, self.fit.axis.kind, self._is_mapped(), late),
            effects=found,
            unexplained=unexplained,
            noise_floor=floor,
            believed=errors["believed"],
            retuned=errors["retuned"],
            improved=errors["improved"],
            horizon=usable_horizon(self.data),
            free_run=runs,
            atlas=tuple(_atlas_mapping(entry) for entry in located),
            next_experiment=self._experiment(found, floor),
            limits=lines,
            axis_file=self.file.with_axis(self.fit.axis),
            evidence=evidence_of(self.balance, self.selection, self.fit.axis, residuals, located),
        )

    def _is_mapped(self) -> bool:
        return len(self._vocabulary()) < len(self.fit.axis.effects)

    def _vocabulary(self) -> list[Instance]:
        """Effects of the improved axis without the learned map."""
        return [item for item in self.fit.axis.effects if not item.term.tabulated]

    def _errors(self, residual: np.ndarray) -> Errors:
        train, held = residual[self.balance.train], residual[self.balance.held_out]
        return Errors(rms(train), rms(held) if len(held) else rms(train))

    def _verdict(self, errors: Mapping[str, Errors], unexplained: Unexplained, found: Sequence[Found]) -> str:
        """What is left counts beside what the named effects explain.

        Collisions are real though none comes at its exact time: what is left may be as large as they are.
        """
        explained = errors["retuned"].train ** 2 - errors["improved"].train ** 2
        allowed = max([REST * explained, *(f.torque_rms**2 for f in found if f.instance.term.collides)])
        if unexplained.present and (not found or unexplained.torque_rms**2 > allowed):
            return "unexplained"
        if found:
            return "missing_physics"
        aligned = replace(self.file.axis, actuation_delay=self.fit.axis.actuation_delay)
        spread = max(1.0, self.fit.squares / self.balance.effective_count)
        gain = (self.balance.squares(aligned) - self.fit.squares) / spread
        worse = _worse(self._errors(self.balance.residual(aligned)), errors)
        return "parameters" if gain > chance(len(self.fit.free), 1.0) and worse else "match"

    def _unexplained(self, errors: Mapping[str, Errors], floor: float) -> Unexplained:
        """Structure that remains; where none is found, a residual far above the noise is structure in time.

        What a coarse encoder's steps may pretend, louder in slow motion than in fast, is none.
        """
        s = self.structure
        in_time = s is None or s.coordinates == ("time",)
        if in_time and errors["improved"].train < FAR * self.balance.step_torque(self.fit.axis):
            return Unexplained()
        rest = math.sqrt(max(errors["improved"].train ** 2 - floor**2, 0.0))
        if s is None and errors["improved"].train < FAR * floor:
            return Unexplained()
        coordinates = s.coordinates if s is not None else ("time",)
        where = {
            "coordinate": coordinates[0],
            "coordinates": list(coordinates),
            "range": None,
            "period": s.period if s is not None else None,
            "frequency": None,
        }
        return Unexplained(True, s.torque_rms if s is not None else rest, where)

    def _found(self, index: int) -> Found:
        item = self._vocabulary()[index]
        position = index - len(self.file.axis.effects)
        rivals = self.selection.rivals[position] if position < len(self.selection.rivals) else None
        equivalent = _equivalent(item, rivals)
        alone = rivals.without if rivals is not None else self.selection.retuned
        before, after = self.balance.residual(alone.axis), self.balance.residual(self.fit.axis)
        held = self.balance.held_out if self.balance.held_out.any() else self.balance.train
        effect_torque = self.balance.residual(self.fit.axis.without_effect(item)) - after
        count = sum(f.owner == index for f in self.fit.free)
        gain = rivals.gain if rivals is not None else 0.0
        penalty = count * math.log(self.balance.effective_count)
        certainty = 1.0 - 0.5 * math.exp(-min(max(0.5 * (gain - penalty), 0.0), 30.0))
        return Found(
            instance=item,
            equivalent=equivalent,
            probability=certainty / (1 + len(equivalent)),
            parameters=self._parameters(index, item),
            where=where(item, self.fit.axis),
            torque_rms=rms(effect_torque),
            before=rms(before[held]),
            after=rms(after[held]),
            delta_bic=penalty - gain,
        )

    def _parameters(self, index: int, item: Instance) -> dict[str, dict[str, Any]]:
        spread = max(1.0, self.fit.squares / self.balance.effective_count)
        variance = {(f.name, f.kind): i for i, f in enumerate(self.fit.free) if f.owner == index}
        covariance = self.fit.covariance * spread
        kind = self.fit.axis.kind
        result: dict[str, dict[str, Any]] = {}
        for parameter in item.term.parameters:
            value = item.values[parameter.name]
            if parameter.role is Role.FIXED or value == parameter.default:
                continue
            deviation = _deviation(parameter.name, parameter.role, item, variance, covariance)
            if deviation is None:
                continue
            result[parameter.name] = {"value": value, "std": deviation, "unit": parameter.unit_for(kind)}
        return result

    def _experiment(self, found: Sequence[Found], floor: float) -> dict[str, Any] | None:
        for position, item in enumerate(found):
            if not item.equivalent or position >= len(self.selection.rivals):
                continue
            rivals = next((r for r in self.selection.rivals if _names(r, item.equivalent[0])), None)
            if rivals is None:
                continue
            other = next(c for c in rivals.candidates if c.name.split(":")[0] == item.equivalent[0])
            base = rivals.without.axis
            experiment = next_experiment(base, item.instance, other.fit.axis.effects[-1], self.data, floor)
            if experiment is not None:
                return experiment
        return None


def _worse(one: Errors, errors: Mapping[str, Errors]) -> bool:
    """Whether an axis' residual is larger than the retuned one's by more than goes unnoticed."""
    return one.train > RETUNED * errors["retuned"].train


def _names(rivals: Rivals, name: str) -> bool:
    return any(c.name.split(":")[0] == name for c in rivals.candidates)


def _equivalent(item: Instance, rivals: Rivals | None) -> tuple[str, ...]:
    """Ids that these data cannot tell from the effect."""
    if rivals is None:
        return ()
    close = [c.name.split(":")[0] for c in rivals.candidates if c.gain > rivals.gain - rivals.same]
    return tuple(dict.fromkeys(name for name in close if name != item.term.id))


def _deviation(
    name: str, role: Role, item: Instance, index: Mapping[tuple[str, str], int], covariance: np.ndarray
) -> float | None:
    """Standard deviation of one parameter, None if it was not free."""
    value = item.values[name]
    if (name, "log") in index:
        return abs(value) * math.sqrt(covariance[index[name, "log"]][index[name, "log"]])
    if (name, "plain") in index:
        return math.sqrt(covariance[index[name, "plain"]][index[name, "plain"]])
    amplitude = name
    if role is Role.PHASE:
        amplitude = name.replace("phase", "amplitude")
    if (amplitude, "cosine") not in index:
        return None
    both = [index[amplitude, "cosine"], index[amplitude, "sine"]]
    block = covariance[np.ix_(both, both)]
    size = max(item.values[amplitude], 1e-300)
    phase = item.values[name] if role is Role.PHASE else item.values[amplitude.replace("amplitude", "phase")]
    along = np.array([math.cos(phase), math.sin(phase)])
    across = np.array([-math.sin(phase), math.cos(phase)]) / size
    direction = across if role is Role.PHASE else along
    return math.sqrt(max(float(direction @ block @ direction), 0.0))


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
