"""Recordings as tables with units in the column names, out and in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording import clock, units
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import Nanoseconds, TopicColumns
from tcs_friction.recording.mending import mended
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import OPTIONAL, REQUIRED, SignalMap, SignalSource
from tcs_friction.recording.table import Table
from tcs_friction.recording.table_files import read_table, write_csv, write_parquet
from tcs_friction.recording.table_names import NAMES, counts
from tcs_friction.recording.table_roles import Joint, Role, Roles, roles_of
from tcs_friction.recording.table_times import (
    FIRST_DATE,
    LAST_DATE,
    LONGEST,
    pace_of,
    taken_as_si,
    unit_of_date,
    unit_of_times,
)
from tcs_friction.recording.units import Named
from tcs_friction.recording.write import EPOCH
from tcs_friction.writable import scratch_beside

ROTARY = {"position": "rad", "velocity": "rad/s", "torque": "N m", "reference": "rad"}
LINEAR = {"position": "m", "velocity": "m/s", "torque": "N", "reference": "m"}
UNITS = {"rotary": ROTARY, "linear": LINEAR}
EPISODE = "episode_index"
BOOKKEEPING = ("segment", EPISODE, "frame_index", "index", "task_index")
"""Columns that count rows: those of `export_table` and of LeRobot data sets."""

PAUSE = 100.0
"""Periods between two episodes: more than those over which a signal is held (clock.GAP_PERIODS)."""

@dataclass(frozen=True, eq=False)
class Imported:
    """A table as a recording, with the signals block under which a bag will hold it.

    kind: of the axis, None where the units do not tell. told: column and unit of each signal, as the table or the axis file says.
    """

    recording: Recording
    signals: SignalMap
    kind: str | None = None
    told: tuple[Named, ...] = ()


def export_table(recording: Recording, path: Path, kind: str = "rotary", signals: SignalMap | None = None) -> None:
    """Write a recording to .csv or .parquet, by the suffix; the last column counts the segments from 0.

    signals: of the axis file with which the table will be read again, which then applies their scales once more; columns whose
    scale is more than a sign say no unit. None: SI units. Raises InputError for another suffix, JobError if Parquet is not
    installed. Nothing half-written bears the name.
    """
    columns = dict(named_columns(recording, kind, signals))
    writers: dict[str, Callable[[Mapping[str, np.ndarray], Path], None]] = {".csv": write_csv, ".parquet": write_parquet}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise InputError(str(path), f"suffix {path.suffix!r}", ".csv or .parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = scratch_beside(path)
    try:
        writer(columns, scratch)
        scratch.replace(path)
    finally:
        scratch.unlink(missing_ok=True)


def named_columns(recording: Recording, kind: str, signals: SignalMap | None = None) -> Iterator[tuple[str, np.ndarray]]:
    """Column names with units, and columns; exogenous signals have no unit because nobody has told it."""
    units = UNITS[kind] | {"temperature": "degC"} | ({"torque": recording.torque_unit} if recording.torque_unit else {})
    sources = dict(signals.named()) if signals is not None else {}
    yield "time [s]", recording.t
    for name in (*REQUIRED, *OPTIONAL):
        values = getattr(recording, name)
        if values is not None:
            scale = sources[name].scale if name in sources else 1.0
            yield f"{name} [{units[name]}]" if abs(scale) == 1.0 else name, values / scale
    for name, values in recording.exogenous.items():
        yield name, sources[name].recorded(values) if name in sources else values
    segment = np.full(len(recording), -1, dtype=np.int64)
    for number, part in enumerate(recording.segments):
        segment[part] = number
    yield "segment", segment


def import_table(
    path: Path, joint: str, chosen: Mapping[str, str], signals: SignalMap | None = None, kind: str | None = None
) -> Imported:
    """Read a table. `chosen`: signal -> column, or column:unit, for columns whose name says too little or that are several.

    joint: name or number of the one that is meant where a table has several, else what to call it; "" for the axis file's.
    signals: of an axis file, whose scales, and units where no column tells them, are applied. Columns that are no signal become
    exogenous signals. kind: of the axis, `rotary` or `linear`, None where only the units tell. Bad rows are handled as those of
    a bag are. Raises InputError naming what is missing, ambiguous or in a wrong unit.
    """
    where = str(path)
    table = read_table(path)
    notes = list(table.notes)
    asked = joint or (signals.position.joint or "" if signals is not None else "")
    roles = roles_of(table, chosen, Joint(asked, bool(joint)), where, notes)
    sources, units_told = _sources(roles, signals, kind, where, notes)
    values = {name: sources[name].si(table.columns[role.column]) for name, role in roles.columns.items() if name != "time"}
    times, start = _times(table, roles.columns["time"], values, where, notes)
    roles.left_out.update(table.starts)  # further dates
    others = _others(table.columns, roles, where)
    torque_unit = _torque_unit(sources["torque"], signals, where, notes)
    if signals is None:
        signals = default_signals(roles.joint or joint or "axis", ("time", *values), tuple(others), torque_unit)
    elif unused := [name for name in others if name not in signals.exogenous]:
        notes.append(f"not among the axis file's exogenous signals, left out: {', '.join(unused)}")
    others = {name: signals.exogenous[name].si(column) for name, column in others.items() if name in signals.exogenous}
    recording = _recording(path, times, values, others, sources["torque"].acts, notes)
    recording = replace(recording, start=start, torque_unit=torque_unit)
    return Imported(recording, signals, kind or units.kind_of(units_told), tuple(units_told))


def _sources(
    roles: Roles, signals: SignalMap | None, kind: str | None, where: str, notes: list[str]
) -> tuple[dict[str, SignalSource], list[Named]]:
    """How the column of each signal becomes SI units, and the units that were told: by the column, else by the axis file."""
    given = dict(signals.named()) if signals is not None else {}
    bare = {name: replace(given[name]) if name in given else SignalSource(where, name) for name in roles.columns}
    named = [
        Named(name, role.column, bare[name].unit if role.unit in units.WITHOUT or counts(role.unit) else role.unit)
        for name, role in roles.columns.items()
    ]
    counted = {item.signal for item in named if counts(item.column) or counts(roles.columns[item.signal].unit)} - {"time"}
    for item in named:
        if item.signal in counted and item.unit in units.WITHOUT and bare[item.signal].scale == 1.0:
            expected = f"signals: {item.signal}: {{scale: of a count}} in the axis file, or --column {item.signal}=NAME:UNIT"
            raise InputError(where, f"column {item.column!r} holds counts", expected)
    settled = units.settled(named, where, kind)
    without = [item for item in named if item.unit in units.WITHOUT and item.signal not in ("time", *counted)]
    notes += [taken_as_si(item.column) for item in without]
    return {name: replace(source, unit=settled[name]) for name, source in bare.items()}, named


def _torque_unit(source: SignalSource, signals: SignalMap | None, where: str, notes: list[str]) -> str:
    """What all that has torque in it is in, "" for N m or N. Raises InputError where the axis file says something else."""
    found, believed = units.torque_base(source.unit, source.rated), signals.torque_unit if signals is not None else ""
    if found and abs(source.scale) != 1.0 and not believed:
        return ""  # the scale is the torque constant
    if believed and found != believed:
        expected = f"{believed}, as signals.torque.unit of the axis file"
        raise InputError(where, f"holds the torque in {source.unit or 'N m'}", expected)
    if found and signals is not None and not believed:
        notes.append(f"torque in {found}, and so is everything that has torque in it (signals.torque.unit of the axis file)")
    return found


def _times(table: Table, role: Role, values: Mapping[str, Column], where: str, notes: list[str]) -> tuple[Column, int]:
    """Times in s, and when the earliest is, ns since 1970, 0 where nobody knows."""
    times = table.columns[role.column]
    good = times[np.isfinite(times)]
    if not len(good):
        text = table.texts.get(role.column)
        found = f"times such as {text[:40]!r} cannot be read" if text else "no times"
        raise InputError(where, f"{found} in column {role.column!r}", "numbers, h:m:s or 2026-11-01T00:59:30.004+00:00")
    unit = role.unit if role.unit not in units.WITHOUT else ""
    if not unit:
        position, velocity = values["position"], values.get("velocity")
        pace = pace_of(times, position, velocity) if velocity is not None else np.nan
        unit = unit_of_times(good, role.column, where, pace, notes)
    factor = units.SECONDS[units.settled([Named("time", role.column, unit)], where, None)["time"]][0]
    first = float(np.min(good))
    if first * factor > LAST_DATE and (told := unit_of_date(good)):
        expected = f"{told} since 1970: --column time={role.column}:{told}"
        raise InputError(where, f"times of {first:.4g} cannot be {unit}", expected)
    since = (times - first) * factor
    if np.max(since, initial=0.0, where=np.isfinite(since)) > LONGEST:
        found = f"times are {np.nanmax(since):.3g} s apart"
        raise InputError(where, found, f"seconds, {LONGEST:g} at most")
    began = first * factor
    start = table.starts.get(role.column) or (round(began * 1e9) if FIRST_DATE <= began <= LAST_DATE else 0)
    return _one_behind_another(table, since, notes), start


def _one_behind_another(table: Table, times: Column, notes: list[str]) -> Column:
    """Times that begin anew with every episode of a LeRobot data set, with a gap between episodes."""
    episodes = table.columns.get(EPISODE)
    begins = np.flatnonzero(np.diff(episodes) != 0.0) + 1 if episodes is not None else np.zeros(0, dtype=np.intp)
    if not len(begins) or not (times[begins] <= times[begins - 1]).any():
        return times
    pause = PAUSE * float(np.median(np.abs(np.diff(times))))
    shifts = np.zeros(len(times))
    shifts[begins] = times[begins - 1] - times[begins] + pause
    notes.append(f"{len(begins) + 1} episodes, one behind the other with a gap of {pause:.3g} s")
    return np.asarray(times + np.cumsum(shifts))


def _others(columns: Mapping[str, Column], roles: Roles, where: str) -> dict[str, Column]:
    """The columns that play no part, by the names of their topics; those of a signal's further columns are left out."""
    taken = {role.column for role in roles.columns.values()}
    origins: dict[str, str] = {}
    for column in columns:
        if column in taken or column in roles.left_out or column in BOOKKEEPING:
            continue
        token = roles.renamed.get(column) or _token(column)
        if token in NAMES:
            raise InputError(where, f"column {column!r} would be a second signal named {token}", "another column name")
        if token in origins:
            found = f"columns {origins[token]!r} and {column!r} would both be signal {token}"
            raise InputError(where, found, "names that differ in letters or digits")
        origins[token] = column
    return {token: columns[column] for token, column in origins.items()}


