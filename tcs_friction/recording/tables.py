"""Recordings as tables with units in the column names: CSV and Parquet, out and in."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording import units
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import OPTIONAL, REQUIRED, SignalMap, SignalSource
from tcs_friction.recording.table_files import read_csv, read_parquet, write_csv, write_parquet
from tcs_friction.recording.units import Named
from tcs_friction.recording.write import EPOCH

TABLES = (".csv", ".parquet")  # endings of the files that are tables
ROTARY = {"position": "rad", "velocity": "rad/s", "torque": "N m", "reference": "rad"}
LINEAR = {"position": "m", "velocity": "m/s", "torque": "N", "reference": "m"}
UNITS = {"rotary": ROTARY, "linear": LINEAR}

NAMES = {
    "time": ("time", "t", "stamp", "timestamp", "seconds"),
    "position": ("position", "angle", "pos", "q", "theta"),
    "velocity": ("velocity", "speed", "vel", "omega"),
    "torque": ("torque", "effort", "force", "tau", "u"),
    "temperature": ("temperature", "temp"),
    "reference": ("reference", "setpoint", "target", "desired"),
}
"""What a column of a spreadsheet may be called, in any case, with the unit in brackets or behind an underscore."""

TORQUE_WORDS = (*NAMES["torque"], "thrust", "current", "iq", "voltage")
"""Last words of a column's name that say a torque where no column is called just so: `Motor force`, `q-axis current`."""

LONGEST = 1e9  # s, thirty years; times that are farther apart are in another unit
FIRST_DATE, LAST_DATE = 1e9, 4e9  # s since 1970, the years 2001 and 2096; smaller times count from something else
_HEAD = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*")


@dataclass(frozen=True, eq=False)
class Imported:
    """A table as a recording, with the signals block under which a bag will hold it.

    kind: of the axis, None where the units do not tell. torque_unit: as the column's name has it, "" for none.
    """

    recording: Recording
    signals: SignalMap
    kind: str | None = None
    torque_unit: str = ""


def export_table(recording: Recording, path: Path, kind: str = "rotary") -> None:
    """Write a recording to .csv or .parquet, by the suffix; the last column counts the segments from 0.

    Raises InputError for another suffix, JobError if Parquet is not installed. Nothing half-written bears the name.
    """
    columns = dict(named_columns(recording, kind))
    writers: dict[str, Callable[[Mapping[str, np.ndarray], Path], None]] = {".csv": write_csv, ".parquet": write_parquet}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise InputError(str(path), f"suffix {path.suffix!r}", ".csv or .parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    scratch = Path(name)
    try:
        writer(columns, scratch)
        scratch.chmod(0o644)
        scratch.replace(path)
    finally:
        scratch.unlink(missing_ok=True)


def named_columns(recording: Recording, kind: str) -> Iterator[tuple[str, np.ndarray]]:
    """Column names with units, and columns; exogenous signals have no unit because nobody has told it."""
    units = UNITS[kind] | {"temperature": "degC"}
    yield "time [s]", recording.t
    for name in (*REQUIRED, *OPTIONAL):
        values = getattr(recording, name)
        if values is not None:
            yield f"{name} [{units[name]}]", values
    yield from recording.exogenous.items()
    segment = np.full(len(recording), -1, dtype=np.int64)
    for number, part in enumerate(recording.segments):
        segment[part] = number
    yield "segment", segment


def import_table(
    path: Path, joint: str, chosen: Mapping[str, str], signals: SignalMap | None = None, kind: str | None = None
) -> Imported:
    """Read .csv or .parquet. `chosen`: signal -> column, for columns whose name says too little or that are several.

    Columns that are no signal become exogenous signals. kind: of the axis, `rotary` or `linear`, None where only the units
    tell. Bad rows are handled as those of a bag are. Raises InputError naming what is missing, ambiguous or in a wrong unit.
    """
    where = str(path)
    if not path.exists():
        raise InputError(where, "does not exist", "a .csv or .parquet file")
    if not path.is_file():
        raise InputError(where, "is no regular file", "a .csv or .parquet file")
    table = read_parquet(path) if path.suffix.lower() == ".parquet" else read_csv(path)
    notes = list(table.notes)
    roles = _roles(table.columns, chosen, where, notes)
    named = [Named(name, column, "s" if column in table.seconds else _split(column)[1]) for name, column in roles.items()]
    conversions = units.conversions(named, where, kind)
    for item in named:
        if item.unit in units.WITHOUT:
            notes.append(f"column {item.column!r} has no unit, taken as SI")
    values = {name: units.converted(table.columns[column], conversions[name]) for name, column in roles.items()}
    others = _others(table.columns, roles, where)
    if signals is None:
        signals = default_signals(joint, tuple(values), tuple(others))
    elif unused := [name for name in others if name not in signals.exogenous]:
        notes.append(f"not among the axis file's exogenous signals, left out: {', '.join(unused)}")
    torque_unit = next(item.unit for item in named if item.signal == "torque")
    return Imported(_recording(path, values, others, signals, notes), signals, kind or units.kind_of(named), torque_unit)


def _others(columns: Mapping[str, Column], roles: Mapping[str, str], where: str) -> dict[str, Column]:
    """The columns that play no part, by the names of their topics; those of a signal's further columns are left out."""
    origins: dict[str, str] = {}
    for column in columns:
        if column == "segment" or _signal(column):
            continue
        if column in roles.values():
            continue
        token = _token(column)
        if token in NAMES:
            raise InputError(where, f"column {column!r} would be a second signal named {token}", "another column name")
        if token in origins:
            found = f"columns {origins[token]!r} and {column!r} would both be signal {token}"
            raise InputError(where, found, "names that differ in letters or digits")
        origins[token] = column
    return {token: columns[column] for token, column in origins.items()}


def _recording(
    path: Path, values: dict[str, Column], others: dict[str, Column], signals: SignalMap, notes: list[str]
) -> Recording:
    """The table's rows as a bag's columns, so that bad rows are found and handled in one place."""
    times = values["time"]
    good = np.isfinite(times)
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} rows without a time left out")
    since = times[good] - np.min(times[good], initial=np.inf)
    if np.max(since, initial=0.0) > LONGEST:
        raise InputError(str(path), f"times are {np.max(since):.3g} s apart", f"seconds, {LONGEST:g} at most")
    stamps = EPOCH + np.rint(since * 1e9).astype(np.int64)
    found = {name: column for name, column in {**values, **others}.items() if name != "time"}
    topic = str(path)
    sources = {name: SignalSource(topic, name) for name in found if name in (*REQUIRED, *OPTIONAL)}
    exogenous = {name: SignalSource(topic, name) for name in found if name in signals.exogenous and name not in sources}
    table = SignalMap(**sources, exogenous=exogenous)
    columns = TopicColumns(
        topic, stamps, stamps, {SignalSource(topic, name): column[good] for name, column in found.items()}
    )
    recording = align({topic: columns}, table, topic, notes)
    told = tuple(note for note in recording.notes if not note.startswith("time base"))
    return replace(recording, notes=told, start=_began(float(np.min(times[good], initial=np.inf))))


