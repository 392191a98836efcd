"""Every friction law on every recording of real hardware: what it leaves unexplained, table and report with residuals drawn.

A recording is a folder with axis.yaml and a bag named recording; --data names the folder that holds them (default: data in
TCS_FRICTION_DATA or ../shared). Laws are judged by samples that no fit has seen. Nothing is chosen or tuned by hand.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.identify.identification import identify
from tcs_friction.physics.registry import compared_laws, law
from tcs_friction.recording.bags import read_recordings
from tcs_friction.report.hardware import SIMPLEST, Subject, write_report
from tcs_friction.writable import output_directory

ROOT = Path(__file__).resolve().parent.parent


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's arguments."""
    parser.add_argument("--data", type=Path, help="folder of recordings")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="names of recordings")
    parser.add_argument("--laws", nargs="*", metavar="LAW", help=f"laws beside {SIMPLEST} (default: all that have a formula)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "-o",
        "--output",
        type=output_directory,
        default="hardware",
        metavar="DIR",
        help="where the report goes (hardware)",
    )


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Identify, write the report, return the numbers."""
    folders = recordings_in(arguments.data or data_folder(), arguments.only)
    names = compared_laws() if arguments.laws is None else sorted({SIMPLEST, *arguments.laws})
    for name in names:
        law(name, "bench hardware: --laws")
    subjects = [subject_of(folder, names, arguments.seed) for folder in folders]
    path = write_report(arguments.output, subjects)
    print(path, file=sys.stderr)
    return [row for subject in subjects for row in _rows(subject)]


def data_folder() -> Path:
    """Where the recordings lie that came with the project."""
    named = os.environ.get("TCS_FRICTION_DATA")
    return (Path(named) if named else ROOT.parent / "shared") / "data"


def recordings_in(folder: Path, only: Sequence[str] | None) -> list[Path]:
    """The folders with axis.yaml and recording; InputError when there are none, or none of a name."""
    found = {path.parent.name: path.parent for path in sorted(folder.glob("*/axis.yaml"))}
    if not found:
        raise InputError(str(folder), "no recordings", "folders with axis.yaml and recording (--data)")
    for name in only or ():
        if name not in found:
            raise InputError("bench hardware: --only", f"no recording {name!r}", f"one of {', '.join(found)}")
    return [found[name] for name in only or found]


def subject_of(folder: Path, names: Sequence[str], seed: int) -> Subject:
    """A recording with what each law makes of it."""
    file = load_axis(folder / "axis.yaml")
    recordings = read_recordings([folder / "recording"], file.mapped(folder / "axis.yaml"))
    found = {}
    for name in names:
        if sys.stderr.isatty():
            print(f"{folder.name}: {name}", file=sys.stderr)
        found[name] = identify(recordings, file.axis, "default", name, seed)
    readme = folder / "README.md"
    title = readme.read_text(encoding="utf-8").splitlines()[0].lstrip("# ") if readme.is_file() else ""
    return Subject(folder.name, title, file.axis.kind, recordings[0], found)


def _rows(subject: Subject) -> list[dict[str, Any]]:
    """Each law's residual beside that of Coulomb and viscous friction."""
    beside = subject.found[SIMPLEST].rmse.held_out
    unit = subject.best.offset.unit
    rows = []
    for name in subject.ranking:
        value = subject.found[name].rmse.held_out
        title = f"{subject.name}: {name}, residual on held-out samples"
        rows.append({"name": title, "value": value, "unit": unit, "beside": beside, "ratio": beside / value})
    return rows