def _recording(
    path: Path, times: Column, values: dict[str, Column], others: dict[str, Column], acts: str | float, notes: list[str]
) -> Recording:
    """The table's rows as a bag's columns, so that bad rows are found and handled in one place."""
    good = np.isfinite(times)
    if not good.all():
        notes.append(mended(f"{np.count_nonzero(~good)} rows without a time left out"))
    stamps = EPOCH + np.rint(times[good] * 1e9).astype(np.int64)
    rows = _in_order(stamps, notes)
    topic = str(path)
    sources = {name: SignalSource(topic, name) for name in values} | {"torque": SignalSource(topic, "torque", acts=acts)}
    exogenous = {name: SignalSource(topic, name) for name in others}
    found = {source: {**values, **others}[name][good][rows] for name, source in {**sources, **exogenous}.items()}
    columns = TopicColumns(topic, stamps[rows], stamps[rows], found)
    recording = align({topic: columns}, SignalMap(**sources, exogenous=exogenous), topic, notes)
    told = tuple(note for note in recording.notes if not note.startswith("time base"))
    return replace(recording, notes=told)


def _in_order(stamps: Nanoseconds, notes: list[str]) -> NDArray[np.intp] | slice:
    """The rows, sorted by time where they have no order: more of them go far back than there can be strays.

    Somebody has sorted the table by another column or mixed it. A clock that is set back does that now and then.
    """
    if np.count_nonzero(np.diff(stamps) < -clock.JUMP) <= (1.0 - clock.USABLE) * len(stamps):
        return slice(None)
    notes.append(mended("rows are in no order of time, sorted by it"))
    return np.argsort(stamps, kind="stable")


def default_signals(joint: str, names: Iterable[str], others: Iterable[str], torque_unit: str = "") -> SignalMap:
    """Where an imported recording lies in its bag: joint states, temperature, reference, one topic for each other."""
    fields = {"position": "position", "velocity": "velocity", "torque": "effort"}
    known: dict[str, SignalSource] = {
        name: SignalSource("/joint_states", fields[name], joint, unit=torque_unit if name == "torque" else "")
        for name in fields
        if name in names
    }
    if "temperature" in names:
        known["temperature"] = SignalSource("/temperature", "temperature")
    if "reference" in names:
        known["reference"] = SignalSource("/reference", "position")
    return SignalMap(**known, exogenous={name: SignalSource(f"/{name}", "vector.x") for name in others})


def _token(column: str) -> str:
    """A column's name as a name of a topic: letters, digits and underscores, not a digit first; without a unit in brackets."""
    bare = re.sub(r"\s*[\[(][^\[\]()]*[\])]\s*$", "", column)
    name = re.sub(r"\W+", "_", bare.lower(), flags=re.ASCII).strip("_") or "column"
    return f"x_{name}" if name[0].isdigit() else name
