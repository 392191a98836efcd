"""The columns of several topics, each on its own clock and rate, become one Recording.

The time base is the position topic's. Signals of the same messages are taken as they are. Torque from another
topic is held from one message to the next, as the drive holds it; the other signals are interpolated linearly.
Neither is carried over a gap (clock.GAP_PERIODS usual periods of that topic, at least SLOW for temperature).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording import clock
from tcs_friction.recording.columns import Mask, Nanoseconds, TopicColumns, counted
from tcs_friction.recording.frozen import frozen
from tcs_friction.recording.mending import mended
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.stamps import stamped
from tcs_friction.recording.time_base import TimeBase, of_one_publisher, on_base_clock, time_base
from tcs_friction.recording.unwrap import refuse_other_unit, unwrapped

SLOW = 60_000_000_000
"""ns; over this long a temperature may be interpolated or held whatever its rate."""

MOST = 0.5
"""An optional signal that lacks more than this share of the samples is left out instead of cutting the recording down."""

SIMULTANEOUS = 0.05
"""Share of a period by which clocks may disagree about one instant; without it rounding would delay by a period."""


def align(columns: Mapping[str, TopicColumns], signals: SignalMap, source: str, notes: Sequence[str] = ()) -> Recording:
    """One recording from the columns of every topic that `signals` names.

    Raises InputError when a needed signal has no usable samples, and when nobody can tell the clock, the publisher or the turns.
    """
    told = list(notes)
    base = time_base(columns[signals.position.topic], signals, source, told)
    fine = np.ones(len(base.times), dtype=np.bool_)
    values: dict[str, Column | None] = {}
    log: tuple[Nanoseconds, Column] | None = None
    for name, signal in signals.named():
        needed = name in ("position", "torque")
        if signal.topic == base.columns.topic:
            column = base.columns.values[signal][base.rows]
        else:
            column, own = _from_other_topic(base, columns[signal.topic], name, signal, source, told)
            log = own if name == "torque" else log
        values[name] = _usable(column, fine, name, signal, needed, source, told)
    passed, cuts = _made_continuous(base, values, source, told)
    _without_frozen(base, fine, values, told)
    return _cut(base, fine, passed, sorted({*base.restarts, *cuts}), values, signals, source, told, log)


def _made_continuous(
    base: TimeBase, values: dict[str, Column | None], source: str, told: list[str]
) -> tuple[Mask | None, tuple[int, ...]]:
    """Position, velocity and reference across wraps, in place; which samples are to be passed over, and where the zero is new."""
    position, velocity, reference = (values.get(name) for name in ("position", "velocity", "reference"))
    assert position is not None  # _usable has raised otherwise
    good = np.flatnonzero(np.isfinite(position))
    whole = len(good) == len(position)
    found = (
        unwrapped(base.seconds, position, velocity, source) if whole
        else unwrapped(base.seconds[good], position[good], None if velocity is None else velocity[good], source)
    )  # fmt: skip
    refuse_other_unit(found.modulus, source)
    told.extend(map(mended, found.notes))

    def spread(column: Column | None, old: Column | None) -> Column | None:
        if whole or column is None or old is None:
            return column
        new = old.copy()
        new[good] = column
        return new

    if found.modulus:
        values["position"], values["velocity"] = spread(found.position, position), spread(found.velocity, velocity)
        if reference is not None:
            values["reference"] = spread(found.beside(reference if whole else reference[good]), reference)
    passed = np.zeros(len(position), dtype=np.bool_) if found.spikes.any() else None
    if passed is not None:
        passed[good[found.spikes]] = True
    return passed, tuple(int(good[cut]) for cut in found.cuts)


def _without_frozen(base: TimeBase, fine: Mask, values: Mapping[str, Column | None], told: list[str]) -> None:
    """Mark the samples as cut in which the position is only repeated."""
    position = values["position"]
    assert position is not None  # _usable has raised otherwise
    repeated, notes = frozen(base.seconds, position, values.get("velocity"), base.restarts)
    told.extend(map(mended, notes))
    if repeated is not None:
        fine &= ~repeated


def _from_other_topic(
    base: TimeBase, columns: TopicColumns, name: str, signal: SignalSource, source: str, told: list[str]
) -> tuple[Column, tuple[Nanoseconds, Column] | None]:
    """The signal at the times of the base, and as it was recorded, on the clock of the base."""
    values = columns.values[signal]
    usable = np.isfinite(values)
    if not usable.all() and usable.any():
        told_of = f"{name}: {np.count_nonzero(~usable)} samples of {signal} are not finite or absent, left out"
        others = columns.absent.get(signal)  # messages about other joints lack nothing
        told.append(told_of if others is not None and others[~usable].all() else mended(told_of))
    if not usable.any():
        return np.full(len(base.times), np.nan), None
    chosen = stamped(columns, source, told)
    headers = chosen is None or bool(chosen.any())
    if chosen is not None and headers:
        usable &= chosen
    rows = np.flatnonzero(usable)
    stamps = columns.stamps if headers and columns.stamps is not None else columns.log_times
    if name == "torque":
        rows = of_one_publisher(columns, {name: signal}, stamps, rows, source, told)
    line = clock.timeline(stamps[rows], columns.log_times[rows])
    told.extend(mended(f"{columns.topic}: {note}") for note in line.notes)
    rows = rows[line.rows]
    times = on_base_clock(base, columns, line.times, columns.log_times[rows], headers, source, told)
    limit = clock.gap_limit(times)
    if name == "temperature":
        limit = max(limit, SLOW)
    if name == "torque":
        told.append(f"torque: held from {columns.topic} onto the times of {base.columns.topic}")
        return held(base.times, times, values[rows], limit), (times, values[rows])
    told.append(f"{name}: interpolated from {columns.topic} onto the times of {base.columns.topic}")
    return interpolated(base.times, times, values[rows], limit), (times, values[rows])


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
        told.append(mended(f"{name}: no finite sample in {signal} within the recording, left out"))
        return None
    if not needed and bad > MOST * len(column):
        told.append(mended(f"{name}: {bad} of {len(column)} samples missing or not finite, signal left out"))
        return None
    told.append(mended(f"{name}: {bad} of {len(column)} samples missing or not finite, cut as gaps"))
    fine &= finite
    return column


def _cut(
    base: TimeBase, fine: Mask, passed: Mask | None, cuts: Sequence[int], values: dict[str, Column | None],
    signals: SignalMap, source: str, told: list[str], log: tuple[Nanoseconds, Column] | None,
) -> Recording:  # fmt: skip
    """The samples that are fine, in segments: cut where others are missing, save those that are to be passed over."""
    period = clock.usual_period(base.times)
    limit = int(clock.GAP_PERIODS * period)
    kept = np.flatnonzero(fine if passed is None else fine & ~passed)
    whole = len(kept) == len(fine)
    if len(kept) < 2:
        raise InputError(source, f"{len(kept)} samples with position and torque", "at least 2")
    times = base.times if whole else base.times[kept]
    steps = np.diff(times)
    breaks = steps > limit
    if not whole:
        breaks |= np.diff(np.cumsum(~fine)[kept]) > 0
    for cut in cuts:
        after = int(np.searchsorted(kept, cut))
        if 0 < after < len(kept):
            breaks[after - 1] = True
    if missing := clock.dropped(base.times, period):
        told.append(f"{base.columns.topic}: {counted(missing, 'message')} missing at the usual period of {period * 1e-9:.6g} s")
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
    seconds = base.seconds if whole else (times - times[0]) / 1e9
    held_for = (period if log is None else clock.usual_period(log[0])) * 1e-9
    own = None if log is None or len(log[0]) < 2 else np.vstack([(log[0] - times[0]) / 1e9, log[1]])
    return Recording(
        seconds, position, torque, chosen("velocity"), chosen("temperature"), chosen("reference"),
        exogenous, segments, source, tuple(told), int(times[0]), signals.torque_unit, own,
        signals.torque.acts_after(held_for),
    )  # fmt: skip
