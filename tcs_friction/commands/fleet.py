"""Identify and diagnose many recordings of many axes on Dask; the results are a Parquet data set that grows with each run.

PATH: folders, bags, tables, patterns, or URLs that fsspec knows (s3://, http://, ...). What is done already is not done
again, also after an interruption. AXES.yaml is a list of {axis: PATH_OF_AXIS_FILE}; docs/fleet.md says what else it may hold.

tcs-friction fleet report OUT: what changed, when and why.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcs_friction.commands.inputs import add_reading, choice_of
from tcs_friction.commands.parser import positive
from tcs_friction.commands.status_line import status_line
from tcs_friction.diagnose.parallel import cores
from tcs_friction.errors import InputError, JobError, one_line
from tcs_friction.writable import output_place

if TYPE_CHECKING:
    from tcs_friction.fleet.engine import Summary
    from tcs_friction.fleet.sources import Found
    from tcs_friction.recording.choice import Choice
    from tcs_friction.recording.signals import SignalMap

SUBCOMMANDS = {"report": "fleet_report"}
"""First words that are commands of their own."""

BAR = 30  # characters
MOST_TOLD = 5
"""Failed recordings that are named."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("paths", nargs="+", metavar="PATH", help="where recordings are")
    parser.add_argument("--axes", required=True, type=Path, metavar="AXES.yaml", help="the axes that there are")
    parser.add_argument("-o", "--output", type=output_place, required=True, metavar="OUT", help="folder or URL of the results")
    add_reading(parser)
    parser.add_argument("--workers", type=positive, metavar="N", help="processes on this machine (default: its cores)")
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler that is there already, in their place")
    parser.add_argument("--retry", action="store_true", help="do again what failed before")
    parser.add_argument("--no-diagnose", action="store_true", help="identify only: much faster, says nothing of missing physics")
    parser.add_argument(
        "--samples", type=positive, default=600_000, metavar="N", help="longer recordings are cut (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print what was done on stdout as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Find, work, say what was done."""
    if arguments.workers and arguments.scheduler:
        raise InputError("--workers", "given with --scheduler", "one of the two")
    for name in ("distributed", "fsspec"):
        if importlib.util.find_spec(name) is None:
            how = "./tcs fleet, which installs it, or pip install 'tcs_friction[fleet]'"
            raise JobError("fleet", f"needs the package {name}", how)
    from tcs_friction.fleet.axes import read_axes
    from tcs_friction.fleet.plan import Plan
    from tcs_friction.fleet.sources import find
    from tcs_friction.fleet.store import Store

    choice = choice_of(arguments)
    axes = read_axes(arguments.axes)
    if choice.joint and len(axes) > 1:
        raise InputError("--joint", f"{len(axes)} axes in {arguments.axes}", "joint in the entry of each")
    found = find(arguments.paths, arguments.output)
    signals = _signals(found[0], axes[0].signals, choice) if choice.joint else None
    axes = tuple(axis.told(choice, signals) for axis in axes)
    plan = Plan(axes, str(arguments.axes), arguments.retry, not arguments.no_diagnose, arguments.samples)
    store = Store(arguments.output)
    with store.alone():
        summary = _run(arguments, found, plan, store)
    for note in store.notes:
        print(f"tcs-friction: {one_line(note)}", file=sys.stderr)
    content = {
        "recordings": summary.recordings, "pieces": summary.before + summary.now, "done_before": summary.before,
        "done_now": summary.now, "failed": summary.failed, "seconds": summary.seconds, "output": arguments.output,
    }  # fmt: skip
    print(json.dumps(content) if arguments.json else _told(summary, arguments.output))
    if summary.failed == summary.before + summary.now:
        raise JobError(arguments.output, f"none of {summary.failed} recordings could be worked on", summary.reasons[0])


def _signals(first: Found, signals: SignalMap, choice: Choice) -> SignalMap:
    """The signals of the joint that is meant; a number is that of the first recording, whose name holds for all."""
    from tcs_friction.fleet.opening import at_hand
    from tcs_friction.recording.bags import chosen_signals, joints_in
    from tcs_friction.recording.choice import joint_number, no_joint

    number = joint_number(choice.joint)
    if number is None:
        return signals.of_joint(choice.joint)
    with at_hand(first) as path:
        if not first.table:
            return chosen_signals([path], signals, choice)
        names = joints_in(path, signals, choice)
    if number >= len(names):
        raise no_joint(choice.joint, f"0 to {len(names) - 1} or a name")
    return signals.of_joint(names[number])


def _run(arguments: argparse.Namespace, found: Any, plan: Any, store: Any) -> Summary:
    from tcs_friction.fleet import engine
    from tcs_friction.fleet.cluster import workers_here, workers_of

    cluster: AbstractContextManager[Any]
    cluster = workers_of(arguments.scheduler) if arguments.scheduler else workers_here(arguments.workers or cores())
    with cluster as client, status_line() as show:
        print(f"tcs-friction: dashboard {client.dashboard_link}", file=sys.stderr, flush=True)

        def progress(stage: str, done: int, total: int, failed: int) -> None:
            filled = BAR * done // max(1, total)
            lost = f", {failed} failed" if failed else ""
            show(f"{stage} [{'#' * filled}{'.' * (BAR - filled)}] {done} of {total}{lost}")

        return engine.run(client, found, plan, store, progress)


def _told(summary: Summary, output: str) -> str:
    """What was done, for a terminal."""
    pieces = summary.before + summary.now
    cut = f" in {pieces} pieces" if pieces != summary.recordings else ""
    lines = [f"{summary.recordings} recordings{cut}: {summary.now} done now, {summary.before} before, {summary.failed} failed"]
    lines += [f"  {one_line(reason)}" for reason in summary.reasons[:MOST_TOLD]]
    if (more := len(summary.reasons) - MOST_TOLD) > 0:
        lines.append(f"  and {more} more")
    lines.append(output)
    return "\n".join(lines)
