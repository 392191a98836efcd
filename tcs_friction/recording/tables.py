"""Recordings as tables with units in the column names: CSV and Parquet, out and in."""

from __future__ import annotations

import csv
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError, JobError, nearest
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import OPTIONAL, REQUIRED, SignalMap, SignalSource
from tcs_friction.recording.write import EPOCH

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

TO_SI: dict[str, float] = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "arcmin": np.pi / 10800, "arcsec": np.pi / 648000, "rev": 2 * np.pi,
    "rad/s": 1.0, "deg/s": np.pi / 180, "arcsec/s": np.pi / 648000, "rpm": np.pi / 30,
    "m": 1.0, "mm": 1e-3, "um": 1e-6, "m/s": 1.0, "mm/s": 1e-3,
    "nm": 1.0, "mnm": 1e-3, "knm": 1e3, "n": 1.0, "kn": 1e3, "degc": 1.0, "c": 1.0, "k": 1.0,
}  # fmt: skip
"""Factor to SI units by unit in lower case and without blanks; `nm` is the newton metre."""

_HEAD = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*")


@dataclass(frozen=True, eq=False)
class Imported:
    """A table as a recording, with the signals block under which a bag will hold it."""

    recording: Recording
    signals: SignalMap


def export_table(recording: Recording, path: Path, kind: str = "rotary") -> None:
    """Write a recording to .csv or .parquet, by the suffix; the last column counts the segments from 0.

    Raises InputError for another suffix, JobError if Parquet is not installed. Nothing half-written bears the name.
    """
    columns = dict(named_columns(recording, kind))
    writers: dict[str, Callable[[Mapping[str, np.ndarray], Path], None]] = {".csv": _to_csv, ".parquet": _to_parquet}
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


def _to_csv(columns: Mapping[str, np.ndarray], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        count = len(next(iter(columns.values())))
        for start in range(0, count, 1 << 16):
            writer.writerows(zip(*(values[start : start + (1 << 16)].tolist() for values in columns.values()), strict=True))


def _to_parquet(columns: Mapping[str, np.ndarray], path: Path) -> None:
    parquet = _parquet(path)
    import pyarrow

    parquet.write_table(pyarrow.table({name: pyarrow.array(values) for name, values in columns.items()}), path)


def _parquet(path: Path) -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise JobError(str(path), "Parquet needs the package pyarrow", "pip install pyarrow, or .csv") from None
    return pyarrow.parquet


def import_table(path: Path, joint: str, chosen: Mapping[str, str], signals: SignalMap | None = None) -> Imported:
    """Read .csv or .parquet. `chosen`: signal -> column, for columns whose name says too little.

    Columns that are no signal become exogenous signals. Bad rows are handled as those of a bag are. Raises
    InputError naming what is missing.
    """
    if not path.exists():
        raise InputError(str(path), "does not exist", "a .csv or .parquet file")
    table = _from_parquet(path) if path.suffix.lower() == ".parquet" else _from_csv(path)
    roles = _roles(table, chosen, str(path))
    notes: list[str] = []
    values = {name: _in_si(table, column, str(path), notes) for name, column in roles.items()}
    others = {_token(column): table[column] for column in table if column not in roles.values() and column != "segment"}
    if signals is None:
        signals = default_signals(joint, tuple(values), tuple(others))
    return Imported(_recording(path, values, others, signals, notes), signals)


def _recording(
    path: Path, values: dict[str, Column], others: dict[str, Column], signals: SignalMap, notes: list[str]
) -> Recording:
    """The table's rows as a bag's columns, so that bad rows are found and handled in one place."""
    times = values["time"]
    good = np.isfinite(times)
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} rows without a time left out")
    stamps = EPOCH + np.rint((times[good] - np.min(times[good], initial=np.inf)) * 1e9).astype(np.int64)
    found = {name: column for name, column in {**values, **others}.items() if name != "time"}
    topic = str(path)
    sources = {name: SignalSource(topic, name) for name in found if name in (*REQUIRED, *OPTIONAL)}
    exogenous = {name: SignalSource(topic, name) for name in found if name in signals.exogenous and name not in sources}
    table = SignalMap(**sources, exogenous=exogenous)
    columns = TopicColumns(
        topic, stamps, stamps, {SignalSource(topic, name): column[good] for name, column in found.items()}
    )
    recording = align({topic: columns}, table, topic, notes)
    return replace(recording, notes=tuple(note for note in recording.notes if not note.startswith("time base")))


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


