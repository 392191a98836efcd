"""The files of a diagnosis: the result, the improved axis, the next experiment, pictures and report, whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tcs_friction.config import save_axis, write_whole
from tcs_friction.control.model_compensator import effect_names
from tcs_friction.diagnose.outcome.experiment import reference_text
from tcs_friction.diagnose.outcome.result import SCHEMA, Diagnosis
from tcs_friction.json_files import Json, load_json
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance
from tcs_friction.report.diagnosis import write_report
from tcs_friction.writable import staged

DIAGNOSIS, EXPERIMENT = "diagnosis.json", "next_experiment.yaml"
SOMETIMES = (EXPERIMENT, "effect_[0-9]*.png", "learned_map.png", "friction_speed.png")
"""Files that only some diagnoses write."""
DESCRIBED, UNKNOWN = "the diagnosis describes it only", "the diagnosis does not know it"


def write_diagnosis(directory: Path, found: Diagnosis, with_described: bool = False) -> Path:
    """Write everything a diagnosis gives into `directory`; returns the report's path.

    The axis file holds what is named, and `with_described` what is described, too.
    """
    file = found.complete_file if with_described else found.axis_file
    content = found.to_mapping(with_described)
    with staged(directory, *SOMETIMES) as part:
        write_whole(part / DIAGNOSIS, json.dumps(content, indent=2, allow_nan=False) + "\n")
        save_axis(part / "axis.yaml", file, f"Diagnosed by tcs-friction: {found.statement}\n{found.seen.words}")
        why = None
        if found.next_experiment:
            write_whole(part / EXPERIMENT, reference_text(found.next_experiment))
            why = f"{found.next_experiment['why']}. The reference is in {EXPERIMENT}."
        write_report(part, content, found.evidence, found.axis_file.axis.name, why)
    return directory / "report.html"


def told_by(path: Path, axis: Axis) -> tuple[dict[str, str], dict[str, Mapping[str, float]]]:
    """What a diagnosis.json says of an axis' effects: why some should not be cancelled, standard deviations of those it names.

    Raises InputError for a file that is no diagnosis, and for a damaged one.
    """
    content = load_json(path, "the diagnosis.json of ./tcs diagnose", SCHEMA)
    left_out: dict[str, str] = {}
    deviations: dict[str, Mapping[str, float]] = {}
    told = [(_told(entry), key == "effects") for key in ("effects", "described") for entry in content.at(key).entries()]
    for name, item in effect_names(axis).items():
        found, named = next(((one, n) for one, n in told if one.is_about(item)), (None, False))
        if found is None:
            left_out[name] = UNKNOWN
        elif not named:
            left_out[name] = DESCRIBED
        else:
            deviations[name] = found.deviations
    return left_out, deviations


@dataclass(frozen=True)
class _Told:
    """An effect of a diagnosis: its id, its values as the axis file has them, and standard deviations by parameter."""

    effect: str
    values: Mapping[str, float]
    deviations: Mapping[str, float]

    def is_about(self, item: Instance) -> bool:
        """Whether this is an effect with these values."""
        return self.effect == item.term.id and all(
            name in item.values and math.isclose(value, item.values[name], rel_tol=1e-6) for name, value in self.values.items()
        )


def _told(entry: Json) -> _Told:
    parameters = entry.at("parameters").mapping()
    values = {name: one.at("value").number() for name, one in parameters.items()}
    if "written" in entry.mapping():
        values = {name: one.number() for name, one in entry.at("written").mapping().items()}
    return _Told(entry.at("effect").text(), values, {name: one.at("std").above(0.0) for name, one in parameters.items()})
