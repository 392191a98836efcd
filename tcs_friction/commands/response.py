"""Frequency response of an axis from torque to speed, with coherence and uncertainty, and two models fitted to it.

The bags hold an excited run, such as the multisine of config/azimuth_1p2m_response.yaml through the graph. Fitted are the form of
the paper's eq. 10 and two inertias with a spring between them. Where the axis file names the recorded reference, it serves as
instrument: the response then is that of the axis although a controller was at work. Writes DIR/response.json, a picture and
DIR/report.html.
"""

from __future__ import annotations

import argparse
import json

from tcs_friction.commands.inputs import add_reading, add_recordings, choice_of
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.config import load_axis, write_whole
from tcs_friction.errors import JobError, writing_into
from tcs_friction.identify.plant_response import (
    PERIODS,
    SEGMENTS,
    SETTLE,
    PlantModel,
    fit_second_order,
    fit_two_inertias,
    of_recordings,
)
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.report.response import explained, sentence, write_report

WRITTEN = ("response.json", "report.html")
HIGHEST_SHARE = 0.1  # of the sample rate, by default
NO_REFERENCE = (
    "no reference recorded: under a controller the response is biased towards the inverse of the controller"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis = "axis file: known delay, and where the signals are"
    add_recordings(parser, "recordings of an excited run", axis)
    add_reading(parser)
    parser.add_argument(
        "--lowest", type=float, metavar="HZ", help="default: what the length of the recordings allows"
    )
    parser.add_argument("--highest", type=float, metavar="HZ", help="default: a tenth of the sample rate")
    parser.add_argument("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> None:
    """Read, estimate, fit, write, say what came out."""
    results_over_no_input(arguments.output, WRITTEN, [*arguments.bags, arguments.axis])
    file = load_axis(arguments.axis)
    recordings = read_recordings(arguments.bags, file.mapped(arguments.axis), choice_of(arguments), file.axis.kind)
    file = file.measured_in(same_torque_unit(recordings))
    lowest, highest = frequencies(recordings, arguments.lowest, arguments.highest)
    measured = of_recordings(recordings, lowest, highest, file.axis.actuation_delay)
    models = (fit_second_order(measured), fit_two_inertias(measured))
    notes = [] if all(item.reference is not None for item in recordings) else [NO_REFERENCE]
    content = {
        "schema": "tcs_friction/response/1",
        "response": measured.to_mapping(),
        "models": {model.form: model.to_mapping() for model in models},
        "notes": notes,
    }
    text = json.dumps(content, allow_nan=False)
    with writing_into(arguments.output):
        write_whole(arguments.output / "response.json", text + "\n")
    sources = [recording.source for recording in recordings]
    path = write_report(arguments.output, measured, models, file.axis.unit, sources, notes)
    shown = [sentence(models, file.axis.unit), *map(_line, models), *notes, str(path)]
    print(text if arguments.json else "\n".join(shown))
    if not explained(models):
        found = f"neither model fits, misfit {100 * min(model.misfit for model in models):.0f} %"
        raise JobError(sources[0], found, "a run that excites the axis and does not reverse it")
    tell_notes(recordings)


def frequencies(
    recordings: tuple[Recording, ...], lowest: float | None, highest: float | None
) -> tuple[float, float]:
    """The range asked for, or the one that the recordings allow, Hz."""
    longest = max(float(item.t[part][-1] - item.t[part][0]) for item in recordings for part in item.segments)
    rate = (len(recordings[0]) - 1) / recordings[0].duration
    allowed = PERIODS * (SEGMENTS + 1) / 2.0 / max(longest - SETTLE - 0.1, 0.1)
    return lowest or allowed, highest or HIGHEST_SHARE * rate


def _line(model: PlantModel) -> str:
    values = ", ".join(
        f"{name} {value:.4g} ± {model.std[name]:.2g}" for name, value in model.parameters.items()
    )
    return f"{model.form}: {values}; misfit {100 * model.misfit:.1f} %"
