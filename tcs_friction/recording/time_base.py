"""The time base of a recording: the messages of the position's topic, of one publisher, and how other clocks run beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording import clock
from tcs_friction.recording.columns import Nanoseconds, TopicColumns
from tcs_friction.recording.mending import mended
from tcs_friction.recording.publishers import Said, of_the_axis
from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.stamps import SAME_PACE, Pace, pace, stamped

OTHER_CLOCK = 1_000_000_000
"""ns; topics whose header clocks differ by more (seen through the log time) are not on the same clock."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """The time base: rows of the position topic in order, their times, and how those run beside the log times."""

    columns: TopicColumns
    rows: NDArray[np.intp] | slice
    times: Nanoseconds
    restarts: tuple[int, ...]
    headers: bool

    @cached_property
    def seconds(self) -> Column:
        """The times from the first on, s."""
        return (self.times - self.times[0]) / 1e9

    @cached_property
    def pace(self) -> Pace:
        return pace(self.times, self.columns.log_times[self.rows])


def time_base(columns: TopicColumns, signals: SignalMap, source: str, told: list[str]) -> TimeBase:
    """Of the messages that have the joint and a stamp of one clock, and that one publisher said; `told` gets what was done.

    Raises InputError when there are fewer than two, and when nobody can tell the clock or the publisher.
    """
    position = signals.position
    rows = np.arange(len(columns))
    if position in columns.absent:
        rows = np.flatnonzero(~columns.absent[position])
        left_out = len(columns) - len(rows)
        told.append(f"{columns.topic}: {left_out} messages without joint {position.joint} passed over")
    chosen = stamped(columns, source, told)
    headers = chosen is None or bool(chosen.any())
    if chosen is not None and headers:
        rows = rows[chosen[rows]]
    stamps = columns.stamps if headers and columns.stamps is not None else columns.log_times
    told.append(f"time base: {'header stamps' if headers else 'log times'} of {columns.topic}")
    parts = {"position": position, "velocity": signals.velocity, "torque": signals.torque}
    rows = of_one_publisher(columns, parts, stamps, rows, source, told)
    whole = len(rows) == len(columns)
    line = clock.timeline(stamps, columns.log_times) if whole else clock.timeline(stamps[rows], columns.log_times[rows])
    told.extend(mended(f"{columns.topic}: {note}") for note in line.notes)
    if len(line.times) < 2:
        raise InputError(source, f"{len(line.times)} messages with {position}", "at least 2")
    untouched = whole and not line.notes  # nothing left out or sorted: no copies
    base = TimeBase(columns, slice(None) if untouched else rows[line.rows], line.times, line.restarts, headers)
    if headers and (found := base.pace).drifts and abs(found.rate - 1.0) > SAME_PACE:
        told.append(f"{columns.topic}: header stamps run {found}")
    return base


def of_one_publisher(
    columns: TopicColumns, parts: Mapping[str, SignalSource | None], stamps: Nanoseconds, rows: NDArray[np.intp],
    source: str, told: list[str],
) -> NDArray[np.intp]:  # fmt: skip
    """The rows that one publisher of the joint said."""
    here = {name: part for name, part in parts.items() if part is not None and part.topic == columns.topic}
    if len(rows) == len(columns):
        said = Said(stamps, columns.log_times, {name: columns.values[part] for name, part in here.items()})
    else:
        signals = {name: columns.values[part][rows] for name, part in here.items()}
        said = Said(stamps[rows], columns.log_times[rows], signals)
    joint = next(iter(here.values())).joint
    whose = f"{columns.topic} (joint {joint})" if joint is not None else columns.topic
    kept = of_the_axis(said, whose, source, told)
    return rows if kept is None else rows[kept]


def on_base_clock(
    base: TimeBase, columns: TopicColumns, times: Nanoseconds, log_times: Nanoseconds, headers: bool, source: str, told: list[str]
) -> Nanoseconds:
    """Times of another topic on the clock of the base; the log time is the bridge between two clocks.

    Raises InputError where one of the clocks does not keep its pace beside the log times, so that they are no bridge.
    """
    topic, main, own = columns.topic, base.pace, pace(times, log_times)
    for name, paced in ((base.columns.topic, main), (topic, own)):
        if paced.drifts and not paced.steady:
            found = f"header stamps of {name} and log times do not keep pace, and {topic} has no stamps of the same clock"
            if not headers or abs(own.shift - main.shift) > OTHER_CLOCK:
                raise InputError(source, found, "header stamps of one clock in both")
    if headers and base.headers and abs(own.shift - main.shift) <= OTHER_CLOCK:
        return times
    if not headers and not base.headers:
        return times
    moved = f"moved by {(main.shift - own.shift) * 1e-9:+.6f} s"
    scaled = main.drifts or own.drifts
    if scaled:
        moved = f"{moved} and run {main.rate / own.rate:.4g} times as fast"
    if headers:
        told.append(mended(f"{topic}: header stamps on another clock, {moved} to match the log times"))
    else:
        note = f"{topic}: log times, {moved}, the usual latency of {base.columns.topic}"
        told.append(mended(note) if scaled else note)
    return main.at(own.log_of(times))
