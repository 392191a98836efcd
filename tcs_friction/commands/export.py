"""Bring an axis to where you work: your simulator's model, your drive's table, your firmware.

--to c writes NAME.h, NAME.c, NAME_test.c, NAME.hpp and NAME_controller.cpp for -o NAME.c. mjcf, urdf and sdf change the joint of
your own model (--into) and nothing else of it. table has --kind friction, torque, beckhoff, odrive, cia402 or linuxcnc; fmu has
fmi3 or fmi2. What was in the model before, how well what was approximated, and what the format cannot say, is told line by line.
"""

from __future__ import annotations

import argparse
import difflib
import json
import math
import re
from pathlib import Path

from tcs_friction.commands.outputs import never_over_an_input
from tcs_friction.commands.parser import name_word
from tcs_friction.config import AxisFile, load_axis, write_bytes
from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.errors import printable
from tcs_friction.export.formats import FORMATS, format_named
from tcs_friction.export.request import Exported, Request
from tcs_friction.writable import output_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("axis", type=Path, metavar="AXIS.yaml", help="what was found: the axis file of identify or diagnose")
    add("--to", required=True, metavar="FORMAT", help="; ".join(f"{one.name}: {one.makes}" for one in FORMATS.values()))
    add("-o", "--output", required=True, type=output_file, metavar="FILE", help="where it goes")
    add("--into", type=Path, metavar="MODEL", help="your own model, whose joint becomes the axis (mjcf, urdf, sdf)")
    add("--joint", type=name_word, default="", metavar="NAME", help="default: the one recorded, else the axis' name")
    add("--kind", default="", help="which table or FMU (default: the first)")
    add("--speed", type=above_zero, default=1.0, metavar="V", help="friction is fitted up to it (default: 1 rad/s or m/s)")
    add("--travel", type=span, metavar="FROM:TO", help="torque is fitted in between (default: a turn, or 1 m)")
    add("--temperatures", type=numbers, default=(20.0,), metavar="T,T,...", help="degC, of a table of friction (default: 20)")
    add("--period", type=above_zero, metavar="S", help="control period of code and tables (default: the axis file's)")
    add("--share", type=share, default=1.0, help="part of the torque that is compensated (default: 1)")
    add("--rest-speed", type=number, default=0.0, metavar="V", help="rest band: below this speed less friction is compensated")
    add("--rest-torque", type=number, default=0.0, metavar="M", help="most friction compensated at rest")
    add("--dry-run", action="store_true", help="write nothing; show the difference")
    add("--json", action="store_true", help="print what is said as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Read, export, write, say."""
    file = load_axis(arguments.axis)
    chosen = format_named(arguments.to)
    exported = chosen.export(_request(arguments, file))
    never_over_an_input(exported.files, [arguments.axis, arguments.into])
    if arguments.dry_run:
        print("".join(_difference(arguments.into, exported)), end="")
    else:
        for path, content in exported.files.items():
            write_bytes(path, content.encode() if isinstance(content, str) else content)
    names = [str(path) for path in exported.files]
    if arguments.json:
        print(json.dumps({"format": chosen.name, "files": names, "notes": exported.lines}))
        return
    print("\n".join(printable(line) for line in ([] if arguments.dry_run else names) + [f"  {line}" for line in exported.lines]))


def _request(arguments: argparse.Namespace, file: AxisFile) -> Request:
    axis = file.axis
    recorded = file.signals.position.joint if file.signals is not None else None
    period = arguments.period or (file.control.loop.period if file.control else Request.period)
    limit = min(axis.drive.limit, 1e12)
    config = CancellationConfig(
        total_limit=limit, share=arguments.share, rest_speed=arguments.rest_speed, rest_torque=arguments.rest_torque
    )
    config.validate("--share, --rest-speed, --rest-torque")
    whole = (-math.pi, math.pi) if axis.kind == "rotary" else (-0.5, 0.5)
    return Request(
        axis, arguments.axis, arguments.output, arguments.into, arguments.joint or recorded or axis.name, period, arguments.speed,
        arguments.travel or whole, arguments.temperatures, arguments.kind, config,
    )  # fmt: skip


def _difference(into: Path | None, exported: Exported) -> list[str]:
    """Of every file against the model that it comes from, or the file that it would replace."""
    lines: list[str] = []
    for path, content in exported.files.items():
        if isinstance(content, bytes):
            lines.append(f"{path}: {len(content)} bytes\n")
            continue
        old = into or path
        before = old.read_text(encoding="utf-8", errors="replace") if old.is_file() else ""
        lines += difflib.unified_diff(before.splitlines(True), content.splitlines(True), str(old), str(path))
    return lines


def number(word: str) -> float:
    """A number of 0 or more, as the `type` of an argument."""
    value = float(word) if re.fullmatch(r"[\d.]+(e[-+]?\d+)?", word.lower()) else math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"{word!r} is no number from 0 on")
    return value


def above_zero(word: str) -> float:
    """A number above 0, as the `type` of an argument."""
    if not number(word) > 0.0:
        raise argparse.ArgumentTypeError(f"{word!r} is no number above 0")
    return float(word)


def share(word: str) -> float:
    """A number from 0 to 1."""
    if not number(word) <= 1.0:
        raise argparse.ArgumentTypeError(f"{word!r} is no number from 0 to 1")
    return float(word)


def numbers(word: str) -> tuple[float, ...]:
    """Numbers with commas between them."""
    try:
        values = tuple(float(part) for part in word.split(","))
    except ValueError:
        values = (math.nan,)
    if not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"{word!r} is no list of numbers")
    return values


def span(word: str) -> tuple[float, float]:
    """Two numbers with a colon between them, the lower first."""
    ends = numbers(word.replace(":", ",")) if word.count(":") == 1 else ()
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise argparse.ArgumentTypeError(f"{word!r} is no range FROM:TO")
    return ends[0], ends[1]
