"""Write a first axis file from a recording alone: signals proposed, inertia and friction fitted with no guess.

Takes a bag, or a table (.csv, .parquet; `./tcs bag import` makes the bag that the file then describes). Every value says how sure
it is and where it comes from. Look at the file before a loop is closed with it.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.commands.inputs import EACH, add_reading, choice_of
from tcs_friction.commands.joints import ALL, Done, for_each, tell
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import never_over_an_input
from tcs_friction.commands.parser import name_word
from tcs_friction.commands.signal_words import add_signals, named_signals, of_joint, with_signals
from tcs_friction.commands.status_line import status_line
from tcs_friction.config import axis_file_mapping, write_whole
from tcs_friction.errors import InputError, printable
from tcs_friction.identify.first_axis import FirstAxis, first_axis
from tcs_friction.identify.first_axis_reasons import doubts, reasons
from tcs_friction.recording.bags import agreeing, joints_in, read_recordings
from tcs_friction.recording.decode import READABLE, SERIALISED
from tcs_friction.recording.info import BagInfo, bag_info
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.table_files import is_table
from tcs_friction.recording.tables import import_table
from tcs_friction.writable import output_directory, output_file, output_path
from tcs_friction.yaml_files import dump_yaml

LINEAR_WORDS = ("linear", "slide", "carriage", "gantry", "prismatic", "stage", "force", "thrust", "rail", "ballscrew")
"""In the name of a joint, topic or field: an axis that moves along a line."""
AXIS = "axis.yaml"
FULL_TURN = 2.0 * np.pi
DIGITS = 6
WIDTH = 60  # column at which comments begin, where the values leave room


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("recordings", nargs="+", type=Path, metavar="BAG_OR_CSV", help="recordings of one axis under one controller")
    add("-o", "--output", required=True, type=output_path, metavar="AXIS.yaml", help="axis file; with --joint all a folder")
    add("--name", type=name_word, help="of the axis (default: its joint's name, or the file's)")
    add("--kind", choices=("rotary", "linear"), help="of the axis (default: told from units, names and travel)")
    add_reading(parser, joint=False)
    which = f"which joint, by name or by number from 0 on (default: 0, the first); of a table with one, what to call it; {EACH}"
    add("--joint", type=name_word, default="", metavar="NAME", help=which)
    add_signals(parser)
    add("--force", action="store_true", help="replace an existing file")
    add("--json", action="store_true", help="print what was found as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Fit, write, say what to look at; of all joints one after the other with --joint all."""
    if arguments.joint != ALL:
        output_file(arguments.output)
        tell(arguments, _made(arguments, arguments.output))
        return
    output_directory(arguments.output)
    if arguments.name:
        raise InputError("--name", "given with --joint all", "the joints' own names")
    first = arguments.recordings[0]
    signals = None if is_table(first) else _signals(arguments, "0")
    joints = joints_in(first, signals, choice_of(arguments))
    for_each(arguments, "First axis files", arguments.recordings, joints, lambda given, folder: _made(given, folder / AXIS))


def _made(arguments: argparse.Namespace, path: Path) -> Done:
    """One axis file."""
    never_over_an_input([path], arguments.recordings)
    if path.exists() and not arguments.force:
        raise InputError(str(path), "exists already", "a new file, or --force")
    recordings, signals, kind = _read(arguments)
    name = arguments.name or signals.position.joint or arguments.recordings[0].stem
    if kind is None:
        kind, why = _kind(recordings, signals)
    else:
        why = "as asked for" if arguments.kind else "by the units"
    with status_line() as show:
        found = first_axis(recordings, name, kind, signals, show)
    told = {("axis", "kind"): why, **reasons(found, recordings)}
    sources = ", ".join(map(str, arguments.recordings))
    heading = [f"Made by tcs-friction from {sources}. Look at it before a loop is closed with it."]
    heading += [f"Doubtful: {line}." for line in doubts(found)]
    write_whole(path, text_of(axis_file_mapping(found.file), told, heading))
    tell_notes(recordings)
    return _done(path, found, why)


