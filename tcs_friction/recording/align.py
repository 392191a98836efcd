"""The columns of several topics, each on its own clock and rate, become one Recording.

The time base is the position topic's. Signals of the same messages are taken as they are. Torque from another
topic is held from one message to the next, as the drive holds it; the other signals are interpolated linearly.
Neither is carried over a gap (clock.GAP_PERIODS usual periods of that topic, at least SLOW for temperature).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording import clock
from tcs_friction.recording.columns import Mask, Nanoseconds, TopicColumns, counted
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

SLOW = 60_000_000_000
"""ns; over this long a temperature may be interpolated or held whatever its rate."""

MOST = 0.5
"""An optional signal that lacks more than this share of the samples is left out instead of cutting the recording down."""

SIMULTANEOUS = 0.05
"""Share of a period by which clocks may disagree about one instant; without it rounding would delay by a period."""

OTHER_CLOCK = 1_000_000_000
"""ns; topics whose header clocks differ by more (seen through the log time) are not on the same clock."""


@dataclass(frozen=True, eq=False)
class _Base:
    """The time base: rows of the position topic in order, their times, and how its header relates to the log."""

    columns: TopicColumns
    rows: NDArray[np.intp] | slice
    times: Nanoseconds
    restarts: tuple[int, ...]
    headers: bool
    header_minus_log: int


def align(columns: Mapping[str, TopicColumns], signals: SignalMap, source: str, notes: Sequence[str] = ()) -> Recording:
    """One recording from the columns of every topic that `signals` names.

    Raises InputError when a needed signal has no usable samples.
    """
    told = list(notes)
    base = _base(columns[signals.position.topic], signals.position, source, told)
    fine = np.ones(len(base.times), dtype=np.bool_)
    values: dict[str, Column | None] = {}
    log: tuple[Nanoseconds, Column] | None = None
    for name, signal in signals.named():
        needed = name in ("position", "torque")
        if signal.topic == base.columns.topic:
            column = base.columns.values[signal][base.rows]
        else:
            column, own = _from_other_topic(base, columns[signal.topic], name, signal, told)
            log = own if name == "torque" else log
        values[name] = _usable(column, fine, name, signal, needed, source, told)
    return _cut(base, fine, values, signals, source, told, log)


def _base(columns: TopicColumns, position: SignalSource, source: str, told: list[str]) -> _Base:
    headers = _has_headers(columns, told)
    stamps = columns.stamps if headers and columns.stamps is not None else columns.log_times
    told.append(f"time base: {'header stamps' if headers else 'log times'} of {columns.topic}")
    present = np.flatnonzero(~columns.absent[position]) if position in columns.absent else None
    if present is not None:
        told.append(f"{columns.topic}: {len(columns) - len(present)} messages without joint {position.joint} passed over")
        stamps, log_times = stamps[present], columns.log_times[present]
    else:
        log_times = columns.log_times
    line = clock.timeline(stamps, log_times)
    told.extend(f"{columns.topic}: {note}" for note in line.notes)
    if len(line.times) < 2:
        raise InputError(source, f"{len(line.times)} messages with {position}", "at least 2")
    rows: NDArray[np.intp] | slice = line.rows if present is None else present[line.rows]
    if len(line.rows) == len(columns):
        rows = slice(None) if not line.notes else rows  # nothing left out or sorted: no copies
    offset = int(np.median(columns.stamps - columns.log_times)) if headers and columns.stamps is not None else 0
    return _Base(columns, rows, line.times, line.restarts, headers, offset)


def _has_headers(columns: TopicColumns, told: list[str]) -> bool:
    if columns.stamps is None or not len(columns):
        return False
    empty = clock.empty_stamps(columns.stamps)
    if empty:
        told.append(f"{columns.topic}: {empty} of {len(columns)} header stamps are empty, log times used")
    return not empty


def _from_other_topic(
    base: _Base, columns: TopicColumns, name: str, signal: SignalSource, told: list[str]
) -> tuple[Column, tuple[Nanoseconds, Column] | None]:
    """The signal at the times of the base, and as it was recorded."""
    values = columns.values[signal]
    usable = np.isfinite(values)
    if not usable.all() and usable.any():
        told.append(f"{name}: {np.count_nonzero(~usable)} samples of {signal} are not finite or absent, left out")
    if not usable.any():
        return np.full(len(base.times), np.nan), None
    times, log_times = _on_base_clock(base, columns, told)
    line = clock.timeline(times[usable], log_times[usable])
    told.extend(f"{columns.topic}: {note}" for note in line.notes)
    limit = clock.gap_limit(line.times)
    if name == "temperature":
        limit = max(limit, SLOW)
    ordered = values[usable][line.rows]
    if name == "torque":
        told.append(f"torque: held from {columns.topic} onto the times of {base.columns.topic}")
        return held(base.times, line.times, ordered, limit), (line.times, ordered)
    told.append(f"{name}: interpolated from {columns.topic} onto the times of {base.columns.topic}")
    return interpolated(base.times, line.times, ordered, limit), (line.times, ordered)


def _on_base_clock(base: _Base, columns: TopicColumns, told: list[str]) -> tuple[Nanoseconds, Nanoseconds]:
    """Times of another topic on the clock of the base; the log time is the bridge between two clocks."""
    headers = _has_headers(columns, told)
    if not headers or columns.stamps is None:
        shift = base.header_minus_log
        if base.headers:
            told.append(f"{columns.topic}: log times, moved by {shift * 1e-9:+.6f} s, the usual latency of {base.columns.topic}")
        return columns.log_times + shift, columns.log_times
    own = int(np.median(columns.stamps - columns.log_times))
    if base.headers and abs(own - base.header_minus_log) <= OTHER_CLOCK:
        return columns.stamps, columns.log_times
    shift = base.header_minus_log - own
    told.append(f"{columns.topic}: header stamps on another clock, moved by {shift * 1e-9:+.6f} s to match the log times")
    return columns.stamps + shift, columns.log_times


def held(times: Nanoseconds, known: Nanoseconds, values: Column, limit: int) -> Column:
    """The last value at or before each time, NaN where there is none within `limit` ns.

    A value that comes later by no more than SIMULTANEOUS of a period is of the same instant.
    """
    slack = int(SIMULTANEOUS * clock.usual_period(known))
    before = np.searchsorted(known, times + slack, side="right") - 1
    result = values[np.maximum(before, 0)]
    stale = (before < 0) | (times - known[np.maximum(before, 0)] > limit)
    return np.where(stale, np.nan, result)


def interpolated(times: Nanoseconds, known: Nanoseconds, values: Column, limit: int) -> Column:
    """Linear between neighbours not more than `limit` ns apart; past either end held for `limit`; else NaN."""
    if len(known) < 2:
        return np.where(np.abs(times - known[0]) <= limit, values[0], np.nan)
    after = np.clip(np.searchsorted(known, times, side="right"), 1, len(known) - 1)
    start, stop = known[after - 1], known[after]
    share = np.clip((times - start) / (stop - start), 0.0, 1.0)
    result = values[after - 1] + share * (values[after] - values[after - 1])
    outside = (times < known[0] - limit) | (times > known[-1] + limit)
    inside = (times > start) & (times < stop)
    return np.where(outside | (inside & (stop - start > limit)), np.nan, result)


def _usable(
    column: Column, fine: Mask, name: str, signal: SignalSource, needed: bool, source: str, told: list[str]
) -> Column | None:
    """Mark samples that are not finite as cut; a signal that hardly ever is finite is missing."""
    finite = np.isfinite(column)
    bad = int(len(column) - np.count_nonzero(finite))
    if not bad:
        return column
    if not np.any(finite):
        if needed:
            raise InputError(source, f"no finite {name} sample in {signal} within the recording", "at least 2")
        told.append(f"{name}: no finite sample in {signal} within the recording, left out")
        return None
    if not needed and bad > MOST * len(column):
        told.append(f"{name}: {bad} of {len(column)} samples missing or not finite, signal left out")
        return None
    told.append(f"{name}: {bad} of {len(column)} samples missing or not finite, cut as gaps")
    fine &= finite
    return column


def _cut(
    base: _Base, fine: Mask, values: dict[str, Column | None], signals: SignalMap, source: str, told: list[str],
    log: tuple[Nanoseconds, Column] | None,
) -> Recording:  # fmt: skip
    limit = clock.gap_limit(base.times)
    kept = np.flatnonzero(fine)
    whole = len(kept) == len(fine)
    if len(kept) < 2:
        raise InputError(source, f"{len(kept)} samples with position and torque", "at least 2")
    times = base.times if whole else base.times[kept]
    steps = np.diff(times)
    breaks = (steps > limit) | (np.diff(kept) > 1)
    for restart in base.restarts:
        after = int(np.searchsorted(kept, restart))
        if 0 < after < len(kept):
            breaks[after - 1] = True
    if missing := clock.dropped(base.times):
        period = clock.usual_period(base.times) * 1e-9
        told.append(f"{base.columns.topic}: {counted(missing, 'message')} missing at the usual period of {period:.6g} s")
    if gaps := int(np.count_nonzero(steps > limit)):
        stated = f"{limit * 1e-9:.6g} s ({clock.GAP_PERIODS:g} usual periods)"
        told.append(f"{counted(gaps, 'gap')} longer than {stated}, longest {steps.max() * 1e-9:.6g} s; cut there")
    bounds = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(times)]
    segments = tuple(slice(a, b) for a, b in itertools.pairwise(bounds) if b - a >= 2)
    if not segments:
        raise InputError(source, "no two samples without a gap between them", "a stretch of samples")

    def chosen(name: str) -> Column | None:
        column = values.get(name)
        return column if column is None or whole else column[kept]

    position, torque = chosen("position"), chosen("torque")
    assert position is not None  # _usable has raised otherwise
    assert torque is not None
    exogenous = {name: column for name in signals.exogenous if (column := chosen(name)) is not None}
    seconds = (times - times[0]) / 1e9
    period = clock.usual_period(base.times if log is None else log[0]) * 1e-9
    own = None if log is None or len(log[0]) < 2 else np.vstack([(log[0] - times[0]) / 1e9, log[1]])
    return Recording(
        seconds, position, torque, chosen("velocity"), chosen("temperature"), chosen("reference"),
        exogenous, segments, source, tuple(told), int(times[0]), signals.torque_unit, own,
        signals.torque.acts_after(period),
    )  # fmt: skip
