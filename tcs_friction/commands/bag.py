"""Look into bags, export a recording to a table, import a table as a bag.

  info    topics, types, rates, gaps, damage; what reading position and torque finds; a proposal for an axis file's signals
  export  the signals of an axis to .csv or .parquet, units in the column names
  import  a table becomes a bag: columns time, position and torque, others if there are any
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from tcs_friction.commands.inputs import add_columns, add_reading, choice_of
from tcs_friction.commands.outputs import never_over_an_input
from tcs_friction.commands.parser import name_word
from tcs_friction.commands.signal_words import add_signals, named_signals, of_joint, with_signals
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError, TcsError, printable
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.choice import columns_of
from tcs_friction.recording.health import health, table_health
from tcs_friction.recording.info import bag_info, info_text
from tcs_friction.recording.mending import refuse_mended
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.table_files import is_table
from tcs_friction.recording.tables import export_table, import_table
from tcs_friction.recording.write import EPOCH, write_recording
from tcs_friction.writable import new_output, output_file
from tcs_friction.yaml_files import dump_yaml

MOST_SAMPLES = 100_000
"""Of a recording, by which it is told when a torque acts: half a minute of 4 kHz, and a second of work."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    commands = parser.add_subparsers(dest="what", required=True, metavar="info|export|import")
    info = commands.add_parser("info", help="what is in a bag or table")
    info.add_argument("bag", type=Path, metavar="BAG")
    info.add_argument("--joint", type=name_word, help="which joint to look at, by name or by number from 0 on (default: 0)")
    add_signals(info)
    add_columns(info)
    export = commands.add_parser("export", help="a recording as a table")
    export.add_argument("bag", type=Path, metavar="BAG")
    export.add_argument("--axis", type=Path, required=True, metavar="AXIS.yaml", help="where the signals are")
    export.add_argument("-o", "--output", type=output_file, required=True, metavar="FILE", help=".csv or .parquet")
    table = commands.add_parser("import", help="a table as a bag")
    table.add_argument("file", type=Path, metavar="FILE")
    table.add_argument("-o", "--output", type=new_output, required=True, metavar="BAG", help="bag to write")
    table.add_argument("--axis", type=Path, metavar="AXIS.yaml", help="put the signals where this file has them")
    add_reading(table, joint=False)
    which = "joint of a table that has several, by name or number from 0; of another, what to call it (default: axis)"
    table.add_argument("--joint", type=name_word, default="", metavar="NAME", help=which)
    for command in (info, export, table):
        command.add_argument("--json", action="store_true", help="print the result as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Do one of the three."""
    {"info": _info, "export": _export, "import": _import}[arguments.what](arguments)


def _info(arguments: argparse.Namespace) -> None:
    if is_table(arguments.bag):
        _table_info(arguments)
        return
    if arguments.column:
        raise InputError("--column", f"given for {arguments.bag}", "a table")
    info = bag_info(arguments.bag)
    block = with_signals(of_joint(info.signals, info.joints, arguments.joint), named_signals(arguments.signal))
    info = replace(info, signals=block)
    found = health(arguments.bag, block, _acting)
    if arguments.json:
        print(json.dumps(info.to_mapping() | {"health": found.to_mapping() if found else None}, allow_nan=False))
    else:
        print(info_text(info, found.lines() if found else ()))


def _table_info(arguments: argparse.Namespace) -> None:
    if arguments.signal:
        raise InputError("--signal", "given for a table", "a bag, or --column for a table")
    imported = import_table(arguments.bag, arguments.joint or "", columns_of(arguments.column))
    found = table_health(imported, _acting)
    content = {"path": str(arguments.bag), "start": imported.recording.start * 1e-9, "duration": found.duration}
    if arguments.json:
        print(json.dumps(content | {"kind": imported.kind, "health": found.to_mapping()}, allow_nan=False))
    else:
        heading = f"{arguments.bag}: {found.samples} rows, {found.duration:.6g} s"
        print("\n".join(printable(line) for line in [heading, "", *found.lines()]))


def _acting(recording: Recording) -> float | None:
    """When its torque acts, s after its stamp; None where the motion does not tell."""
    from tcs_friction.conditioning.checks import check_changes
    from tcs_friction.conditioning.motion import prepare
    from tcs_friction.identify.timing import likely_lag

    longest = max(recording.segments, key=lambda part: part.stop - part.start)
    try:
        check_changes([recording])
        motion = prepare([recording.part(slice(longest.start, min(longest.stop, longest.start + MOST_SAMPLES)))])
        lag = likely_lag(motion)
    except TcsError:  # whoever identifies is told why
        return None
    return motion.timing.acts + lag.late * lag.better if lag.told else None


def _export(arguments: argparse.Namespace) -> None:
    never_over_an_input([arguments.output], [arguments.bag, arguments.axis])
    file = load_axis(arguments.axis)
    signals = file.mapped(arguments.axis)
    (recording,) = read_recordings([arguments.bag], signals, kind=file.axis.kind)
    export_table(recording, arguments.output, file.axis.kind, signals)
    _tell(arguments, recording.notes, {"file": str(arguments.output), "samples": len(recording), "duration": recording.duration})


def _import(arguments: argparse.Namespace) -> None:
    file = load_axis(arguments.axis) if arguments.axis else None
    choice = choice_of(arguments)
    signals, kind = (file.signals, file.axis.kind) if file else (None, None)
    imported = import_table(arguments.file, choice.joint, choice.columns, signals, kind)
    if choice.strict:
        refuse_mended([imported.recording])
    write_recording(arguments.output, imported.recording, imported.signals, imported.recording.start or EPOCH)
    block = imported.signals.to_mapping()
    result = {"bag": str(arguments.output), "samples": len(imported.recording), "duration": imported.recording.duration}
    _tell(arguments, imported.recording.notes, result | {"signals": block})
    if not arguments.json and file is None:
        print(dump_yaml({"signals": block}, flow=None), end="")


def _tell(arguments: argparse.Namespace, notes: tuple[str, ...], result: dict[str, Any]) -> None:
    if arguments.json:
        print(json.dumps(result | {"notes": list(notes)}, allow_nan=False))
        return
    for note in notes:
        print(f"tcs-friction: {printable(note)}", file=sys.stderr)
    print(f"{arguments.output}: {result['samples']} samples, {result['duration']:g} s")
