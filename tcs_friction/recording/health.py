"""What a person reads before anything is identified from a bag: rates, repeated values, clocks, wraps, publishers, units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.numerics.integral import travelled
from tcs_friction.recording import clock
from tcs_friction.recording.align import align
from tcs_friction.recording.bags import Bag, read_columns
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.freshness import fresh_samples, longest_unchanged
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.stamps import stamped
from tcs_friction.recording.table_times import taken_as_si
from tcs_friction.recording.tables import Imported
from tcs_friction.recording.units import WITHOUT, Named, torque_base

UNITS = {"position": "rad or m", "velocity": "rad/s or m/s", "torque": "N m or N", "temperature": "degC", "reference": "rad or m"}
BY_REP_103 = "as ROS has it (REP 103)"
OTHER_UNITS = {180.0 / np.pi: "deg", 1.0 / (2.0 * np.pi): "turns", 30.0 / np.pi: "revolutions a minute"}
"""What a velocity may be in, by its ratio to the derivative of a position in rad."""
SAME = 0.03
"""Share by which a velocity and the derivative of its position may differ: filters of drives do that."""
LONG = 10.0
"""Fresh periods without a change that are worth a word (clock.GAP_PERIODS)."""
FEWEST = 100


def nobody_knows(_: Recording) -> float | None:
    """When the torque of a recording acts, where nobody looks."""
    return None


@dataclass(frozen=True)
class SignalHealth:
    """One proposed signal. rate: messages, Hz. fresh: new values, Hz.

    unchanged: longest time with the same value, s, from `since` on. low, high: of its values. unit: as believed, and why.
    """

    source: str
    rate: float
    fresh: float
    unchanged: float
    since: float
    low: float
    high: float
    unit: str
    why: str

    def __str__(self) -> str:
        parts = [f"{self.rate:.4g} Hz"]
        if self.fresh < 0.9 * self.rate:
            parts.append(f"a new value at {self.fresh:.4g} Hz only, held between (every {self.rate / self.fresh:.3g} messages)")
        if self.low == self.high:
            parts.append(f"always {self.low:.6g}")
        elif self.unchanged * self.fresh > LONG:
            parts.append(f"the same for {self.unchanged:.4g} s from {self.since:.4g} s on")
        parts.append(f"{self.low:.4g} to {self.high:.4g} {self.unit}, {self.why}")
        return "; ".join(parts)


@dataclass(frozen=True)
class Health:
    """signals by name. notes: what reading them as a recording finds and mends. refused: why they are none, or None.

    acts: s after its stamp at which a torque begins to act, as the motion tells, None where it does not. period: of it, s.
    """

    signals: dict[str, SignalHealth]
    notes: tuple[str, ...]
    refused: str | None
    samples: int
    duration: float
    acts: float | None = None
    period: float = 0.0

    def to_mapping(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def lines(self) -> list[str]:
        """For people."""
        width = max(map(len, self.signals), default=0)
        lines = [f"  {name:{width}}  {one}" for name, one in self.signals.items()]
        lines += [f"  {self._timing()}"] if self.samples else []
        told = {taken_as_si(one.source) for one in self.signals.values()}  # by the lines above
        lines += [f"  {note}" for note in self.notes if note not in told and not note.startswith("time base: header")]
        usable = f"read as a recording: {self.samples} samples, {self.duration:.6g} s"
        return ["# signals of the axis", *lines, f"  refused: {self.refused}" if self.refused else f"  {usable}"]

    def _timing(self) -> str:
        if self.acts is None:
            return "torque and motion: the motion does not tell when the torque acts"
        side = "before" if self.acts < 0.0 else "after"
        when = f"{1e3 * abs(self.acts):.3g} ms {side} its stamp" if self.acts else "at its stamp"
        said = f"torque and motion: a torque begins to act {when}, as the motion tells (to half of {1e3 * self.period:.3g} ms)"
        held = -1.5 * self.period <= self.acts <= 0.5 * self.period
        return said if held else f"{said}: clocks, filters or a delay"


def health(path: Path, block: Mapping[str, Any], acting: Callable[[Recording], float | None] = nobody_knows) -> Health | None:
    """The proposed signals of a bag (`block`: as SignalMap.from_mapping takes it) looked at; None without position or torque.

    acting: when the torque of a recording acts, as `Health.acts` has it.
    """
    if not {"position", "torque"} <= set(block):
        return None
    signals = SignalMap.from_mapping(block, str(path))
    try:
        columns, notes = read_columns(Bag(path), [source for _, source in signals.named()])
    except InputError as error:
        return Health({}, (), str(error), 0, 0.0)
    found = {name: _looked_at(name, columns[source.topic], source) for name, source in signals.named()}
    found = {name: one for name, one in found.items() if name not in signals.exogenous or one.low != one.high}
    try:
        recording = align(columns, signals, str(path), notes)
    except InputError as error:
        return Health(found, tuple(notes), f"{error.found}, expected {error.expected}", 0, 0.0)
    return _of_recording(recording, found, acting)


def table_health(table: Imported, acting: Callable[[Recording], float | None] = nobody_knows) -> Health:
    """The same of a table that has been read."""
    recording, told = table.recording, {one.signal: one for one in table.told}
    names = [name for name in UNITS if getattr(recording, name) is not None]
    values = {name: getattr(recording, name) for name in names} | dict(recording.exogenous)
    found = {}
    for name, column in values.items():
        fine = np.isfinite(column)
        source = told[name].column if name in told else name
        found[name] = _of_values(source, recording.t[fine], column[fine], _in_table(table, told.get(name)))
    return _of_recording(recording, found, acting)


def _in_table(table: Imported, told: Named | None) -> tuple[str, str]:
    """The unit that a signal is told in, and why."""
    if told is None:
        return "", "unit unknown"
    either = UNITS[told.signal].split(" or ")
    unit = either[-1 if table.kind == "linear" else 0] if table.kind else UNITS[told.signal]
    unit = table.recording.torque_unit or unit if told.signal == "torque" else unit
    if told.unit in WITHOUT:
        return unit, f"column {told.column!r} says no unit, taken as SI"
    return unit, f"recorded in {told.unit} in column {told.column!r}"


def _of_recording(
    recording: Recording, found: dict[str, SignalHealth], acting: Callable[[Recording], float | None]
) -> Health:
    if (said := _velocity_says(recording)) and "velocity" in found:
        found["velocity"] = _with_reason(found["velocity"], f"{found['velocity'].why}; {said}")
    acts, period = acting(recording), 1.0 / found["torque"].fresh if found["torque"].fresh else 0.0
    return Health(found, recording.notes, None, len(recording), recording.duration, acts, period)


def _looked_at(name: str, columns: TopicColumns, source: SignalSource) -> SignalHealth:
    values = columns.values[source]
    try:
        chosen = stamped(columns, source.topic, [])
    except InputError:
        chosen = np.zeros(len(columns), dtype=np.bool_)
    headers = columns.stamps is not None and (chosen is None or bool(chosen.any()))
    rows = np.flatnonzero(np.isfinite(values) & (chosen if chosen is not None and headers else True))
    stamps = columns.stamps if headers and columns.stamps is not None else columns.log_times
    line = clock.timeline(stamps[rows], columns.log_times[rows])
    fine = values[rows][line.rows]
    seconds = np.asarray((line.times - line.times[:1]) * 1e-9, dtype=np.float64)
    return _of_values(str(source), seconds, fine, _believed(name, source))


def _of_values(source: str, seconds: Column, fine: Column, believed: tuple[str, str]) -> SignalHealth:
    """Of finite values (n,) at times (n,), s; believed: unit and why."""
    unit, why = believed
    if not len(fine):
        return SignalHealth(source, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, unit, "no finite value")
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    period, _ = fresh_samples(seconds, fine)
    unchanged, since = longest_unchanged(seconds, fine)
    rate, fresh = (1.0 / one if one > 0.0 else 0.0 for one in (usual, period))
    return SignalHealth(source, rate, fresh, unchanged, since, float(fine.min()), float(fine.max()), unit, why)


def _believed(name: str, source: SignalSource) -> tuple[str, str]:
    """The unit of a signal and why."""
    if source.unit:
        unit = torque_base(source.unit, source.rated) if name == "torque" else ""
        return unit or UNITS[name], f"recorded in {source.unit}, as its name says"
    return UNITS.get(name, ""), BY_REP_103 if name in UNITS else "unit unknown"


def _velocity_says(recording: Recording) -> str:
    """Whether the velocity is the derivative of the position, "" if nobody can tell."""
    if recording.velocity is None:
        return ""
    part = max(recording.segments, key=lambda one: one.stop - one.start)
    seconds, position, velocity = recording.t[part], recording.position[part], recording.velocity[part]
    if len(seconds) < FEWEST or np.ptp(velocity) == 0.0:
        return ""
    way = travelled(seconds, velocity)
    design = np.column_stack((position, np.ones(len(position)), seconds))
    (ratio, _, _), *_ = np.linalg.lstsq(design, way, rcond=None)
    left = way - design @ np.array([ratio, *np.linalg.lstsq(design[:, 1:], way - ratio * position, rcond=None)[0]])
    if np.var(left) > 0.1 * np.var(way - np.polyval(np.polyfit(seconds, way, 1), seconds)):
        return "it is not the derivative of the position"
    if abs(ratio - 1.0) <= SAME:
        return f"the derivative of the position ({ratio:.3f} times)"
    other = next((unit for factor, unit in OTHER_UNITS.items() if abs(ratio / factor - 1.0) <= SAME), "")
    return f"{ratio:.4g} times the derivative of the position{f': is it in {other}?' if other else ', has it a scale?'}"


def _with_reason(one: SignalHealth, why: str) -> SignalHealth:
    return SignalHealth(**(asdict(one) | {"why": why}))
