"""Predict what cancelling friction and the effects of an axis model gains on a run, before anyone lets it act.

The axis is simulated as its file describes it, with the noise of its drive and encoder: without compensation, with the friction
law's, with each effect's beside it, with all. Identification and diagnosis say how sure its numbers are, and so how sure the gain
is. A recording gives the run, its controller, and its own tracking error to hold beside the simulated one. Writes
DIR/compensation.json, pictures and DIR/report.html.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tcs_friction.commands.inputs import add_reading, choice_of
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.recorded_run import RecordedRun, no_reference, read_reference, read_run
from tcs_friction.commands.simulate import read_surroundings, surroundings
from tcs_friction.commands.status_line import status_line
from tcs_friction.config import AxisFile, Control, default_control, load_axis, write_whole
from tcs_friction.control.loop import Wanted
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.control.spread import Spread, independent
from tcs_friction.control.worth import (
    ALL,
    LAW,
    LEAST_DRAWS,
    NOTHING,
    Beside,
    Task,
    compensation_along,
    shown_error,
    worth,
)
from tcs_friction.errors import InputError, printable, writing_into
from tcs_friction.report.compensation import Prediction, lines, text_table, to_mapping, write_report
from tcs_friction.report.diagnosis_files import told_by
from tcs_friction.report.identification_files import IDENTIFICATION
from tcs_friction.report.identification_spread import spread_by
from tcs_friction.writable import output_directory

WRITTEN = ("compensation.json", "report.html", "compensation.png", "tracking_error.png")
NOT_SURE = "how sure the parameters are is not known (--identification, --diagnosis): the intervals are those of noise alone"
NO_NOISE = "the axis file has no drive noise: what compensation leaves is predicted too small"
NO_INTERVAL = "neither noise nor how sure the parameters are is known: the prediction is the best case, and has no interval"
STAGES = {"nothing": NOTHING, "law": LAW, "everything": ALL}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("axis", type=Path, metavar="AXIS.yaml", help="the model: an axis file, such as identify or diagnose writes")
    add("--reference", type=Path, metavar="REF", help="the run to be compensated: a reference file, or a recording of one")
    add("-o", "--output", type=output_directory, required=True, metavar="DIR", help="directory of the results")
    add("--identification", type=Path, metavar="JSON", help="that the axis file came with (default: beside it, if there)")
    add("--diagnosis", type=Path, metavar="JSON", help="diagnosis.json that the axis file came with")
    add("--recording", type=Path, metavar="BAG", help="a run of the axis: shows its controller and error, and the reference")
    add("--recorded-with", choices=STAGES, help="what was compensated in the recording (default nothing)")
    add("--surroundings", type=Path, metavar="BAG", help="recording of temperature and signals (default: 20 degC, 0)")
    add_reading(parser)
    add("--draws", type=int, default=LEAST_DRAWS, help="of parameters and noise (default %(default)s)")
    add("--settle", type=float, default=2.0, metavar="S", help="beginning of the run that does not count (default 2)")
    add("--seed", type=int, default=0, help="of all noise and draws (default 0)")
    add("--json", action="store_true", help="print the result as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Predict, write, say what came out."""
    identification = _identification(arguments)
    given = ("axis", "reference", "diagnosis", "recording", "surroundings")
    results_over_no_input(arguments.output, WRITTEN, [identification, *(getattr(arguments, name) for name in given)])
    for name, least in (("draws", LEAST_DRAWS), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}", str(getattr(arguments, name)), f"a whole number from {least}")
    if arguments.recorded_with and not arguments.recording:
        raise InputError("--recorded-with", "given without a recording", "--recording BAG beside it")
    file = load_axis(arguments.axis)
    known = _known(arguments, file, identification)
    with status_line() as show:
        found, notes = _predicted(arguments, file, known, lambda share: show(f"{100.0 * share:3.0f} %"))
    text = json.dumps(to_mapping(found, file.axis), allow_nan=False)
    with writing_into(arguments.output):
        write_whole(arguments.output / "compensation.json", text + "\n")
    on = (arguments.reference or arguments.recording).name
    path = write_report(arguments.output, found, file.axis, on, notes)
    for line in notes:
        print(f"tcs-friction: {printable(line)}", file=sys.stderr)
    print(text if arguments.json else "\n".join([*lines(found, file.axis), text_table(found, file.axis), str(path)]))


@dataclass(frozen=True)
class _Known:
    """What identification and diagnosis say: effects not to be cancelled and why, how sure the numbers are, notes."""

    left_out: Mapping[str, str]
    spread: Spread
    notes: tuple[str, ...]


def _identification(arguments: argparse.Namespace) -> Path | None:
    """The identification.json that was given, or lies beside the axis file."""
    if arguments.identification is not None:
        return Path(arguments.identification)
    beside = Path(arguments.axis).with_name(IDENTIFICATION)
    return beside if beside.is_file() else None


def _known(arguments: argparse.Namespace, file: AxisFile, identification: Path | None) -> _Known:
    left_out, deviations = told_by(arguments.diagnosis, file.axis) if arguments.diagnosis else ({}, {})
    if arguments.diagnosis and file.axis.effects and not deviations:
        unknown = f"names no effect of {file.axis.name}"
        raise InputError(str(arguments.diagnosis), unknown, "the diagnosis that wrote the axis file")
    spread, notes = Spread(), []
    if identification is not None:
        if arguments.identification is None:
            notes.append(f"{identification} lies beside the axis file and says how sure its numbers are")
        spread, told = spread_by(identification, file.axis)
        notes += told
    spread = spread.with_independent(independent(deviations))
    noisy = file.axis.drive.noise > 0.0
    if not (noisy or file.axis.sensors.noise > 0.0 or spread):
        return _Known(left_out, spread, (*notes, NO_INTERVAL))
    notes += [] if spread else [NOT_SURE]
    notes += [] if noisy else [NO_NOISE]
    return _Known(left_out, spread, tuple(notes))


def _predicted(
    arguments: argparse.Namespace, file: AxisFile, known: _Known, progress: Callable[[float], None]
) -> tuple[Prediction, list[str]]:
    """The prediction, and notes."""
    control, notes = file.control or default_control(file.axis), list(known.notes)
    recorded = _recorded(arguments, file, control, notes)
    reference = _reference(arguments, file, control, recorded, notes)
    task = _task(arguments, file, control, reference, recorded, notes)
    draws = 0 if NO_INTERVAL in notes else arguments.draws
    if recorded is None or recorded.reference is None:
        return Prediction(worth(file.axis, task, known.left_out, known.spread, draws, progress)), notes
    stage = STAGES[arguments.recorded_with or "nothing"]
    same = reference is recorded.reference
    there = task if same else _task(arguments, file, control, recorded.reference, recorded, [])
    added = None if stage == NOTHING else compensation_along(file.axis, there, stage, known.left_out)
    shown = recorded.controller(file, control.controller, added)
    task, there = (replace(one, controller=shown.controller) for one in (task, there))
    spread = known.spread.with_independent(shown.spread)
    found = worth(file.axis, task, known.left_out, spread, draws, progress)
    rms, between = shown_error(file.axis, there, stage, known.left_out, spread, draws, found if same else None)
    return Prediction(found, shown, Beside(stage, recorded.rms(arguments.settle), rms, between)), notes


def _recorded(arguments: argparse.Namespace, file: AxisFile, control: Control, notes: list[str]) -> RecordedRun | None:
    """The run that --recording names."""
    if arguments.recording is None:
        return None
    run = read_run(arguments.recording, file, arguments.axis, control.controller, choice_of(arguments))
    notes += [f"{arguments.recording}: {note}" for note in run.notes]
    if run.reference is None:
        if arguments.reference is None:
            raise no_reference(arguments.recording, file, arguments.axis)
        notes.append(f"{arguments.recording}: no reference, so that its controller and tracking error are not known")
    return run


def _reference(
    arguments: argparse.Namespace, file: AxisFile, control: Control, recorded: RecordedRun | None, notes: list[str]
) -> Wanted:
    """Of the run to be compensated."""
    if arguments.reference is not None:
        choice = choice_of(arguments)
        reference, told = read_reference(arguments.reference, file, arguments.axis, control.controller, choice)
        notes += told
        return reference
    if recorded is None or recorded.reference is None:
        raise InputError("compensate", "no run to be compensated", "--reference REF.yaml or --recording BAG")
    return recorded.reference


def _task(
    arguments: argparse.Namespace,
    file: AxisFile,
    control: Control,
    reference: Wanted,
    recorded: RecordedRun | None,
    notes: list[str],
) -> Task:
    """A run of the axis, in the surroundings that were given or, of the recorded run, recorded."""
    source = read_surroundings(file, arguments.surroundings, choice_of(arguments))
    if source is None and recorded is not None and reference is recorded.reference:
        source = recorded.recording
    temperature, exogenous, told = surroundings(file, reference, control.loop, source)
    notes += told
    return Task(
        reference,
        control.controller,
        control.loop,
        control.observer,
        temperature,
        {name: exogenous[name] for name in signals_of(file.axis)},
        arguments.seed,
        arguments.settle,
    )
