"""What changed in a fleet, when and why: pages about the results that ./tcs fleet has kept, and JSON for machines.

Writes DIR/index.html, a page for each axis beside it, and DIR/fleet.json. Exit status 0: nothing needs a person; 1: something
does; 2: bad input.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tcs_friction.commands.status_line import status_line
from tcs_friction.config import write_whole
from tcs_friction.errors import InputError
from tcs_friction.report.fleet.pages import fleet_sentence, write_fleet
from tcs_friction.trends.fleet import FleetTrend, fleet_trend
from tcs_friction.trends.read import read_axes
from tcs_friction.trends.result import to_mapping
from tcs_friction.writable import output_directory

NEEDS_PERSON = 1
RESULT = "fleet.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "out", metavar="OUT", help="folder or URL of the results of ./tcs fleet PATHS... -o OUT"
    )
    parser.add_argument(
        "-o", "--output", type=output_directory, metavar="DIR", help="where pages go (default: OUT/report)"
    )
    parser.add_argument(
        "--since", type=day_of, metavar="YYYY-MM-DD", help="steps before that day call nobody"
    )
    parser.add_argument("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> int:
    """Read, compare, write the pages, say who is needed; returns the exit status."""
    filesystem, path = storage(arguments.out)
    directory = arguments.output
    if directory is None:
        if filesystem is not None:
            raise InputError(
                "fleet report", f"no folder for the pages about {arguments.out}", "-o DIR beside a URL"
            )
        directory = Path(arguments.out) / "report"
    with status_line() as show:
        axes = []
        for axis in read_axes(path, filesystem):
            show(f"reading  {axis.axis}")
            axes.append(axis)
        if not axes:
            raise InputError(arguments.out, "holds no recordings of any axis", "the results of ./tcs fleet")
        if all(axis.unreadable for axis in axes):
            raise InputError(arguments.out, f"no axis of it can be read: {axes[0].unreadable}", "the results of ./tcs fleet")
        show("comparing")
        fleet = fleet_trend(axes, arguments.since)
        show("writing")
        output_directory(directory)
        content = to_mapping(fleet)
        write_whole(directory / RESULT, json.dumps(content, indent=1, allow_nan=False))
        index = write_fleet(directory, fleet)
    print(json.dumps(content, allow_nan=False) if arguments.json else f"{summary(fleet)}\n{index}")
    return NEEDS_PERSON if fleet.needing else 0


def storage(out: str) -> tuple[Any, str]:
    """pyarrow's file system of a URL and the path in it; None and the path of a local folder."""
    if "://" not in out:
        if not Path(out).is_dir():
            raise InputError(out, "is no folder", "the OUT of ./tcs fleet PATHS... -o OUT")
        return None, out
    if importlib.util.find_spec("fsspec") is None:
        raise InputError(out, "URLs need the package fsspec", "./tcs fleet, which installs it")
    from tcs_friction.fleet.elsewhere import storage_of

    return storage_of(out)


def day_of(word: str) -> float:
    """Days since 1970 of a date."""
    try:
        return datetime.strptime(word, "%Y-%m-%d").replace(tzinfo=UTC).timestamp() / 86400.0
    except ValueError:
        raise InputError("--since", repr(word), "a date such as 2026-03-01") from None


def summary(fleet: FleetTrend) -> str:
    """The axes that need a person, in order, for a terminal."""
    lines = [fleet_sentence(fleet)]
    for place, axis in enumerate(fleet.needing, 1):
        lines += [
            f"{place}. {axis.name}: {axis.reasons[0]}",
            *(f"   {reason}" for reason in axis.reasons[1:]),
        ]
    return "\n".join(lines)
