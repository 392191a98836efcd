"""Two bags and no axis file: what the simulation believes is identified from the simulation's own recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tcs_friction.conditioning.checks import plain_balance
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import InputError
from tcs_friction.identify.identification import identified_axis, identify
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import usual_law
from tcs_friction.physics.terms import Feature, instance
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.table_files import is_table
from tcs_friction.recording.tables import import_table

Progress = Callable[[float, str], None]
SIMPLEST = frozenset({Feature.DRY, Feature.VISCOUS})  # what any motion to and fro at several speeds determines
BIAS = 3.0  # standard deviations from which a constant torque is believed


def signals_of(bag: Path) -> SignalMap:
    """Where position and torque are in a bag or table that nobody has described. Raises InputError when they cannot be found."""
    if is_table(bag):
        return import_table(bag, "", {}).signals
    block = bag_info(bag).signals
    for name in ("position", "torque"):
        if name not in block:
            raise InputError(
                str(bag), f"no topic looks like a {name}", "an axis file that names the signals (--axis)"
            )
    return SignalMap.from_mapping(block, str(bag))


def believed_from_simulation(
    simulation: Path,
    real: Sequence[Path],
    file: AxisFile | None = None,
    seed: int = 0,
    progress: Progress = lambda share, stage: None,  # noqa: ARG005 names are the interface
) -> tuple[AxisFile, str]:
    """The axis file that a simulation's recording amounts to, and one line on how well.

    `file`, if there is one, says where the signals are; otherwise both bags are searched for them.
    """
    source = file.signals if file is not None and file.signals is not None else None
    recordings = read_recordings([simulation], source or signals_of(simulation))
    start = file.axis if file is not None else starting_axis(recordings)
    axis, line = believed_from_recordings(str(simulation), recordings, start, seed, progress)
    return AxisFile(axis, source or signals_of(real[0])), line


def believed_from_recordings(
    where: str, recordings: Sequence[Recording], start: Axis, seed: int, progress: Progress
) -> tuple[Axis, str]:
    """The axis that recordings of a simulation `where` amount to, and one line on how well; `start` is a first guess.

    What the simulation has beyond inertia and friction law, gravity say, is found as it is of a real axis, by a diagnosis.
    """
    progress(0.0, "identifying the simulation")
    whole = usual_law(frozenset(Feature))
    found = identify(recordings, start, "default", whole.id, seed)
    bristles = [p.name for p in whole.parameters if p.feature is Feature.PRESLIDING]
    if not any(found.parameters[name].determined for name in bristles):
        found = identify(recordings, start, "default", usual_law(SIMPLEST).id, seed)
    if not any(item.determined for item in found.parameters.values()):
        raise InputError(where, "does not determine any friction law", "a simulation with reversals and speeds")
    axis = identified_axis(start, found)
    if abs(found.offset.value) < BIAS * found.offset.std:
        axis = replace(axis, effects=start.effects)
    known = diagnose(recordings, AxisFile(axis), lambda share, stage: progress(share, f"the simulation: {stage}"))
    axis = known.complete_file.axis
    names = [item.term.id.replace("_", " ") for item in axis.effects]
    line = (
        f"{where} behaves like {axis.friction.term.id}{''.join(f', {name}' for name in names)}, with an inertia of "
        f"{axis.inertia:.4g} {found.inertia.unit} (left over: {known.improved.held_out:.3g} {found.offset.unit} rms)"
    )
    return axis, line


def starting_axis(recordings: Sequence[Recording]) -> Axis:
    """A first guess by a plain balance of torque with acceleration, direction and speed."""
    data = prepare(recordings, held_out=False)
    numbers = plain_balance(data, np.ones(len(data.joined("torque")), bool))
    inertia, coulomb = (abs(x) for x in numbers) if numbers is not None else (0.0, 0.0)
    level = float(np.sqrt(np.mean(data.joined("torque") ** 2)))
    top = float(np.abs(data.joined("velocity")).max())
    hardest = float(np.abs(data.joined("acceleration")).max())
    parts = {Feature.DRY: coulomb or 0.5 * level, Feature.VISCOUS: 0.1 * level / top}
    law = usual_law(SIMPLEST)
    values = {p.name: parts[p.feature] for p in law.parameters if p.feature in parts}
    return Axis("axis", inertia or 0.1 * level / hardest, instance(law, values))
