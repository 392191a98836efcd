"""Find the physics that a model lacks against bags: locate the mismatch, name it, model it, show the better fit.

Writes DIR/diagnosis.json, DIR/axis.yaml (the axis with the missing physics), pictures and DIR/report.html, and
DIR/next_experiment.yaml where the bags leave a question open.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from tcs_friction.commands.inputs import EACH, add_reading, add_recordings, choice_of
from tcs_friction.commands.joints import ALL, Done, for_each, tell
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.parser import name_word, share_word
from tcs_friction.commands.status_line import status_line
from tcs_friction.config import AxisFile, load_axis
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.outcome.conclusion import TOLERANCE
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import chosen_signals, joints_in, read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.recording.table_files import is_table
from tcs_friction.report.diagnosis_files import EXPERIMENT, write_diagnosis

WRITTEN = ("diagnosis.json", "axis.yaml", EXPERIMENT, "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis = "what is believed, and where the signals are"
    add_recordings(parser, "recordings, one data set with common physics", axis, axis_required=False)
    parser.add_argument(
        "--against",
        type=Path,
        metavar="SIM",
        help="bag of a simulation, whose physics is what is believed (needs no axis file); or a MuJoCo model, which is moved as "
        "the axis was",
    )
    add_reading(parser, joint=False)
    which = f"which joint of the recordings, by name or by number from 0 on; {EACH}; with a model of MuJoCo, joint of the model"
    parser.add_argument("--joint", type=name_word, default="", metavar="NAME", help=which)
    parser.add_argument("--seed", type=int, default=0, help="as of all commands; a diagnosis draws nothing (default 0)")
    tolerance = "share of the friction, as 1%% or 0.01, below which what remains is no verdict (default 0.1%%)"
    parser.add_argument("--tolerance", type=share_word, default=TOLERANCE, metavar="SHARE", help=tolerance)
    described = "write effects into axis.yaml that are described only, too, but for those that cancel each other"
    parser.add_argument("--with-described", action="store_true", help=described)
    parser.add_argument("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> None:
    """Diagnose, write everything, say what was found; of all joints one after the other with --joint all."""
    if arguments.axis is None and arguments.against is None:
        raise InputError("diagnose", "neither an axis file nor a simulation", "--axis AXIS.yaml or --against SIM")
    if arguments.seed < 0:
        raise InputError("--seed", str(arguments.seed), "a whole number from 0")
    if arguments.joint != ALL:
        tell(arguments, diagnosed_into(arguments, arguments.output))
        return
    if arguments.axis is None or arguments.against is not None:
        raise InputError("--joint all", "given with --against", "one joint, or --axis AXIS.yaml alone")
    signals = load_axis(arguments.axis).mapped(arguments.axis)
    joints = joints_in(arguments.bags[0], signals, choice_of(arguments))
    for_each(arguments, "Diagnosis", arguments.bags, joints, diagnosed_into)


def diagnosed_into(arguments: argparse.Namespace, directory: Path) -> Done:
    """One diagnosis and its files."""
    inputs = [*arguments.bags, arguments.axis, arguments.against]
    results_over_no_input(directory, WRITTEN, inputs)
    with status_line() as show:

        def progress(share: float, stage: str) -> None:
            show(f"{100.0 * share:3.0f} %  {stage}")

        file, remark = _believed(arguments, lambda share, stage: progress(0.5 * share, stage))
        file = file.at(chosen_signals(arguments.bags, file.mapped(arguments.axis), _choice(arguments)))
        recordings = _read(arguments, file, settled=True)
        file = file.measured_in(same_torque_unit(recordings))
        begin = 0.0 if arguments.against is None else 0.5
        watched = partial(_within, begin, progress)
        found = diagnose(recordings, file, watched, arguments.tolerance)
        if remark:
            found = replace(found, evidence=replace(found.evidence, notes=(f"Believed: {remark}.", *found.evidence.notes)))
        progress(1.0, "writing")
        report = write_diagnosis(directory, found, arguments.with_described)
    tell_notes(recordings)
    text = "\n".join([*([remark] if remark else []), summary(found), str(report)])
    content = found.to_mapping(arguments.with_described)
    return Done(text, content, f"{content['verdict']}: {content['headline']}", report.name)


def _within(begin: float, progress: Callable[[float, str], None], share: float, stage: str) -> None:
    """Progress of a part of the work that begins at a share of all."""
    progress(begin + (1.0 - begin) * share, stage)


def _believed(arguments: argparse.Namespace, progress: Callable[[float, str], None]) -> tuple[AxisFile, str]:
    file = load_axis(arguments.axis) if arguments.axis is not None else None
    if arguments.joint and arguments.against is not None and not all(map(is_table, arguments.bags)):
        _refuse_joint_without_model(arguments)
    if arguments.against is None:
        assert file is not None
        return file, ""
    from tcs_friction.diagnose.from_model import is_model, recorded_along
    from tcs_friction.diagnose.from_simulation import believed_from_recordings, believed_from_simulation

    if is_model(arguments.against):
        if file is None:
            found = f"{arguments.against} and no axis file"
            raise InputError("--against", found, "--axis AXIS.yaml, which says what drive and encoder are like")
        progress(0.0, "moving the model as the axis went")
        recordings = _read(arguments, file)
        moved = recorded_along(arguments.against, arguments.joint, file, recordings)
        start = replace(file.axis, effects=())
        axis, remark = believed_from_recordings(str(arguments.against), moved, start, arguments.seed, progress)
        return file.with_axis(axis), remark
    return believed_from_simulation(arguments.against, arguments.bags, file, arguments.seed, progress)


def _refuse_joint_without_model(arguments: argparse.Namespace) -> None:
    """Beside a simulation --joint is that of its model of MuJoCo. Raises InputError where it is none."""
    from tcs_friction.diagnose.from_model import is_model

    if not is_model(arguments.against):
        raise InputError("--joint", f"given with the bag {arguments.against}", "a model of MuJoCo: --against FILE.xml")


def _read(arguments: argparse.Namespace, file: AxisFile, settled: bool = False) -> tuple[Recording, ...]:
    choice = replace(_choice(arguments), settled=settled)
    return read_recordings(arguments.bags, file.mapped(arguments.axis), choice, file.axis.kind)


def _choice(arguments: argparse.Namespace) -> Choice:
    """What is said of the recordings; --joint is not theirs where a model of MuJoCo has joints as well."""
    from tcs_friction.diagnose.from_model import is_model

    choice = choice_of(arguments)
    return replace(choice, joint="") if arguments.against is not None and is_model(arguments.against) else choice


def _left(row: Mapping[str, float | None]) -> str:
    """What a model leaves of each part of the data, in columns."""
    return " ".join(f"{'-':>10}" if row[part] is None else f"{row[part]:10.4g}" for part in ("train", "held_out", "untouched"))


def summary(found: Diagnosis) -> str:
    """The statement and the numbers behind it, for a terminal."""
    content = found.to_mapping()
    unit, position = (unit_of(name, found.axis_file.axis) for name in ("torque", "position"))
    lines = [f"{content['verdict']}: {content['headline']}", content["statement"]]
    for entry in content["effects"]:
        values = ", ".join(f"{name} {p['value']:.5g} {p.get('unit') or ''}".rstrip() for name, p in entry["parameters"].items())
        other = f"; or {', '.join(entry['equivalent'])}" if entry["equivalent"] else ""
        size = f"{entry['torque_rms']:9.3g} {unit} rms  {entry['probability']:5.0%}"
        lines.append(f"  {entry['effect']:28} {size}  {values}{other}")
    for entry in content["described"]:
        why = "; ".join(one["words"] for one in entry["refused"])
        lines.append(f"  described: {entry['effect']}, {entry['torque_rms']:.3g} {unit} rms: {why}")
    for entry in content["refused"]:
        lines.append(f"  not taken: {entry['effect']}: {entry['words']} ({entry['question']} No.)")
    fit, free, loop = content["fit"], content["free_run"], content["closed_loop"]
    head = f"{'':10} {'train':>10} {'held out':>10} {'untouched':>10}  {unit} rms"
    head += f"   free run {free['horizon']:.3g} s, {position} rms"
    lines.append(head + ("   closed loop" if loop else ""))
    for name in ("believed", "retuned", "improved"):
        row = fit[name]
        line = f"{name:10} {_left(row)} {free['position_rms'][name]:21.4g}"
        lines.append(line + (f"{loop['position_rms'][name]:20.4g}" if loop else ""))
    if content["described"]:
        lines.append(f"{'axis.yaml':10} {_left(fit['written'])}   with what is named alone")
    lines.append(f"{'noise':10} {fit['noise_floor']:10.4g}")
    lines.append(found.visible.words(unit))
    if content["next_experiment"]:
        lines.append(f"next: {content['next_experiment']['why']} ({EXPERIMENT})")
    return "\n".join(lines)
