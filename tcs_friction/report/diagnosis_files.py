"""The files of a diagnosis: the result, the improved axis, the next experiment, pictures and report, whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tcs_friction.config import save_axis, write_whole
from tcs_friction.diagnose.outcome.experiment import reference_text
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.errors import writing_into
from tcs_friction.report.diagnosis import write_report

EXPERIMENT = "next_experiment.yaml"


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
        write_whole(part / "diagnosis.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
        save_axis(part / "axis.yaml", found.axis_file, f"Diagnosed by tcs-friction: {found.statement}")
        why = None
        if found.next_experiment:
            write_whole(part / EXPERIMENT, reference_text(found.next_experiment))
            why = f"{found.next_experiment['why']}. The reference is in {EXPERIMENT}."
        write_report(part, content, found.evidence, found.axis_file.axis.name, why)
    if not found.next_experiment:
        (directory / EXPERIMENT).unlink(missing_ok=True)
    return directory / "report.html"
