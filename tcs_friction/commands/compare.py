"""Measured beside simulated, in the simulator's own terms: fit per cent, and what the residual follows.

A MuJoCo model is driven by the recorded torque and along the recorded motion. An FMU with a torque as input is driven by it, one
with a motion as input along it. The bag of a simulation stands beside the recording as it is. Several --with are compared with
one another: a model before and after an export, say.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

from tcs_friction.commands.export import number
from tcs_friction.commands.inputs import add_reading, choice_of
from tcs_friction.config import AxisFile, load_axis
from tcs_friction.diagnose.from_model import is_model
from tcs_friction.errors import InputError, printable
from tcs_friction.export.compare import Compared, against_fmu, against_model, against_recording
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    add = parser.add_argument
    add("real", nargs="+", type=Path, metavar="REAL", help="recordings of the real axis")
    add("--with", dest="simulated", required=True, action="append", type=Path, metavar="SIM", help="a bag, a model or an FMU")
    add("--axis", required=True, type=Path, metavar="AXIS.yaml", help="where the signals are, inertia, drive")
    add("--horizon", type=number, default=1.0, metavar="S", help="a model goes by the torque alone for so long (default: 1 s)")
    add_reading(parser, joint=False)
    add("--joint", default="", metavar="NAME", help="which joint of the model (default: the one with the axis' name)")
    add("--json", action="store_true", help="print the result on stdout")


def run(arguments: argparse.Namespace) -> None:
    """Read, drive, compare, say."""
    file = load_axis(arguments.axis)
    if not arguments.horizon > 0.0:
        raise InputError("--horizon", f"{arguments.horizon:g}", "a number of seconds above 0")
    choice = replace(choice_of(arguments), joint="")
    signals = file.mapped(arguments.axis)
    real = read_recordings(arguments.real, signals, choice, file.axis.kind)
    found = {str(path): _against(path, real, file, arguments) for path in arguments.simulated}
    if arguments.json:
        content = {name: [one.to_mapping() for one in entries] for name, entries in found.items()}
        print(json.dumps({"schema": "tcs_friction/compare/1", "compared": content}))
        return
    for name, entries in found.items():
        print(printable(name))
        print("\n".join(f"  {_line(one)}" for one in entries))


def _against(path: Path, real: tuple[Recording, ...], file: AxisFile, arguments: argparse.Namespace) -> list[Compared]:
    if is_model(path):
        return against_model(real, file, path, arguments.joint, arguments.horizon)
    if path.suffix.lower() == ".fmu":
        return against_fmu(real, file, path)
    if arguments.joint:
        raise InputError("--joint", f"given with the bag {path}", "a model: FILE.xml")
    simulated = read_recordings([path], file.mapped(arguments.axis), kind=file.axis.kind)
    return against_recording(real, simulated, file.axis)


def _line(one: Compared) -> str:
    name, (low, high, means) = max(one.over.items(), key=lambda pair: max(map(abs, pair[1][2])))
    worst = max(range(len(means)), key=lambda k: abs(means[k]))
    step = (high - low) / len(means)
    where = f"most at {name} {low + worst * step:.3g} to {low + (worst + 1) * step:.3g} ({means[worst]:+.3g})"
    white = f"autocorrelation beyond chance at {one.white:.0%} of lags, with the torque {one.driven:.0%}"
    return f"{one.signal:9} {one.fit:7.2f} %  {one.rms:.4g} {one.unit} rms, {where}; {white}; {one.way}"
