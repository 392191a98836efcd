"""Calibrate the friction observer against a dynamometer that was recorded beside the axis.

The bags hold joint states and the dynamometer's messages of a run with stretches at constant speed, best both ways; they
are found automatically. Writes DIR/calibration.json, DIR/axis.yaml (the axis file with the calibrated observer), a picture
and DIR/report.html. Where observer and dynamometer agree to less than 90 % even so, or less than before, it is no calibration:
that is said, with exit status 1, and nothing is written.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

from tcs_friction.commands.inputs import add_reading, add_recordings, choice_of
from tcs_friction.commands.notes import tell_notes
from tcs_friction.commands.outputs import results_over_no_input
from tcs_friction.config import AxisFile, default_control, load_axis, save_axis, write_whole
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import writing_into
from tcs_friction.identify.dob_acceptance import accepted
from tcs_friction.identify.dob_calibration import DYNAMOMETER, Calibration, calibrate, comparisons_of
from tcs_friction.physics.axis import Unit
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.signals import SignalMap, SignalSource

WRITTEN = ("calibration.json", "axis.yaml", "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis = "axis file: the observer, and where the signals are"
    add_recordings(parser, "recordings with the dynamometer on the axis", axis)
    add_reading(parser)
    parser.add_argument(
        "--dynamometer",
        metavar="TOPIC",
        help="its topic (default: exogenous signal dynamometer of the axis file, else dynamometer beside the position's topic)",
    )
    parser.add_argument(
        "--field", help="in its messages (default: wrench.torque.z, wrench.force.x for a linear axis)"
    )
    parser.add_argument("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> None:
    """Read, calibrate, write, say what came out."""
    results_over_no_input(arguments.output, WRITTEN, [*arguments.bags, arguments.axis])
    file = load_axis(arguments.axis)
    kind, mapped = file.axis.kind, file.mapped(arguments.axis)
    signals = with_dynamometer(mapped, kind, arguments.dynamometer, arguments.field)
    recordings = read_recordings(arguments.bags, signals, choice_of(arguments), kind)
    control = file.control or default_control(file.axis)
    comparisons = [item for recording in recordings for item in comparisons_of(recording)]
    found = accepted(calibrate(comparisons, control.observer))
    text = json.dumps(found.to_mapping(), indent=2, allow_nan=False) + "\n"
    calibrated = replace(file, control=replace(control, observer=found.observer))
    _write(arguments.output, text, calibrated)
    _report(arguments.output, found, control.observer, file.axis.unit, [recording.source for recording in recordings])
    tell_notes(recordings)
    print(
        json.dumps(found.to_mapping(), allow_nan=False)
        if arguments.json
        else summary(found, file.axis.unit, arguments.output)
    )


def with_dynamometer(signals: SignalMap, kind: str, topic: str | None, field: str | None) -> SignalMap:
    """The signals with the dynamometer among the exogenous ones."""
    if topic is None and field is None and DYNAMOMETER in signals.exogenous:
        return signals
    beside = signals.position.topic.rpartition("/")[0] + "/" + DYNAMOMETER
    usual = "wrench.torque.z" if kind == "rotary" else "wrench.force.x"
    source = SignalSource(topic or beside, field or usual)
    return replace(signals, exogenous={**signals.exogenous, DYNAMOMETER: source})


def _write(directory: Path, text: str, file: AxisFile) -> None:
    with writing_into(directory):
        write_whole(directory / "calibration.json", text)
        save_axis(directory / "axis.yaml", file, "Observer calibrated against a dynamometer by tcs-friction.")


def _report(
    directory: Path, found: Calibration, before: ObserverSettings, unit_of: Unit, sources: list[str]
) -> None:
    from tcs_friction.report.calibration import write_report

    write_report(directory, found, before, unit_of, sources)


def summary(found: Calibration, unit_of: Unit, directory: Path) -> str:
    """What a terminal shows."""
    settings = found.observer

    def shown(value: float, std: float) -> str:
        return f"{value:.6g} ± {std:.2g}" if std == std else f"{value:.6g} (kept)"

    lines = [
        f"torque scale       {shown(settings.torque_scale, found.scale_std)}",
        f"torque offset      {shown(settings.torque_offset, found.offset_std)} {unit_of('N m')}",
        f"nominal inertia    {shown(settings.plant.first, found.inertia_std)} {unit_of('kg m^2')}",
        f"dynamometer late   {1e3 * found.dynamometer_delay:.1f} ms",
        f"accuracy           {100 * found.accuracy_uniform:.2f} % in uniform motion, "
        f"{100 * found.accuracy:.2f} % over everything; before {100 * found.accuracy_before:.2f} %",
        *found.notes,
        str(directory / "report.html"),
    ]
    return "\n".join(lines)
