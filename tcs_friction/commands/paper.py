"""Every table and figure of the paper's sections 5.1 to 5.4 on a simulated axis, our number beside theirs.

Writes DIR/report.html, its pictures and DIR/paper.json.
"""

from __future__ import annotations

import argparse
import json

from tcs_friction.commands.status_line import status_line
from tcs_friction.config import load_axis, shipped, write_whole
from tcs_friction.control.reference import load_reference
from tcs_friction.errors import InputError
from tcs_friction.report.paper.document import comparisons, measure, write_report
from tcs_friction.report.paper.stand import Stand
from tcs_friction.writable import output_directory

AXIS = "azimuth_1p2m.yaml"
RUN = "azimuth_1p2m_run.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "-o", "--output", type=output_directory, default="paper", metavar="DIR", help="where to (paper)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all noise and of the searches (default 0)")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Make the experiments and the report."""
    if arguments.seed < 0:
        raise InputError("--seed", str(arguments.seed), "a whole number from 0")
    file, reference = load_axis(shipped(AXIS)), load_reference(shipped(RUN))
    stand = Stand(file, reference, arguments.seed)
    with status_line() as show:
        result = measure(stand, lambda what, part: show(f"{100.0 * part:3.0f} %  {what}"))
        path = write_report(arguments.output, result)
        content = result.to_mapping()
        write_whole(arguments.output / "paper.json", json.dumps(content, indent=2) + "\n")
    if arguments.json:
        print(json.dumps(content))
        return
    for row in comparisons(result):
        theirs = "" if row.paper is None else f"paper {row.paper:.4g} {row.unit}"
        print(f"{row.name:52} {row.value:8.4g} {row.unit:4} {theirs}".rstrip())
    print(path)
