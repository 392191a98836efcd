"""The files of a diagnosis: the result, the improved axis, the next experiment, pictures and report, whole or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tcs_friction.config import save_axis, write_whole
from tcs_friction.control.model_compensator import effect_names
from tcs_friction.diagnose.outcome.experiment import reference_text
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.errors import InputError, writing_into
from tcs_friction.physics.axis import Axis
from tcs_friction.report.diagnosis import write_report

DIAGNOSIS, EXPERIMENT = "diagnosis.json", "next_experiment.yaml"
DESCRIBED, UNKNOWN = "the diagnosis describes it only", "the diagnosis does not know it"


@contextmanager
def staged(directory: Path) -> Iterator[Path]:
    """A folder to write into, whose files move into `directory` when all are there; an error leaves nothing behind.

    Raises InputError when `directory` cannot be written to.
    """
    part: Path | None = None
    try:
        with writing_into(directory):
            part = Path(tempfile.mkdtemp(prefix=".part-", dir=directory))
            yield part
            for path in sorted(part.iterdir(), key=lambda path: path.suffix == ".html"):
                os.replace(path, directory / path.name)
    finally:
        if part is not None:
            shutil.rmtree(part, ignore_errors=True)


def write_diagnosis(directory: Path, found: Diagnosis) -> Path:
    """Write everything a diagnosis gives into `directory`; returns the report's path."""
    content = found.to_mapping()
    with staged(directory) as part:
        write_whole(part / DIAGNOSIS, json.dumps(content, indent=2, allow_nan=False) + "\n")
        save_axis(part / "axis.yaml", found.axis_file, f"Diagnosed by tcs-friction: {found.statement}")
        why = None
        if found.next_experiment:
            write_whole(part / EXPERIMENT, reference_text(found.next_experiment))
            why = f"{found.next_experiment['why']}. The reference is in {EXPERIMENT}."
        write_report(part, content, found.evidence, found.axis_file.axis.name, why)
    if not found.next_experiment:
        (directory / EXPERIMENT).unlink(missing_ok=True)
    return directory / "report.html"


def told_by(path: Path, axis: Axis) -> tuple[dict[str, str], dict[str, Mapping[str, float]]]:
    """What a diagnosis.json says of an axis' effects: why some should not be cancelled, standard deviations of those it names.

    Raises InputError for a file that is no diagnosis.
    """
    content = _loaded(path)
    left_out: dict[str, str] = {}
    deviations: dict[str, Mapping[str, float]] = {}
    entries = [(entry, True) for entry in content["effects"]] + [(entry, False) for entry in content["described"]]
    for name, item in effect_names(axis).items():
        entry, named = next(((e, n) for e, n in entries if _is_about(e, item.term.id, item.values)), (None, False))
        if entry is None:
            left_out[name] = UNKNOWN
        elif not named:
            left_out[name] = DESCRIBED
        else:
            deviations[name] = {key: float(value["std"]) for key, value in entry["parameters"].items()}
    return left_out, deviations


def _loaded(path: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be read ({type(error).__name__})", "the diagnosis.json of ./tcs diagnose") from None
    known = isinstance(content, dict) and all(isinstance(content.get(key), list) for key in ("effects", "described"))
    if not known:
        raise InputError(str(path), "no diagnosis", "the diagnosis.json of ./tcs diagnose")
    return dict(content)


def _is_about(entry: Mapping[str, Any], effect: str, values: Mapping[str, float]) -> bool:
    """Whether an effect of a diagnosis is one with these values."""
    stated = {name: one["value"] for name, one in entry.get("parameters", {}).items()}
    return entry.get("effect") == effect and all(
        name in values and math.isclose(value, values[name], rel_tol=1e-6) for name, value in stated.items()
    )
