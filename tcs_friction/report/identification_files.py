"""The files of an identification: the result, the axis with what was identified, pictures and report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tcs_friction.config import AxisFile, save_axis, write_whole
from tcs_friction.errors import writing_into
from tcs_friction.identify.comparison import Comparison
from tcs_friction.identify.identification import identified_axis
from tcs_friction.identify.result import Identification
from tcs_friction.identify.searches import Searches
from tcs_friction.recording.recording import Recording

IDENTIFICATION, AXIS = "identification.json", "axis.yaml"


def content_of(
    found: Identification, comparison: Comparison | None = None, searches: Searches | None = None
) -> dict[str, Any]:
    """The content of `identification.json`."""
    laws = {"laws": comparison.to_mapping()} if comparison else {}
    return {**found.to_mapping(), **laws, **({"compare": searches.to_mapping()} if searches else {})}


def write_identification(
    directory: Path,
    file: AxisFile,
    found: Identification,
    recordings: Sequence[Recording],
    comparison: Comparison | None = None,
    searches: Searches | None = None,
) -> None:
    """Write all results into `directory`; the report last, since it names the others, and not where nothing can draw.

    `file` is the axis as it was believed. Raises InputError when `directory` cannot be written to.
    """
    comment = f"Friction identified by tcs-friction ({found.law}, {found.method}, seed {found.seed})."
    text = json.dumps(content_of(found, comparison, searches), indent=2, allow_nan=False) + "\n"
    with writing_into(directory):
        write_whole(directory / IDENTIFICATION, text)
        save_axis(directory / AXIS, replace(file, axis=identified_axis(file.axis, found)), comment)
    try:
        from tcs_friction.report.identification import write_report
    except ModuleNotFoundError:
        return
    write_report(directory, found, recordings, comparison, searches)