def _began(seconds: float) -> int:
    """Start of a recording, ns since 1970, from its first time, 0 where that counts from something else."""
    return round(seconds * 1e9) if FIRST_DATE <= seconds <= LAST_DATE else 0


def default_signals(joint: str, names: Iterable[str], others: Iterable[str]) -> SignalMap:
    """Where an imported recording lies in its bag: joint states, temperature, reference, one topic for each other."""
    fields = {"position": "position", "velocity": "velocity", "torque": "effort"}
    known: dict[str, SignalSource] = {
        name: SignalSource("/joint_states", fields[name], joint) for name in fields if name in names
    }
    if "temperature" in names:
        known["temperature"] = SignalSource("/temperature", "temperature")
    if "reference" in names:
        known["reference"] = SignalSource("/reference", "position")
    return SignalMap(**known, exogenous={name: SignalSource(f"/{name}", "vector.x") for name in others})


def _roles(columns: Mapping[str, Column], chosen: Mapping[str, str], where: str, notes: list[str]) -> dict[str, str]:
    """Which column plays which part: as chosen, else by its name. Two columns for one part are refused unless one is chosen."""
    roles: dict[str, str] = {}
    for name, column in chosen.items():
        if name not in NAMES:
            raise InputError(where, f"no signal {name!r}", nearest(name, NAMES))
        if column not in columns:
            raise InputError(where, f"no column {column!r}", nearest(column, columns))
        if column in roles.values():
            raise InputError(where, f"column {column!r} chosen for two signals", "a column for each")
        roles[name] = column
    for name in NAMES:
        matches = [column for column in columns if _signal(column) == name and column not in roles.values()]
        if name in roles:
            notes.extend(f"column {column!r} left out: {name} is {roles[name]!r}" for column in matches)
        elif len(matches) > 1:
            found = f"{len(matches)} columns for {name}: {' and '.join(map(repr, matches))}"
            raise InputError(where, found, f"one, or --column {name}=COLUMN")
        elif matches:
            roles[name] = matches[0]
    if "torque" not in roles:
        likely = [column for column in columns if column not in roles.values() and _ends_as_torque(column)]
        if len(likely) > 1:
            found = f"{len(likely)} columns that may be the torque: {' and '.join(map(repr, likely))}"
            raise InputError(where, found, "one, or --column torque=COLUMN")
        roles.update(("torque", column) for column in likely)
    for name in ("time", *REQUIRED):
        if name not in roles:
            expected = f"a column of that name, or --column {name}=COLUMN with one of {', '.join(columns)}"
            raise InputError(where, f"no {name}", expected)
    return roles


def _signal(column: str) -> str | None:
    """The signal that a column's name says, None if it says none."""
    return next((name for name, words in NAMES.items() if _split(column)[0] in words), None)


def _ends_as_torque(column: str) -> bool:
    words = re.split(r"[\s_]+", _split(column)[0])
    return words[-1] in TORQUE_WORDS and not any(wanted in words for wanted in NAMES["reference"])


def _split(column: str) -> tuple[str, str]:
    """Name in lower case and unit of a column: `Angle [deg]`, `angle (deg)`, `angle_deg`."""
    match = _HEAD.fullmatch(column)
    assert match is not None  # every text matches
    name, unit = match[1].lower(), units.spelled(match[2] or "")
    known = {word for words in NAMES.values() for word in words}
    if not unit and name not in known:
        head, _, tail = match[1].partition("_")
        tail = units.spelled(tail.replace("_per_", "/"))
        if head.lower() in known and units.is_unit(tail):
            return head.lower(), tail
    return name, unit


def _token(column: str) -> str:
    """A column's name as a name of a topic: letters, digits and underscores, not a digit first."""
    name = re.sub(r"\W+", "_", _split(column)[0], flags=re.ASCII).strip("_") or "column"
    return f"x_{name}" if name[0].isdigit() else name
