"""A run as a recording has it: its reference, the error with which it was followed, and the controller that it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tcs_friction.config import AxisFile
from tcs_friction.control.loop import Wanted
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.recorded_reference import RecordedReference, rest_of
from tcs_friction.control.reference import load_reference
from tcs_friction.control.shown_controller import Run, Shown, filtered_speed, shown_by
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import NOTHING_CHOSEN, SUFFIXES, agreeing, read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.table_files import is_table
from tcs_friction.recording.tables import import_table

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """The longest stretch of a recording without a gap; its time begins at 0.

    reference: None where none was recorded. notes: what was left out.
    """

    recording: Recording
    reference: RecordedReference | None
    notes: tuple[str, ...] = ()

    @property
    def error(self) -> Array:
        """(n,) recorded reference less measured position, rad (m)."""
        assert self.recording.reference is not None
        return self.recording.reference - self.recording.position

    def rms(self, settle: float) -> float:
        """Of the error, after so many seconds. Raises InputError for a recording that is over by then."""
        counted = self.error[self.recording.t >= settle]
        if not len(counted):
            raise InputError(self.recording.source, f"{self.recording.duration:g} s without a gap", f"more than {settle:g} s")
        return float(np.sqrt(np.mean(counted**2)))

    def controller(self, file: AxisFile, controller: PidConfig, added: tuple[Array, Array] | None) -> Shown:
        """What the recording shows of its controller. added: times, s, and torque that was added to its own, N m.

        Raises InputError for a torque in another unit than the axis file's.
        """
        assert self.reference is not None
        if self.recording.torque_unit != file.axis.torque_unit:
            found = f"holds the torque in {self.recording.torque_unit or file.axis.unit('N m')}"
            raise InputError(self.recording.source, found, f"{file.axis.unit('N m')}, as the axis file")
        recording, bandwidth = self.recording, file.axis.sensors.velocity_bandwidth
        velocity = recording.velocity
        if velocity is None:
            velocity = filtered_speed(recording.t, recording.position, bandwidth)
        torque = recording.torque - (np.interp(recording.t, *added) if added is not None else 0.0)
        run = Run(recording.t, self.reference.over(recording.t), self.error, velocity, torque)
        return shown_by(run, controller, file.axis.drive)


def read_run(
    path: Path, file: AxisFile, axis: Path, controller: PidConfig, choice: Choice = NOTHING_CHOSEN
) -> RecordedRun:
    """A bag or a table. Raises InputError for one that is none, and for a bag of an axis file (`axis`) without signals block."""
    if is_table(path) and file.signals is None:
        imported = import_table(path, choice.joint or file.axis.name, choice.columns, None, file.axis.kind)
        (source,) = agreeing([imported.recording], choice)
    else:
        (source,) = read_recordings([path], file.mapped(axis), choice, file.axis.kind)
    longest = max(source.segments, key=lambda part: part.stop - part.start)
    part = source.part(longest)
    part = replace(part, t=part.t - part.t[0], notes=())
    notes = list(source.notes)
    if len(source.segments) > 1:
        notes.append(f"its longest stretch without a gap, {part.duration:.4g} s of {source.duration:.4g}, is taken")
    if part.reference is None:
        return RecordedRun(part, None, tuple(notes))
    rest = rest_of(controller.position_proportional)
    return RecordedRun(part, RecordedReference(part.t, part.reference, rest, part.source), tuple(notes))


def read_reference(
    path: Path, file: AxisFile, axis: Path, controller: PidConfig, choice: Choice = NOTHING_CHOSEN
) -> tuple[Wanted, tuple[str, ...]]:
    """A reference from a YAML file, or the one that a bag or table has, and notes.

    Raises InputError for a recording without one.
    """
    if not (path.is_dir() or is_table(path) or {suffix.lower() for suffix in path.suffixes} & {*SUFFIXES}):
        return load_reference(path), ()
    run = read_run(path, file, axis, controller, choice)
    if run.reference is None:
        raise no_reference(path, file, axis)
    return run.reference, tuple(f"{path}: {note}" for note in run.notes)


def no_reference(path: Path, file: AxisFile, axis: Path) -> InputError:
    """What to say of a recording without a reference."""
    if is_table(path):
        return InputError(str(path), "no reference", "a column of that name")
    if file.signals is not None and file.signals.reference is None:
        return InputError(f"{axis}: signals", "no reference", f"where {path} has it: reference: {{topic: ..., field: ...}}")
    return InputError(str(path), "no reference", "some samples of it")
