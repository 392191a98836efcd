"""The files of an identification: the result, the axis with what was identified, pictures and report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tcs_friction.config import AxisFile, save_axis, write_whole
from tcs_friction.identify.comparison import Comparison
from tcs_friction.identify.identification import identified_axis
from tcs_friction.identify.result import Identification
from tcs_friction.identify.searches import Searches
from tcs_friction.recording.recording import Recording
from tcs_friction.writable import staged

IDENTIFICATION, AXIS = "identification.json", "axis.yaml"
SOMETIMES = ("report.html", *(f"{name}.png" for name in ("cost", "laws", "profiles", "searches", "friction_speed")))
"""Files that only some identifications write."""


def content_of(
    found: Identification, comparison: Comparison | None = None, searches: Searches | None = None
) -> dict[str, Any]:
    """The content of `identification.json`."""
    laws = {"laws": comparison.to_mapping()} if comparison else {}
    return {**found.to_mapping(), **laws, **({"compare": searches.to_mapping()} if searches else {})}


def identified_file(file: AxisFile, found: Identification) -> AxisFile:
    """The axis file with what was identified: the axis, and when the logged torque acts, where that was found."""
    signals, timing = file.signals, found.timing
    if signals is not None and timing is not None and timing.acts.determined:
        signals = replace(signals, torque=replace(signals.torque, acts=round(timing.acts.value, 9)))
    return replace(file, axis=identified_axis(file.axis, found), signals=signals)


def write_identification(
    directory: Path,
    file: AxisFile,
    found: Identification,
    recordings: Sequence[Recording],
    comparison: Comparison | None = None,
    searches: Searches | None = None,
) -> None:
    """Write all results into `directory`, whole or not at all; no report where nothing can draw.

    `file` is the axis as it was believed. Raises InputError when `directory` cannot be written to.
    """
    comment = f"Friction identified by tcs-friction ({found.law}, {found.method}, seed {found.seed})."
    text = json.dumps(content_of(found, comparison, searches), indent=2, allow_nan=False) + "\n"
    with staged(directory, *SOMETIMES) as part:
        write_whole(part / IDENTIFICATION, text)
        save_axis(part / AXIS, identified_file(file, found), comment)
        try:
            from tcs_friction.report.identification import write_report
        except ModuleNotFoundError:
            return
        write_report(part, found, recordings, comparison, searches)
