"""One strictly increasing time from the stamps that messages carry: order, duplicates, clock jumps, gaps."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.recording.columns import Mask, Nanoseconds, counted

JUMP = 1_000_000_000
"""ns; a stamp that goes back by more is a clock that was set, not a message that came late."""

FAR = 1 << 61
"""ns; beyond the 32-bit seconds of a stamp and before differences overflow. Only damage has such times."""

STRAY_RUN = 5
"""Messages; a shorter run on a clock of its own, with the old clock going on after it, has wrong stamps."""

USABLE = 0.9
"""Share of messages that must be left for the others to be strays; with fewer the clock itself is wild."""

GAP_PERIODS = 10.0
"""A pause longer than this many usual periods is a gap; nothing is interpolated or held across it."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Where the rows of a topic stand in time.

    rows: (m,) indices into the topic's rows, in time order. times: (m,) ns, strictly increasing.
    restarts: indices into `rows` where a set clock begins anew. notes: what was found, without the topic's name.
    """

    rows: NDArray[np.intp]
    times: Nanoseconds
    restarts: tuple[int, ...]
    notes: tuple[str, ...]


def empty_stamps(stamps: Nanoseconds) -> int:
    """How many stamps of a topic were never set. A simulated clock begins at 0: there 0 is a time, for others follow close."""
    empty = int(np.count_nonzero(stamps <= 0))
    if not empty or empty == len(stamps) or stamps.min() < 0:
        return empty
    return 0 if stamps[stamps > 0].min() < JUMP else empty


def timeline(stamps: Nanoseconds, log_times: Nanoseconds) -> Timeline:
    """Put rows in order: drop stray and duplicate stamps, sort late ones, carry on over clocks set back.

    stamps, log_times: (n,) ns in the order of the file. The log times tell stretches of the file that stand in another order from
    a clock that was set back, stray stamps at either end from a pause, and how long the pause was at which a clock was set.
    """
    notes: list[str] = []
    stamps, log_times = np.clip(stamps, -FAR, FAR), np.clip(log_times, -FAR, FAR)
    rows = np.arange(len(stamps))
    if len(stamps) < 2:
        return Timeline(rows, stamps, (), ())
    if not np.all(stamps[1:] > stamps[:-1]):
        order = _logged_order(log_times)
        if order is None:
            return Timeline(*_straighten(stamps, log_times, notes), tuple(notes))
        notes.append("stretches of the file stand in another order than they were logged in, sorted")
        rows, stamps, log_times = order, stamps[order], log_times[order]
        if not np.all(stamps[1:] > stamps[:-1]):
            chosen, times, restarts = _straighten(stamps, log_times, notes)
            return Timeline(rows[chosen], times, restarts, tuple(notes))
    fine = _without_stray_ends(stamps, log_times)
    if not fine.all():
        notes.append(_strays(int(np.count_nonzero(~fine))))
        rows, stamps = rows[fine], stamps[fine]
    return Timeline(rows, stamps, (), tuple(notes))


def _logged_order(log_times: Nanoseconds) -> NDArray[np.intp] | None:
    """Rows in the order of logging, None if the file has that order or a clock was set back.

    mcap allows chunks in any order. Stretches that only stand elsewhere do not overlap, and once they are sorted leave no
    longer pause than the file has. A clock that was set back goes over the same times again, or leaves a pause that was none.
    """
    steps = np.diff(log_times)
    if not np.any(steps < 0):
        return None
    starts = np.concatenate(([0], np.flatnonzero((steps < 0) | (steps > gap_limit(log_times))) + 1))
    stops = np.concatenate((starts[1:], [len(log_times)]))
    order = np.argsort(log_times[starts], kind="stable")
    pauses = log_times[starts[order[1:]]] - log_times[stops[order[:-1]] - 1]
    if np.any(pauses < 0) or np.any(pauses > max(JUMP, int(steps.max()))):
        return None
    rows = np.arange(len(log_times))
    return np.concatenate([rows[starts[k] : stops[k]] for k in order])


def _strays(count: int) -> str:
    return f"{counted(count, 'message')} with stray stamps left out"


def _without_stray_ends(stamps: Nanoseconds, log_times: Nanoseconds) -> Mask:
    """True but for a short run at either end of rising stamps that a jump parts from the rest which the log times do not show."""
    fine = np.ones(len(stamps), dtype=np.bool_)
    if len(stamps) <= 4 * STRAY_RUN:
        return fine
    edge = STRAY_RUN + 1
    far = np.flatnonzero(np.diff(stamps[:edge]) - np.diff(log_times[:edge]) > JUMP)
    if len(far):
        fine[: int(far[-1]) + 1] = False
    far = np.flatnonzero(np.diff(stamps[-edge:]) - np.diff(log_times[-edge:]) > JUMP)
    if len(far):
        fine[len(stamps) - STRAY_RUN + int(far[0]) :] = False
    return fine


def _straighten(
    stamps: Nanoseconds, log_times: Nanoseconds, notes: list[str]
) -> tuple[NDArray[np.intp], Nanoseconds, tuple[int, ...]]:
    rows = _without_strays(stamps, log_times)
    if len(rows) < len(stamps):
        notes.append(_strays(len(stamps) - len(rows)))
    times = stamps[rows].copy()
    period = usual_period(np.sort(times))
    starts = [0, *(np.flatnonzero(np.diff(times) < -JUMP) + 1), len(rows)]
    ordered: list[NDArray[np.intp]] = []
    restarts: list[int] = []
    late = duplicates = kept = 0
    last = 0
    for number, (start, stop) in enumerate(itertools.pairwise(starts)):
        part = times[start:stop]
        if number:
            pause = max(int(log_times[rows[start]] - log_times[rows[start - 1]]), period)
            if last + pause + int(part.max()) - int(part[0]) > 2 * FAR:
                notes.append(f"{counted(len(rows) - start, 'message')} with impossible stamps left out")
                break
            part += last + pause - part[0]
            restarts.append(kept)
        order = np.argsort(part, kind="stable")
        late += int(np.count_nonzero(part < np.maximum.accumulate(part)))
        part[:] = part[order]
        fresh = np.concatenate(([True], np.diff(part) > 0))
        if number:
            fresh &= part > last
        duplicates += int(len(part) - np.count_nonzero(fresh))
        chosen = start + np.flatnonzero(fresh)
        ordered.append(np.column_stack((rows[start + order[fresh]], times[chosen])))
        kept += len(chosen)
        last = int(part[-1])
    if late:
        notes.append(f"{counted(late, 'message')} out of order, sorted by stamp")
    if duplicates:
        notes.append(f"{counted(duplicates, 'message')} with a stamp seen before left out")
    if restarts:
        often = "once" if len(restarts) == 1 else f"{len(restarts)} times"
        notes.append(f"clock set back {often}; time carried on by the log time there, recording cut")
    table = np.concatenate(ordered)
    return table[:, 0], table[:, 1], tuple(restarts)


def _without_strays(stamps: Nanoseconds, log_times: Nanoseconds) -> NDArray[np.intp]:
    """Rows without short runs that leave the clock and are followed by the old clock going on.

    They leave it by more than JUMP, or come from the future: they are logged sooner after their stamp than the quickest of the
    others by more than a gap, and by more than the quick ones come before the usual ones.
    """
    steps = np.diff(stamps)
    latency = log_times - stamps
    quick, usual = np.quantile(latency, (1.0 - USABLE, 0.5))
    ahead = latency < quick - max(gap_limit(np.sort(stamps)), usual - quick)
    edges = np.flatnonzero((np.abs(steps) > JUMP) | (ahead[1:] != ahead[:-1])) + 1
    keep = np.ones(len(stamps), dtype=np.bool_)
    bounds = [0, *edges.tolist(), len(stamps)]
    anchor: int | None = None  # last stamp of the last run that was kept
    for index, (start, stop) in enumerate(itertools.pairwise(bounds)):
        following = int(stamps[stop]) if stop < len(stamps) else None
        short = stop - start <= STRAY_RUN and len(bounds) > 2
        at_edge = start == 0 or following is None
        if at_edge and len(bounds) > 3 and abs(latency[start] - usual) <= JUMP and not ahead[start]:
            short = False  # it is of the same clock as the others, and what follows it or came before is astray
        if short and _goes_on(anchor, following, index == 0, len(stamps)):
            keep[start:stop] = False
        else:
            anchor = int(stamps[stop - 1])
    if np.count_nonzero(keep) < USABLE * len(keep):
        return np.arange(len(stamps))
    return np.flatnonzero(keep)


def _goes_on(before: int | None, after: int | None, first: bool, count: int) -> bool:
    """Whether the clock before a short run goes on after it; a short run at either end stands alone."""
    if first or before is None or after is None:
        return count > 4 * STRAY_RUN
    return abs(after - before) <= JUMP


def usual_period(times: Nanoseconds) -> int:
    """The median step between different times, ns; 0 with fewer than two."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    return int(np.median(steps)) if len(steps) else 0


def gap_limit(times: Nanoseconds) -> int:
    """The longest step, ns, that is not yet a gap."""
    return int(GAP_PERIODS * usual_period(times))


def dropped(times: Nanoseconds, period: int | None = None) -> int:
    """How many messages are missing between rising times, 0 where the rate is not steady enough to say.

    period: the usual one, ns, where it is known.
    """
    period = usual_period(times) if period is None else period
    if not period:
        return 0
    steps = np.diff(times) / period
    if np.mean(np.abs(steps - 1.0) < 0.25) < 0.8:
        return 0
    return int(np.sum(np.maximum(np.rint(steps[steps > 1.5]) - 1.0, 0.0)))
