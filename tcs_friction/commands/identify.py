"""Identify inertia, friction and offset of an axis from bags.

Writes DIR/identification.json, DIR/axis.yaml (the axis with the identified friction), pictures and DIR/report.html.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from tcs_friction.commands.inputs import add_reading, add_recordings, choice_of
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.commands.status_line import status_line
from tcs_friction.config import AxisFile, load_axis, save_axis, write_whole
from tcs_friction.errors import InputError, JobError, nearest, writing_into
from tcs_friction.identify.comparison import Comparison, compare_laws
from tcs_friction.identify.conclusions import UNCERTAINTIES
from tcs_friction.identify.identification import METHODS, IdentifyOptions, identified_axis, identify
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.physics.registry import law as law_named
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.yaml_files import load_yaml

ALL = "all"
UNKNOWN_INERTIA = 1.0  # kg m^2, where the axis file has none; the fit is linear in it and needs no guess
WRITTEN = ("identification.json", "axis.yaml", "report.html")
ADJUSTABLE = ("pso-ga", "pso", "ga")
SETTINGS = tuple(field.name for field in fields(SwarmOptions))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    axis = "axis file: what is believed, and where the signals are"
    add_recordings(parser, "recordings, one data set with common physics", axis)
    add_reading(parser)
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


def run(arguments: argparse.Namespace) -> int:
    results_over_no_input(arguments.output, WRITTEN, [*arguments.bags, arguments.axis])
    file = load_axis(arguments.axis, None if arguments.hold_inertia else UNKNOWN_INERTIA)
    signals = file.mapped(arguments.axis)
    options = IdentifyOptions(
        hold_inertia=arguments.hold_inertia,
        offset=not arguments.no_offset,
        loss=arguments.loss,
        bandwidth=arguments.bandwidth,
        swarm=_swarm(arguments.swarm, arguments.method),
        uncertainty=arguments.uncertainty,
        profile=arguments.profile,
    )
    if arguments.law not in (None, ALL):
        law_named(arguments.law, "--law")
    recordings = read_recordings(arguments.bags, signals, choice_of(arguments), file.axis.kind)
    file = file.measured_in(same_torque_unit(recordings))
    comparison = None
    with status_line() as show:

        def progress(generation: Generation) -> None:
            show(f"{100.0 * generation.share:3.0f} %  cost {generation.cost:.6g}")

        if arguments.law == ALL:
            comparison = compare_laws(recordings, file.axis, arguments.seed, progress, options=options)
            found = comparison.best
        else:
            found = identify(
                recordings, file.axis, arguments.method, arguments.law, arguments.seed, progress, options=options
            )
    if not found.inertia.determined and "inertia" not in load_yaml(arguments.axis)["axis"]:
        where = str(arguments.axis)
        raise JobError(where, f"has no inertia, and {arguments.bags[0]} determines none: {found.inertia.reason}", "either")
    _write(arguments.output, file, recordings, found, comparison)
    tell_notes(recordings)
    content = _content(found, comparison)
    print(
        json.dumps(content, allow_nan=False)
        if arguments.json
        else _summary(arguments.output, found, comparison)
    )
    if not any(item.determined for item in found.parameters.values()):
        expected = "a recording with reversals and several speeds"
        raise JobError(str(arguments.bags[0]), f"determines no parameter of {found.law}", expected)
    return 0


def _swarm(words: Sequence[str], method: str) -> SwarmOptions:
    """Settings from NAME=VALUE; InputError for names and values that cannot be, and for methods that have none to choose."""
    if words and method not in ADJUSTABLE:
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


def _content(found: Identification, comparison: Comparison | None) -> dict[str, object]:
    extra = {"laws": comparison.to_mapping()} if comparison else {}
    return {**found.to_mapping(), **extra}


def _write(
    directory: Path,
    file: AxisFile,
    recordings: tuple[Recording, ...],
    found: Identification,
    comparison: Comparison | None,
) -> None:
    """All results; the report last, since it names the others."""
    axis = identified_axis(file.axis, found)
    comment = f"Friction identified by tcs-friction ({found.law}, {found.method}, seed {found.seed})."
    text = json.dumps(_content(found, comparison), indent=2, allow_nan=False) + "\n"
    with writing_into(directory):
        write_whole(directory / "identification.json", text)
        save_axis(directory / "axis.yaml", replace(file, axis=axis), comment)
    try:
        from tcs_friction.report.identification import write_report
    except ModuleNotFoundError:
        return
    write_report(directory, found, recordings, comparison)


def _summary(directory: Path, found: Identification, comparison: Comparison | None) -> str:
    rows = {**found.parameters, "inertia": found.inertia, "offset": found.offset}
    width = max(map(len, rows))
    lines = [f"{found.law} ({found.method}, {found.outcome.value}, {found.seconds:.1f} s)"]
    for name, item in rows.items():
        shown = (
            f"{item.value:12.6g} ± {item.std:.2g} {item.unit}"
            if item.determined
            else f"  undetermined: {item.reason}"
        )
        lines.append(f"  {name:{width}}  {shown}")
    errors = found.rmse
    noise = f"noise at least {found.noise_floor:.4g} {found.offset.unit}"
    lines.append(f"residual {errors.train:.4g} train, {errors.held_out:.4g} held out; {noise}")
    if comparison:
        lines += ["", f"{'law':18} {'held out':>10} {'train':>10} {'parameters':>10}"]
        lines += [
            f"{row.law:18} {row.held_out:10.4g} {row.train:10.4g} {row.parameters:10d}"
            for row in comparison.rows
        ]
    lines.append(str(directory / "identification.json"))
    return "\n".join(lines)
