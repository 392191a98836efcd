"""Identify inertia, friction and offset of an axis from recordings.

Writes DIR/identification.json, DIR/axis.yaml (the axis with the identified friction), pictures and DIR/report.html.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from tcs_friction.commands.inputs import add_reading, add_recordings, choice_of
from tcs_friction.commands.joints import ALL as ALL_JOINTS
from tcs_friction.commands.joints import Done, for_each, tell
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.status_line import status_line
from tcs_friction.conditioning.checks import check_changes
from tcs_friction.conditioning.motion import prepare
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError, JobError, nearest
from tcs_friction.identify.comparison import Comparison, compare_laws
from tcs_friction.identify.conclusions import UNCERTAINTIES
from tcs_friction.identify.identification import METHODS, IdentifyOptions, identify
from tcs_friction.identify.minimum import NO_MINIMUM
from tcs_friction.identify.net_work import refuse_turned
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.identify.searches import AS_PRINTED, HYBRID, NAMES, Searches, compare_searches
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law as law_named
from tcs_friction.recording.bags import chosen_signals, joints_in, read_recordings
from tcs_friction.recording.freshness import longest_unchanged
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.report.identification_files import AXIS, IDENTIFICATION, content_of, write_identification
from tcs_friction.report.numbers import aligned
from tcs_friction.yaml_files import load_yaml

ALL = "all"
UNKNOWN_INERTIA = 1.0  # kg m^2, where the axis file has none; the fit is linear in it and needs no guess
WRITTEN = (IDENTIFICATION, AXIS, "report.html")
MOST = 0.5  # of a recording, for which its position is the same: longer than it does anything else; decides what is said alone
ADJUSTABLE = ("pso-ga", "pso", "ga")
SETTINGS = tuple(field.name for field in fields(SwarmOptions))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    axis = "axis file: what is believed, and where the signals are"
    add_recordings(parser, "recordings, one data set with common physics", axis)
    add_reading(parser, every=True)
    parser.add_argument(
        "--law", help="friction law to fit instead of the axis file's; all: compare them on held-out data"
    )
    parser.add_argument(
        "--method", choices=METHODS, default="default", help="default: swarm, then Levenberg-Marquardt"
    )
    parser.add_argument(
        "--swarm", action="append", default=[], metavar="NAME=VALUE",
        help=f"a setting of {', '.join(ADJUSTABLE)}, as often as needed: {', '.join(SETTINGS)}",
    )  # fmt: skip
    parser.add_argument(
        "--refine", action="store_true",
        help="finish the search of --method as the default method does: least squares, with intervals",
    )  # fmt: skip
    parser.add_argument(
        "--compare", action="store_true",
        help="run PSO beside PSO-GA with the same seed and as many evaluations, and show both",
    )  # fmt: skip
    parser.add_argument("--hold-inertia", action="store_true", help="keep the axis file's inertia")
    parser.add_argument("--no-offset", action="store_true", help="allow no constant torque")
    parser.add_argument(
        "--loss", choices=("squares", "huber"), default="squares", help="huber: outliers count less"
    )
    parser.add_argument(
        "--bandwidth", type=float, metavar="HZ", help="of the low pass; by default from the position's noise"
    )
    parser.add_argument(
        "--uncertainty", choices=UNCERTAINTIES, default="sandwich",
        help="bootstrap: standard errors from resampled blocks of the residual",
    )  # fmt: skip
    parser.add_argument(
        "--profile",
        action="store_true",
        help="add the profile likelihood of each parameter (takes seconds each)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> None:
    """Identify, write everything, say what was found; of all joints one after the other with --joint all."""
    if arguments.joint != ALL_JOINTS:
        tell(arguments, identified_into(arguments, arguments.output))
        return
    signals = load_axis(arguments.axis, UNKNOWN_INERTIA).mapped(arguments.axis)
    joints = joints_in(arguments.bags[0], signals, choice_of(arguments))
    for_each(arguments, "Identification", arguments.bags, joints, identified_into)


def identified_into(arguments: argparse.Namespace, directory: Path) -> Done:
    """One identification and its files."""
    results_over_no_input(directory, WRITTEN, [*arguments.bags, arguments.axis])
    file = load_axis(arguments.axis, None if arguments.hold_inertia else UNKNOWN_INERTIA)
    options = _options(arguments)
    choice = choice_of(arguments)
    file = file.at(chosen_signals(arguments.bags, file.mapped(arguments.axis), choice))
    recordings = read_recordings(arguments.bags, file.mapped(arguments.axis), replace(choice, settled=True), file.axis.kind)
    file = file.measured_in(same_torque_unit(recordings))
    check_changes(recordings)
    refuse_turned(prepare(recordings, options.bandwidth), file.axis.kind)
    found, comparison, searches = _identified(arguments, recordings, file.axis, options)
    if not found.inertia.determined and "inertia" not in load_yaml(arguments.axis)["axis"]:
        where = str(arguments.axis)
        raise JobError(where, f"has no inertia, and {arguments.bags[0]} determines none: {found.inertia.reason}", "either")
    write_identification(directory, file, found, recordings, comparison, searches)
    tell_notes(recordings)
    text, content = _summary(directory, found, comparison, searches), content_of(found, comparison, searches)
    return Done(text, content, _sentence(found), "report.html", _failure(arguments, found, recordings))


def _options(arguments: argparse.Namespace) -> IdentifyOptions:
    """Raises InputError for what does not go together."""
    if arguments.compare and arguments.law == ALL:
        raise InputError("--compare", "given with --law all", "one law, on which both search")
    if arguments.law not in (None, ALL):
        law_named(arguments.law, "--law")
    return IdentifyOptions(
        hold_inertia=arguments.hold_inertia,
        offset=not arguments.no_offset,
        loss=arguments.loss,
        bandwidth=arguments.bandwidth,
        swarm=_swarm(arguments.swarm, arguments.method, arguments.compare),
        uncertainty=arguments.uncertainty,
        profile=arguments.profile,
        refine=arguments.refine,
    )


def _failure(arguments: argparse.Namespace, found: Identification, recordings: Sequence[Recording]) -> JobError | None:
    """Why what was found and written is no result, None if it is one."""
    if not any(item.determined for item in found.parameters.values()):
        expected = "a recording with reversals and several speeds"
        still, since = max(longest_unchanged(one.t, one.position) for one in recordings)
        if still > MOST * max(one.duration for one in recordings):
            expected = f"a position that changes: it is the same for {still:.4g} s from {since:.4g} s on, at rest or not read"
        return JobError(str(arguments.bags[0]), f"determines no parameter of {found.law}", expected)
    if not found.minimum:
        expected = "--refine, or more generations; what it found is written, without intervals"
        return JobError(f"--method {arguments.method}", NO_MINIMUM, expected)
    return None


def _sentence(found: Identification) -> str:
    values = [f"{name} {_shown(item, found.minimum).strip()}" for name, item in found.every.items()]
    return f"{found.law}: {'; '.join(values)}"


def _identified(
    arguments: argparse.Namespace, recordings: Sequence[Recording], axis: Axis, options: IdentifyOptions
) -> tuple[Identification, Comparison | None, Searches | None]:
    """What was asked for, and the laws or the searches beside each other."""
    seed, law, method = arguments.seed, arguments.law, arguments.method
    with status_line() as show:

        def progress(generation: Generation) -> None:
            show(f"{100.0 * generation.share:3.0f} %  cost {generation.cost:.6g}")

        def of_several(which: str, generation: Generation) -> None:
            show(f"{which}: {100.0 * generation.share:.0f} %  cost {generation.cost:.6g}")

        if law == ALL:
            comparison = compare_laws(recordings, axis, seed, of_several, options=options)
            return comparison.best, comparison, None
        searches = None
        if arguments.compare:
            searches = compare_searches(recordings, axis, law, seed, progress, options, method)
            if method in (HYBRID, AS_PRINTED) and not options.refine:
                return searches.found[HYBRID], None, searches
        return identify(recordings, axis, method, law, seed, progress, options=options), None, searches


def _swarm(words: Sequence[str], method: str, compare: bool) -> SwarmOptions:
    """Settings from NAME=VALUE; InputError for names and values that cannot be, and for methods that have none to choose."""
    if words and method not in ADJUSTABLE and not compare:
        raise InputError(
            "--swarm", f"method {method} has settings of its own", f"--method {' or '.join(ADJUSTABLE)}"
        )
    values: dict[str, Any] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name not in SETTINGS:
            raise InputError("--swarm", repr(name), nearest(name, SETTINGS))
        whole = isinstance(getattr(SwarmOptions, name), int)
        try:
            values[name] = int(text) if whole else float(text)
        except ValueError:
            raise InputError(
                "--swarm", f"{name} is {text!r}", "a whole number" if whole else "a number"
            ) from None
    return SwarmOptions(**values)


def _summary(
    directory: Path, found: Identification, comparison: Comparison | None, searches: Searches | None
) -> str:
    width = max(map(len, found.every))
    lines = [f"{found.law} ({found.method}, {found.outcome.value}, {found.seconds:.1f} s)"]
    lines += [f"  {name:{width}}  {_shown(item, found.minimum)}" for name, item in found.every.items()]
    errors = found.rmse
    noise = f"noise at least {found.noise_floor:.4g} {found.offset.unit}"
    lines.append(f"residual {errors.train:.4g} train, {errors.held_out:.4g} held out; {noise}")
    lines += found.notes
    if comparison:
        lines += ["", f"{'law':18} {'held out':>10} {'train':>10} {'parameters':>10}"]
        lines += [
            f"{row.law:18} {row.held_out:10.4g} {row.train:10.4g} {row.parameters:10d}"
            for row in comparison.rows
        ]
    if searches:
        head = ["with as many evaluations", *(NAMES[method] for method in searches.found), ""]
        lines += ["", *aligned([head, *searches.rows()])]
    lines.append(str(directory / IDENTIFICATION))
    return "\n".join(lines)


def _shown(item: Estimate, minimum: bool) -> str:
    if not item.determined:
        return f"  undetermined: {item.reason}"
    if not minimum:
        return f"{item.value:12.6g} {item.unit}, no interval: {NO_MINIMUM}"
    return f"{item.value:12.6g} ± {item.std:.2g} {item.unit}"