def _roles(table: Mapping[str, Column], chosen: Mapping[str, str], where: str) -> dict[str, str]:
    """Which column plays which part: as chosen, else by its name."""
    roles: dict[str, str] = {}
    for name, column in chosen.items():
        if name not in NAMES:
            raise InputError(where, f"no signal {name!r}", nearest(name, NAMES))
        if column not in table:
            raise InputError(where, f"no column {column!r}", nearest(column, table))
        roles[name] = column
    for name, words in NAMES.items():
        matches = [column for column in table if _split(column)[0] in words and column not in roles.values()]
        if name not in roles and matches:
            roles[name] = matches[0]
    for name in ("time", *REQUIRED):
        if name not in roles:
            expected = f"a column of that name, or --column {name}=COLUMN with one of {', '.join(table)}"
            raise InputError(where, f"no {name}", expected)
    return roles


def _split(column: str) -> tuple[str, str]:
    """Name and unit of a column, both in lower case: `Angle [deg]`, `angle (deg)`, `angle_deg`."""
    match = _HEAD.fullmatch(column)
    assert match is not None  # every text matches
    name, unit = match[1].lower(), (match[2] or "").lower().replace(" ", "").replace("*", "").replace("°", "deg")
    known = {word for words in NAMES.values() for word in words}
    if not unit and name not in known:
        head, _, tail = name.partition("_")
        tail = tail.replace("_per_", "/")
        if head in known and tail in TO_SI:
            return head, tail
    return name, unit


def _in_si(table: Mapping[str, Column], column: str, where: str, notes: list[str]) -> Column:
    _, unit = _split(column)
    if unit in ("", "1"):
        notes.append(f"column {column!r} has no unit, taken as SI")
        return table[column]
    if unit not in TO_SI:
        raise InputError(where, f"unit {unit!r} of column {column!r}", nearest(unit, TO_SI))
    return table[column] * TO_SI[unit]


def _token(column: str) -> str:
    """A column's name as a name of a topic: letters, digits and underscores, not a digit first."""
    name = re.sub(r"\W+", "_", _split(column)[0], flags=re.ASCII).strip("_") or "column"
    return f"x_{name}" if name[0].isdigit() else name


def _from_parquet(path: Path) -> dict[str, Column]:
    try:
        table = _parquet(path).read_table(path)
        return {name: table[name].to_numpy().astype(np.float64) for name in table.column_names}
    except (OSError, ValueError, TypeError) as error:
        raise InputError(str(path), f"cannot be read ({' '.join(str(error).split())})", "a Parquet file of numbers") from None


def _from_csv(path: Path) -> dict[str, Column]:
    """Columns of a text table; , ; or tab between cells, decimal comma with the last two; cells that are no number are NaN."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"cannot be read ({error})", "a text table") from None
    lines = [line for line in lines if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise InputError(str(path), f"{len(lines)} lines", "a line of column names and rows of numbers")
    delimiter = max(",;\t", key=lines[0].count)
    names = [name.strip() for name in next(csv.reader([lines[0]], delimiter=delimiter))]
    if len(set(names)) < len(names):
        raise InputError(str(path), "columns with the same name", "a name for each column")
    rows = csv.reader((line.replace(",", ".") if delimiter != "," else line for line in lines[1:]), delimiter=delimiter)
    table = np.full((len(lines) - 1, len(names)), np.nan)
    for number, row in enumerate(rows):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number + 2}", f"{len(row)} cells", f"{len(names)} as in the first line")
        for place, cell in enumerate(row):
            table[number, place] = _number(cell)
    return {name: np.ascontiguousarray(table[:, place]) for place, name in enumerate(names) if name}


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan
