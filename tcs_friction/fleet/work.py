"""The work on one piece of a recording: read it, identify it, diagnose it, and say it all in a row."""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import os
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.parallel import alone
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.fleet.axes import FleetAxis
from tcs_friction.fleet.opening import at_hand, opened, reason_of
from tcs_friction.fleet.rows import DONE, FAILED, NO_AXIS, Row, month_of
from tcs_friction.fleet.sources import Found
from tcs_friction.identify.identification import identify
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.recording.mending import refuse_mended
from tcs_friction.recording.pieces import Span, read_piece
from tcs_friction.recording.recording import Column, Recording

STEP = 0.05  # s, over which positions are averaged, so that noise is no travel
STILL = 0.05  # of the rms speed: slower is no motion one way or the other


@dataclass(frozen=True)
class Task:
    """A piece to work on. span: None for all of the recording. start: of the recording, ns since 1970, for a row that fails."""

    found: Found
    axis: FleetAxis
    input_hash: str
    version: str
    piece: int = 0
    span: Span | None = None
    start: int = 0
    diagnosed: bool = True


@dataclass(frozen=True)
class Result:
    """A row, and what it took: s, s of the processor, the process and its memory after it, bytes. That is not kept in the row."""

    row: Row
    seconds: float
    busy: float
    process: int
    memory: int


def work(task: Task) -> Result:
    """Everything that is done for one row; whatever goes wrong becomes its reason."""
    began, busy = time.perf_counter(), time.thread_time()
    with alone():
        row = _row(task)
    _give_back_memory()
    return Result(row, time.perf_counter() - began, time.thread_time() - busy, os.getpid(), _memory())


def failed(task: Task, reason: str) -> Row:
    """The row of a piece that could not be worked on."""
    row = unassigned(task.found.name, task.input_hash, task.version, reason)
    return replace(row, axis=task.axis.name, month=month_of(task.start), start=task.start, piece=task.piece)


def unassigned(recording: str, input_hash: str, version: str, reason: str) -> Row:
    """The row of a recording that belongs to no axis."""
    return Row(NO_AXIS, month_of(0), recording, 0, 0, 0.0, input_hash, version, FAILED, reason)


def _row(task: Task) -> Row:
    try:
        recording = _read(task)
        file = task.axis.file.measured_in(recording.torque_unit)
        found = identify([recording], file.axis)
    except Exception as error:  # a bag that fails is a row with its reason, whatever it did
        return failed(task, reason_of(error, task.found))
    row = _identified(task, recording, found)
    if not task.diagnosed:
        return row
    try:
        return _diagnosed(row, diagnose([recording], file))
    except Exception as error:
        return replace(row, reason=f"no diagnosis: {reason_of(error, task.found)}")


def _read(task: Task) -> Recording:
    found, axis = task.found, task.axis
    if found.table:
        with at_hand(found) as path:
            recording = axis.table(path)
        recording = recording if task.span is None else _part(recording, task.span)
    else:
        with opened(found, by_index=task.span is not None and task.span.start > 0) as bag:
            recording = read_piece(bag, axis.signals, task.span)
    if axis.strict:
        refuse_mended([recording])
    return recording


def _part(recording: Recording, span: Span) -> Recording:
    part = recording.part(slice(span.start, span.stop))
    return replace(part, start=part.start + round(1e9 * float(part.t[0])) if part.start else 0)


def _identified(task: Task, recording: Recording, found: Identification) -> Row:
    names, values, covariance = _parameters(found)
    start = recording.start
    return Row(
        axis=task.axis.name,
        month=month_of(start),
        recording=task.found.name,
        piece=task.piece,
        start=start,
        duration=recording.duration,
        input_hash=task.input_hash,
        version=task.version,
        status=DONE,
        law=found.law,
        parameter_names=names,
        parameter_values=tuple(item.value if item.determined else math.nan for item in values),
        parameter_stds=tuple(item.std if item.determined else math.nan for item in values),
        parameter_determined=tuple(item.determined for item in values),
        parameter_units=tuple(item.unit for item in values),
        parameter_covariance=tuple(float(number) for number in covariance.ravel()),
        noise_floor=found.noise_floor,
        residual_retuned=found.rmse.held_out,
        **_motion(recording),
    )


def _parameters(found: Identification) -> tuple[tuple[str, ...], list[Estimate], np.ndarray]:
    """Names, estimates and covariance (p, p); NaN in the rows and columns of what is not determined."""
    items = {"inertia": found.inertia, "offset": found.offset, **found.parameters}
    names = tuple(items)
    known, matrix = found.correlation
    covariance = np.full((len(names), len(names)), math.nan)
    place = {name: number for number, name in enumerate(known)}
    for i, first in enumerate(names):
        for j, second in enumerate(names):
            if items[first].determined and items[second].determined and first in place and second in place:
                deviations = items[first].std * items[second].std
                covariance[i, j] = float(matrix[place[first], place[second]]) * deviations
    return names, list(items.values()), covariance


def _diagnosed(row: Row, found: Diagnosis) -> Row:
    return replace(
        row,
        verdict=str(found.verdict),
        statement=found.statement,
        effects=json.dumps(found.to_mapping()["effects"]),
        noise_floor=found.noise_floor,
        residual_believed=found.believed.stated,
        residual_retuned=found.retuned.stated,
        residual_improved=found.improved.stated,
    )


def _motion(recording: Recording) -> dict[str, Any]:
    """Temperature and motion, of positions averaged over STEP."""
    moves, speeds = [], []
    for segment in recording.segments:
        size = max(1, int(STEP / max(float(np.median(np.diff(recording.t[segment]))), 1e-9)))
        t, q = _averaged(recording.t[segment], size), _averaged(recording.position[segment], size)
        moves.append(np.diff(q))
        speeds.append(np.diff(q) / np.diff(t))
    move, speed = np.concatenate(moves), np.concatenate(speeds)
    rms = float(np.sqrt(np.mean(speed**2))) if len(speed) else math.nan
    ways = np.sign(speed[np.abs(speed) > STILL * rms])
    temperature = recording.temperature
    return {
        "temperature": math.nan if temperature is None else float(temperature.mean()),
        "temperature_change": math.nan if temperature is None else float(temperature[-1] - temperature[0]),
        "travel": float(np.abs(move).sum()),
        "position_from": float(recording.position.min()),
        "position_to": float(recording.position.max()),
        "speed_rms": rms,
        "speed_max": float(np.abs(speed).max(initial=0.0)),
        "reversals": int(np.count_nonzero(np.diff(ways))),
    }


def _averaged(values: Column, size: int) -> Column:
    """Means of `size` samples each, at least two of them."""
    size = max(1, min(size, len(values) // 2))
    count = len(values) // size
    return np.asarray(values[: count * size].reshape(count, size).mean(axis=1))


def _give_back_memory() -> None:
    """What has been freed goes back to the system, so that a worker's memory does not grow with what it has seen."""
    with contextlib.suppress(OSError, AttributeError):  # other systems do it themselves
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def _memory() -> int:
    """Resident memory of this process, bytes; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 0

