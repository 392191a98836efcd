"""Predict what cancelling the effects of an axis model gains on a run, before anyone lets it act.

The axis is simulated as its file describes it, under the file's own controller: without compensation, with the friction law's,
with each effect's beside it, with all. Where a diagnosis is given, only what it names is cancelled, and its standard deviations
say how sure the gain is. Writes DIR/compensation.json, a picture and DIR/report.html.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.simulate import surroundings
from tcs_friction.config import AxisFile, default_control, load_axis, write_whole
from tcs_friction.control.model_compensator import effect_names, signals_of
from tcs_friction.control.reference import load_reference
from tcs_friction.control.worth import Task, worth
from tcs_friction.errors import InputError, writing_into
from tcs_friction.report.compensation import sentence, text_table, to_mapping, write_report
from tcs_friction.writable import output_directory

WRITTEN = ("compensation.json", "report.html", "compensation.png")
DESCRIBED = "the diagnosis describes it only"
NO_DEVIATIONS = "how sure the parameters are is not known (--diagnosis gives it)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("axis", type=Path, metavar="AXIS.yaml", help="the model: an axis file with effects, such as a diagnosis writes")
    add("--reference", type=Path, required=True, metavar="REF.yaml", help="the run to be compensated")
    add("-o", "--output", type=output_directory, required=True, metavar="DIR", help="directory of the results")
    add("--diagnosis", type=Path, metavar="JSON", help="diagnosis.json that the axis file came with")
    add("--surroundings", type=Path, metavar="BAG", help="recording of temperature and signals (default: 20 degC, 0)")
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
    temperature, exogenous, notes = surroundings(file, reference, control.loop, arguments.surroundings)
    left_out, deviations = diagnosed(file, arguments.diagnosis) if arguments.diagnosis else ({}, {})
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


def diagnosed(file: AxisFile, path: Path) -> tuple[dict[str, str], dict[str, Mapping[str, float]]]:
    """Effects of an axis that a diagnosis only describes, and standard deviations of those that it names, by name.

    Raises InputError for a file that is no diagnosis, or one of another axis.
    """
    content = _loaded(path)
    left_out: dict[str, str] = {}
    deviations: dict[str, Mapping[str, float]] = {}
    entries = [(entry, True) for entry in content["effects"]] + [(entry, False) for entry in content["described"]]
    for name, item in effect_names(file.axis).items():
        entry, named = next(((e, n) for e, n in entries if _is_about(e, item.term.id, item.values)), (None, False))
        if entry is None:
            left_out[name] = "the diagnosis does not know it"
        elif not named:
            left_out[name] = DESCRIBED
        else:
            deviations[name] = {key: float(value["std"]) for key, value in entry["parameters"].items()}
    if not deviations:
        raise InputError(str(path), f"names no effect of {file.axis.name}", "the diagnosis that wrote the axis file")
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
