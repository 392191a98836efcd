"""Simulate an axis, its effects and its controller, and write what a recorder would have recorded.

With --plant mujoco the motion is that of a joint of a MuJoCo model; the axis file says how it is controlled and measured.

The control block of the axis file says how it is controlled (without one: a cautious controller for its
inertia), its signals block where in the bag the signals go.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcs_friction.commands.inputs import MUJOCO, add_plant, check_plant
from tcs_friction.config import AxisFile, Control, default_control, load_axis, shipped
from tcs_friction.control.loop import (
    Cancellation,
    LoopConfig,
    LoopRun,
    PlantMaker,
    Wanted,
    simulate_loop,
    ticks,
)
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.control.reference import load_reference
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.recording.bags import NOTHING_CHOSEN, read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, graph_signals
from tcs_friction.recording.write import write_recording
from tcs_friction.writable import new_output

Array = NDArray[np.float64]

ROOM_TEMPERATURE = 20.0  # degC


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "axis", type=Path, metavar="AXIS.yaml", help="the axis: what it is, how it is controlled"
    )
    parser.add_argument(
        "--reference", type=Path, required=True, metavar="REF.yaml", help="where it should be when"
    )
    parser.add_argument("-o", "--output", type=new_output, required=True, metavar="BAG", help="bag to write")
    parser.add_argument(
        "--cancel", type=Path, metavar="AXIS.yaml", help="whose effects `compensation: model` cancels (default: all)"
    )
    add_plant(parser)
    parser.add_argument("--seed", type=int, default=0, help="of torque and encoder noise (default 0)")
    parser.add_argument(
        "--surroundings",
        type=Path,
        metavar="BAG",
        help="recording that temperature and exogenous signals are taken from (default: 20 degC and zero)",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Simulate, write the bag, say what came out."""
    check_plant(arguments)
    file = load_axis(arguments.axis)
    reference = load_reference(arguments.reference)
    if arguments.seed < 0:
        raise InputError("--seed", str(arguments.seed), "a whole number from 0")
    control = file.control or default_control(file.axis)
    signals = file.signals or default_signals(file.axis.name)
    temperature, exogenous, notes = surroundings(
        file, reference, control.loop, read_surroundings(file, arguments.surroundings)
    )
    if arguments.plant == MUJOCO:
        notes = [f"{arguments.axis}: its effects are not simulated, the model is"] if file.axis.effects else []
    else:
        notes = [*file.axis.warnings(), *notes]
    loop = simulate_loop(
        file.axis,
        reference,
        control.controller,
        control.loop,
        control.observer,
        control.compensator,
        arguments.seed,
        temperature,
        {name: exogenous[name] for name in signals_of(file.axis)},
        Cancellation(load_axis(arguments.cancel).axis if arguments.cancel else file.axis),
        plant_of(arguments.model, arguments.joint, notes) if arguments.plant == MUJOCO else None,
    )
    recording = recorded(loop, temperature, exogenous)
    write_recording(arguments.output, recording, signals)
    _tell(arguments, loop, control, signals, notes)


def plant_of(model: str, joint: str, notes: list[str]) -> PlantMaker:
    """A joint of a MuJoCo model, "" for the one that has the axis' name; `notes` gets what was changed in the model."""
    path = Path(model)
    if not path.is_file():
        with contextlib.suppress(InputError):
            path = shipped(model)

    def make(axis: Axis, period: float, seed: int, position: float) -> MujocoSimulator:
        simulator = MujocoSimulator(axis, path, joint or axis.name, period, seed, position)
        notes.extend(simulator.notes)
        return simulator

    return make


def default_signals(axis: str) -> SignalMap:
    """Where the node graph would have put the signals."""
    return graph_signals(f"/{axis}", axis)


def read_surroundings(file: AxisFile, bag: Path | None, choice: Choice = NOTHING_CHOSEN) -> Recording | None:
    """The recording that --surroundings names. Raises InputError where the axis file does not say where the signals are."""
    if bag is None:
        return None
    if file.signals is None:
        raise InputError("--surroundings", "no signals block in the axis file", "where the signals are")
    (source,) = read_recordings([bag], file.signals, choice, file.axis.kind)
    return source


def surroundings(
    file: AxisFile, reference: Wanted, loop: LoopConfig, source: Recording | None
) -> tuple[Array, dict[str, Array], list[str]]:
    """Temperature (n,), each exogenous signal (n,) that axis or bag needs, and notes on what was assumed."""
    times = ticks(reference, loop)
    names = dict.fromkeys([*signals_of(file.axis), *(file.signals.exogenous if file.signals else ())])
    found: dict[str, Array] = {}
    temperature = np.full(len(times), ROOM_TEMPERATURE)
    if source is not None:
        found = {name: np.interp(times, source.t, values) for name, values in source.exogenous.items()}
        if source.temperature is not None:
            temperature = np.interp(times, source.t, source.temperature)
    notes = [
        f"effect signal {name} is taken as 0 (--surroundings BAG gives it)"
        for name in signals_of(file.axis)
        if name not in found
    ]
    unknown = source is None or source.temperature is None
    if unknown and any(item.term.temperature for item in file.axis.effects):
        notes.append(f"temperature is taken as {ROOM_TEMPERATURE:g} degC (--surroundings BAG gives it)")
    return temperature, {name: found.get(name, np.zeros(len(times))) for name in names}, notes


def recorded(loop: LoopRun, temperature: Array, exogenous: Mapping[str, Array]) -> Recording:
    """What a recorder beside the axis would have: measured motion, torque, reference, surroundings."""
    return Recording(
        t=loop.t,
        position=loop.position,
        torque=loop.torque,
        velocity=loop.velocity,
        temperature=temperature,
        reference=loop.reference,
        exogenous=exogenous,
        source="simulation",
    )


def _tell(
    arguments: argparse.Namespace, loop: LoopRun, control: Control, signals: SignalMap, notes: list[str]
) -> None:
    rms = float(np.sqrt(np.mean(loop.error**2)))
    if arguments.json:
        result: dict[str, Any] = {
            "bag": str(arguments.output),
            "samples": len(loop.t),
            "duration": float(loop.t[-1]),
            "period": control.loop.period,
            "tracking_rms": rms,
            "signals": signals.to_mapping(),
            "notes": notes,
        }
        print(json.dumps(result))
        return
    for line in notes:
        print(f"tcs-friction: {line}", file=sys.stderr)
    topics = ", ".join(signals.topics)
    print(
        f"{arguments.output}: {loop.t[-1]:g} s, {len(loop.t)} samples, tracking error {rms:.3g} rms; {topics}"
    )
