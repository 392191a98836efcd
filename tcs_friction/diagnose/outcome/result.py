"""The result of a diagnosis and its JSON form (schema tcs_friction/diagnosis/1)."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from tcs_friction.conditioning.timing import TorqueActs
from tcs_friction.config import AxisFile
from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.plot_data import Evidence
from tcs_friction.diagnose.outcome.visible import Visible
from tcs_friction.diagnose.rules import Refusal, Refused
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.physics.terms import Instance

SCHEMA = "tcs_friction/diagnosis/1"


class Verdict(enum.StrEnum):
    """What a diagnosis says of a model."""

    MATCH = "match"
    PARAMETERS = "parameters"
    MISSING_PHYSICS = "missing_physics"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class Found:
    """One effect that the model lacked.

    equivalent: kinds of effects that these data cannot tell from it, best first. parameters: name -> value, std, unit.
    torque_rms: of the effect over the recording, N m. before, after: held-out rms of the torque residual without and with it,
    the rest refitted. delta_bic: negative is better. agreement: of independent pieces of the data about it.
    refused: by which rules it is not named, but described.
    """

    instance: Instance
    equivalent: tuple[Kind, ...]
    probability: float
    parameters: Mapping[str, Mapping[str, Any]]
    where: Mapping[str, Any]
    torque_rms: float
    before: float
    after: float
    delta_bic: float
    agreement: Agreement
    refused: tuple[Refusal, ...] = ()

    @property
    def established(self) -> bool:
        """Whether it is named; what is not is described."""
        return not self.refused

    def unless(self, refusal: Refusal | None) -> Found:
        """The same, or with one more refusal of its name."""
        return self if refusal is None else replace(self, refused=(*self.refused, refusal))

    @property
    def effect(self) -> str:
        """Its id in the vocabulary."""
        return self.instance.term.id

    @property
    def missed_without(self) -> float:
        """Rms of what is missed without it, the rest refitted, N m; its own torque is larger where the rest can stand for it."""
        return math.sqrt(max(self.before**2 - self.after**2, 0.0))

    def to_mapping(self, file: AxisFile) -> dict[str, Any]:
        """As diagnosis.json has it beside this axis file, whose values were fitted anew where other effects were left out."""
        content: dict[str, Any] = {
            "effect": self.effect,
            "equivalent": list(dict.fromkeys(kind.effect for kind in self.equivalent)),
            "probability": self.probability,
            "parameters": {name: dict(value) for name, value in self.parameters.items()},
            "where": dict(self.where),
            "subsystem": self.instance.term.subsystem,
            "torque_rms": self.torque_rms,
            "gain": {
                "held_out_before": self.before,
                "held_out_after": self.after,
                "delta_bic": self.delta_bic,
            },
            "agreement": {
                "multiple": self.agreement.multiple,
                "std": self.agreement.deviation if math.isfinite(self.agreement.deviation) else None,
                "pieces": self.agreement.pieces,
                "explained": self.agreement.explained,
                "left": self.agreement.left,
            },
        }
        written = next((item.values for item in file.axis.effects if item.identity == self.instance.identity), None)
        if written is not None:
            content["written"] = {name: float(written[name]) for name in self.parameters}
        if self.refused:
            content["refused"] = [refusal.to_mapping() for refusal in self.refused]
        if self.instance.signal is not None:
            content["signal"] = self.instance.signal
        through = {kind.effect: kind.signal for kind in reversed(self.equivalent) if kind.signal is not None}
        if through:
            content["equivalent_signals"] = through
        return content


@dataclass(frozen=True)
class Unexplained:
    """What nothing in the vocabulary explains."""

    present: bool = False
    torque_rms: float = 0.0
    where: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Seen:
    """What the recordings showed of an axis, beyond which nothing was told: ranges, largest speed and torque, and their units.

    temperature: degC; None where it was not recorded.
    """

    position: tuple[float, float]
    speed: float
    torque: float
    temperature: tuple[float, float] | None
    units: tuple[str, str, str]

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        temperature = None if self.temperature is None else list(self.temperature)
        return {"position": list(self.position), "speed": self.speed, "torque": self.torque, "temperature": temperature}

    @property
    def words(self) -> str:
        """One line for the axis file."""
        position, speed, torque = self.units
        line = f"position {self.position[0]:.4g} to {self.position[1]:.4g} {position}, speed up to {self.speed:.4g} {speed}"
        line += f", torque up to {self.torque:.4g} {torque}"
        if self.temperature is not None:
            line += f", {self.temperature[0]:.3g} to {self.temperature[1]:.3g} degC"
        return f"Told from {line}; beyond that nothing here is."


@dataclass(frozen=True)
class Errors:
    """Rms of a torque residual, N m, of train, held-out and untouched data; of the last None where a recording is too short.

    fit: of the torque that is met where `stated` is from, 1 less NRMSE; per cent.
    """

    train: float
    held_out: float
    untouched: float | None = None
    fit: float | None = None

    @property
    def stated(self) -> float:
        """What a reader is told, N m rms: of untouched data, or of held-out ones where there are none."""
        return self.held_out if self.untouched is None else self.untouched

    def to_mapping(self) -> dict[str, float | None]:
        """As diagnosis.json has it."""
        return {"train": self.train, "held_out": self.held_out, "untouched": self.untouched, "fit_percent": self.fit}


@dataclass(frozen=True)
class Told:
    """One parameter as believed, retuned and beside what was found: values with standard deviations; None where there is none."""

    name: str
    unit: str
    believed: float | None
    retuned: tuple[float, float | None] | None
    improved: tuple[float, float | None] | None

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""

        def entry(one: tuple[float, float | None] | None) -> dict[str, float | None] | None:
            return None if one is None else {"value": one[0], "std": one[1]}

        values = {"believed": self.believed, "retuned": entry(self.retuned), "improved": entry(self.improved)}
        return {"name": self.name, "unit": self.unit, **values}


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found.

    headline: one short sentence; statement: with the details. effects: named ones. described: those that a rule refused. refused:
    effects that a rule kept out of the fit. timing: when the torque of each recording acts. axis_file: the improved axis, with
    what is named, ready to simulate; written: what it leaves. complete_file: the same with what is described, too. horizon,
    free_run, closed_loop: of untouched data where there are any. seen: what the recordings showed. visible: what could have been
    found in them. evidence: draws the report.
    """

    verdict: Verdict
    headline: str
    statement: str
    effects: tuple[Found, ...]
    described: tuple[Found, ...]
    unexplained: Unexplained
    noise_floor: float
    believed: Errors
    retuned: Errors
    improved: Errors
    horizon: float
    free_run: Mapping[str, float]
    closed_loop: Mapping[str, float]
    atlas: tuple[Mapping[str, Any], ...]
    next_experiment: Mapping[str, Any] | None
    limits: tuple[str, ...]
    timing: tuple[TorqueActs, ...]
    refused: tuple[Refused, ...]
    axis_file: AxisFile
    complete_file: AxisFile
    written: Errors
    seen: Seen
    visible: Visible
    parameters: tuple[Told, ...]
    evidence: Evidence

    def to_mapping(self, with_described: bool = False) -> dict[str, Any]:
        """The content of diagnosis.json, beside an axis file with or without what is described."""
        file = self.complete_file if with_described else self.axis_file
        fit: dict[str, Any] = {"noise_floor": self.noise_floor}
        for name in ("believed", "retuned", "improved"):
            errors: Errors = getattr(self, name)
            fit[name] = errors.to_mapping()
        fit["written"] = self.written.to_mapping()
        return {
            "schema": SCHEMA,
            "verdict": str(self.verdict),
            "headline": self.headline,
            "statement": self.statement,
            "effects": [found.to_mapping(file) for found in self.effects],
            "unexplained": {
                "present": self.unexplained.present,
                "torque_rms": self.unexplained.torque_rms,
                "where": None if self.unexplained.where is None else dict(self.unexplained.where),
            },
            "fit": fit,
            "free_run": {"horizon": self.horizon, "position_rms": dict(self.free_run)},
            "closed_loop": {"position_rms": dict(self.closed_loop)} if self.closed_loop else None,
            "atlas": [dict(entry) for entry in self.atlas],
            "next_experiment": None if self.next_experiment is None else dict(self.next_experiment),
            "described": [found.to_mapping(file) for found in self.described],
            "refused": [one.to_mapping() for one in self.refused],
            "limits": list(self.limits),
            "timing": [one.to_mapping() for one in self.timing],
            "seen": self.seen.to_mapping(),
            "parameters": [one.to_mapping() for one in self.parameters],
            "asked": self.visible.to_mapping(),
        }