def _read(arguments: argparse.Namespace) -> tuple[Sequence[Recording], SignalMap, str | None]:
    """Recordings, their signals, and the kind of axis as far as it is told."""
    tables, choice = [is_table(path) for path in arguments.recordings], choice_of(arguments)
    if any(tables) and not all(tables):
        raise InputError("recordings", "bags and tables together", "bags, or tables")
    if all(tables) and arguments.signal:
        raise InputError("--signal", "given for a table", "a bag, or --column for a table")
    if all(tables):
        imported = [import_table(path, choice.joint, choice.columns, kind=arguments.kind) for path in arguments.recordings]
        first = imported[0]
        return agreeing([one.recording for one in imported], choice), first.signals, arguments.kind or first.kind
    if arguments.column:
        raise InputError("--column", "given for a bag", "a table, or --signal for a bag")
    signals = _signals(arguments, choice.joint)
    return read_recordings(arguments.recordings, signals, replace(choice, joint="")), signals, arguments.kind


def _signals(arguments: argparse.Namespace, joint: str) -> SignalMap:
    """The signals of the first bag, those that are named and the others as proposed; says which joint it takes of several."""
    info, where = bag_info(arguments.recordings[0]), str(arguments.recordings[0])
    proposal = with_signals(of_joint(info.signals, info.joints, joint or None), named_signals(arguments.signal))
    if not {"position", "torque"} <= set(proposal):
        raise _lacking(info, proposal)
    signals = SignalMap.from_mapping(proposal, where)
    if len(info.joints) > 1 and not joint and signals.position.joint is not None:
        names = ", ".join(f"{number} {name}" for number, name in enumerate(info.joints))
        taken = f"{where}: joint {signals.position.joint} taken of {names}; --joint takes another"
        print(f"tcs-friction: {printable(taken)}", file=sys.stderr)
    return signals


def _lacking(info: BagInfo, proposal: Mapping[str, Any]) -> InputError:
    """The refusal of a bag in which nothing looks like a position or a torque."""
    foreign = next((line for topic in info.topics for line in topic.findings if line.startswith(SERIALISED)), "")
    if foreign:
        return InputError(info.path, foreign, READABLE)
    lacking = [name for name in ("position", "torque") if name not in proposal]
    expected = " and ".join(f"--signal {name}=/TOPIC:FIELD" for name in lacking)
    return InputError(info.path, f"nothing in it looks like {' and '.join(lacking)} of an axis", f"{expected} (./tcs bag info)")


def _kind(recordings: Sequence[Recording], signals: SignalMap) -> tuple[str, str]:
    """Rotary or linear, and why; a position alone does not tell."""
    for source in (signals.position, signals.torque):
        for text in (source.joint or "", source.topic, source.field):
            word = next((word for word in LINEAR_WORDS if word in text.lower()), None)
            if word is not None:
                return "linear", f"{text!r} says so"
    travel = max(float(np.ptp(one.position)) for one in recordings)
    if travel > FULL_TURN:
        return "rotary", f"it travels {travel:.3g}, more than a turn"
    return "rotary", f"nothing says so: it travels {travel:.3g}; --kind linear if that is in metres"


def text_of(content: Mapping[str, Any], told: Mapping[tuple[str, ...], str], heading: Sequence[str]) -> str:
    """An axis file as YAML, with each reason as a comment behind the line that it is about.

    >>> print(text_of({"axis": {"inertia": 2.0}}, {("axis", "inertia"): "± 0.1 kg m^2"}, ["First."]), end="")
    # First.
    axis:
      inertia: 2.0                                              # ± 0.1 kg m^2
    """
    lines = [f"# {line}" for line in heading]
    path: list[str] = []
    for line in dump_yaml(_rounded(dict(content))).splitlines():
        match = re.match(r"( *)(\w+):", line)
        if match is not None:
            path = [*path[: len(match[1]) // 2], match[2]]
            reason = told.get(tuple(path))
            if reason:
                line = f"{line.ljust(WIDTH - 1)} # {reason}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _rounded(value: Any) -> Any:
    """Numbers with the digits that a person reads."""
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _done(path: Path, found: FirstAxis, why: str) -> Done:
    axis, doubtful = found.file.axis, tuple(doubts(found))
    content = {"file": str(path), "axis": axis.name, "kind": axis.kind, "inertia": axis.inertia, "law": axis.friction.term.id}
    content |= {"laws": [law.to_mapping() for law in found.rough], "doubts": list(doubtful)}
    said = f"{axis.kind} axis {axis.name} ({why}), {axis.inertia:.4g} {axis.unit('kg m^2')}, {axis.friction.term.id}"
    text = "\n".join([f"{path}: {said}", *(f"  doubtful: {line}" for line in doubtful)])
    return Done(text, content, "; doubtful: ".join([said, *doubtful]), path.name)
