"""The axes of a fleet: AXES.yaml, and which of them a recording is of.

    - {axis: axes/azimuth.yaml}                                        # the signals of the axis file decide
    - {axis: axes/dome.yaml, topic: /dome/*, joint: dome, path: dome_*, from: 2025-03-01, to: 2026-01-01}
    - {axis: axes/focus.yaml, path: focus/*.csv, columns: {torque: "motor current:A"}}
"""

from __future__ import annotations

import datetime
import functools
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from tcs_friction.config import AxisFile, axis_file_mapping, load_axis, mapping, parse_axis
from tcs_friction.errors import InputError
from tcs_friction.fleet.rows import NO_AXIS
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.table_names import NAMES
from tcs_friction.recording.tables import import_table
from tcs_friction.yaml_files import load_yaml_of_any_kind

KEYS = ("axis", "topic", "joint", "from", "to", "path", "columns")
DAY = 86_400 * 10**9
LATEST = 1 << 62  # ns since 1970


@dataclass(frozen=True)
class FleetAxis:
    """An entry of AXES.yaml. `text` is the axis file as JSON, which a process that works on recordings reads once.

    topic: pattern that a topic of the recording fits, "" for any. path: pattern that its path, or the end of it, fits.
    since, until: ns since 1970; a recording that began at or after the first and before the second fits. columns: of
    tables, signal and column, where the names do not tell. strict: whether recordings that have to be mended are refused.
    """

    name: str
    text: str
    topic: str = ""
    path: str = ""
    since: int = 0
    until: int = LATEST
    columns: tuple[tuple[str, str], ...] = ()
    strict: bool = False

    @property
    def decides(self) -> str:
        """All that a row depends on."""
        choice = f" {self.columns} {self.strict}" if self.columns or self.strict else ""
        return f"{self.text}{choice}"

    def told(self, choice: Choice, signals: SignalMap | None = None) -> FleetAxis:
        """The same with what somebody says on the command line as well. signals: of the joint that is meant."""
        columns = tuple(sorted({**dict(self.columns), **choice.columns}.items()))
        text = _text(self.file, signals) if signals is not None else self.text
        return replace(self, text=text, columns=columns, strict=choice.strict)

    def table(self, path: Path) -> Recording:
        """A table as a recording of this axis."""
        return import_table(path, "", dict(self.columns), self.signals, self.file.axis.kind).recording

    @property
    def file(self) -> AxisFile:
        """The axis file."""
        return _parsed(self.text)

    @property
    def signals(self) -> SignalMap:
        """Where its signals are."""
        return self.file.mapped(self.name)

    def fits(self, recording: str, topics: Collection[str], start: int) -> bool:
        """Whether path, topics and time fit; a time that nobody knows (0) fits only an axis that has no limits."""
        return (
            (not self.path or any(fnmatchcase(recording, pattern) for pattern in (self.path, f"*/{self.path}")))
            and (not self.topic or any(fnmatchcase(topic, self.topic) for topic in topics))
            and self.since <= start < self.until
        )


@functools.lru_cache(maxsize=1024)
def _parsed(text: str) -> AxisFile:
    content = json.loads(text)
    return AxisFile(parse_axis(content["axis"]), SignalMap.from_mapping(content["signals"], "axis"))


def read_axes(path: Path) -> tuple[FleetAxis, ...]:
    """The entries. Raises InputError naming the one that is wrong, or two that are called the same."""
    content = load_yaml_of_any_kind(path)
    if not isinstance(content, list) or not content:
        raise InputError(str(path), type(content).__name__, "a list of {axis: PATH_OF_AXIS_FILE, ...}")
    axes = [_entry(entry, path, f"{path}[{number}]") for number, entry in enumerate(content)]
    for number, axis in enumerate(axes):
        if any(other.name == axis.name for other in axes[:number]):
            raise InputError(f"{path}[{number}]", f"a second axis named {axis.name}", "a name for each axis")
    return tuple(axes)


def _entry(entry: object, path: Path, where: str) -> FleetAxis:
    block = mapping(entry, where, KEYS)
    for key in ("axis", "topic", "joint", "path"):
        value = block.get(key)
        if (key == "axis" or value is not None) and (not isinstance(value, str) or not value):
            raise InputError(where, f"{key} is {value!r}", "a path" if key == "axis" else "a text")
    since, until = _time(block, "from", where, 0), _time(block, "to", where, LATEST)
    if not since < until:
        raise InputError(where, f"from {block['from']} to {block['to']}", "an earlier date first")
    source = path.parent / block["axis"]
    file = load_axis(source)
    signals = file.mapped(source)
    if block.get("joint"):
        signals = signals.of_joint(block["joint"])
    if file.axis.name == NO_AXIS or "/" in file.axis.name or not file.axis.name.strip("."):
        raise InputError(str(source), f"axis: name is {file.axis.name!r}", "a name that can be one of a folder")
    columns = mapping(block.get("columns") or {}, f"{where}: columns", tuple(NAMES))
    if not all(isinstance(column, str) and column for column in columns.values()):
        raise InputError(f"{where}: columns", repr(dict(columns)), "SIGNAL: COLUMN, each a text")
    chosen, text = tuple(sorted(columns.items())), _text(file, signals)
    return FleetAxis(file.axis.name, text, block.get("topic") or "", block.get("path") or "", since, until, chosen)


def _text(file: AxisFile, signals: SignalMap) -> str:
    return json.dumps(axis_file_mapping(AxisFile(file.axis, signals)), sort_keys=True)


def _time(block: Mapping[str, Any], key: str, where: str, default: int) -> int:
    """A date as ns since 1970; without a zone it is UTC."""
    value = block.get(key)
    if value is None:
        return default
    try:
        moment = datetime.datetime.fromisoformat(str(value))
    except ValueError:
        raise InputError(where, f"{key} is {value!r}", "a date such as 2026-03-01") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.UTC)
    return int(moment.timestamp()) * 10**9


def fingerprint(axes: Sequence[FleetAxis]) -> str:
    """A name that changes with anything that says which axis a recording is of."""
    return hashlib.sha256(repr([tuple(vars(axis).items()) for axis in axes]).encode()).hexdigest()[:16]
