"""Predict what cancelling the effects of an axis model gains on a run, before anyone lets it act.

The axis is simulated as its file describes it, under the file's own controller: without compensation, with the friction law's,
with each effect's beside it, with all. Where a diagnosis is given, only what it names is cancelled, and its standard deviations
say how sure the gain is. Writes DIR/compensation.json, pictures and DIR/report.html.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from tcs_friction.commands.inputs import add_reading, choice_of
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.simulate import surroundings
from tcs_friction.config import default_control, load_axis, write_whole
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.control.reference import load_reference
from tcs_friction.control.worth import Task, worth
from tcs_friction.errors import InputError, writing_into
from tcs_friction.report.compensation import sentence, text_table, to_mapping, write_report
from tcs_friction.report.diagnosis_files import told_by
from tcs_friction.writable import output_directory

WRITTEN = ("compensation.json", "report.html", "compensation.png", "tracking_error.png")
NO_DEVIATIONS = "how sure the parameters are is not known (--diagnosis gives it)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("axis", type=Path, metavar="AXIS.yaml", help="the model: an axis file with effects, such as a diagnosis writes")
    add("--reference", type=Path, required=True, metavar="REF.yaml", help="the run to be compensated")
    add("-o", "--output", type=output_directory, required=True, metavar="DIR", help="directory of the results")
    add("--diagnosis", type=Path, metavar="JSON", help="diagnosis.json that the axis file came with")
    add("--surroundings", type=Path, metavar="BAG", help="recording of temperature and signals (default: 20 degC, 0)")
    add_reading(parser)
    add("--draws", type=int, default=16, help="of parameters within their standard deviations (default 16)")
    add("--settle", type=float, default=2.0, metavar="S", help="beginning of the run that does not count (default 2)")
    add("--seed", type=int, default=0, help="of all noise and draws (default 0)")
    add("--json", action="store_true", help="print the result as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Predict, write, say what came out."""
    given = [arguments.axis, arguments.reference, arguments.diagnosis, arguments.surroundings]
    results_over_no_input(arguments.output, WRITTEN, given)
    for name, least in (("draws", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}", str(getattr(arguments, name)), f"a whole number from {least}")
    file, reference = load_axis(arguments.axis), load_reference(arguments.reference)
    if not file.axis.effects:
        raise InputError(str(arguments.axis), "no effects", "an axis file with effects, such as ./tcs diagnose writes")
    control = file.control or default_control(file.axis)
    temperature, exogenous, notes = surroundings(file, reference, control.loop, arguments.surroundings, choice_of(arguments))
    left_out, deviations = told_by(arguments.diagnosis, file.axis) if arguments.diagnosis else ({}, {})
    if arguments.diagnosis and not deviations:
        unknown = f"names no effect of {file.axis.name}"
        raise InputError(str(arguments.diagnosis), unknown, "the diagnosis that wrote the axis file")
    notes += [] if deviations else [NO_DEVIATIONS]
    task = Task(
        reference,
        control.controller,
        control.loop,
        control.observer,
        temperature,
        {name: exogenous[name] for name in signals_of(file.axis)},
        arguments.seed,
        arguments.settle,
    )
    found = worth(file.axis, task, left_out, deviations, arguments.draws)
    text = json.dumps(to_mapping(found, file.axis), allow_nan=False)
    with writing_into(arguments.output):
        write_whole(arguments.output / "compensation.json", text + "\n")
    path = write_report(arguments.output, found, file.axis, arguments.reference.name, notes)
    if arguments.json:
        print(text)
        return
    for line in notes:
        print(f"tcs-friction: {line}", file=sys.stderr)
    print("\n".join([sentence(found, file.axis), text_table(found, file.axis), str(path)]))
