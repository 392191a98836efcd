"""Several publishers of one joint on one topic: whose messages are which, and which of them is the axis.

As in the nodes (`control/stamps.py`, `nodes/core/rivals.py`), a second publisher is known by what it says: messages between the
others whose position cannot have been reached and is left again at once, or which say one and the same torque between others, and
stamps of a second clock. A reading that is wrong stands in the place of a right one; a publisher's message stands between two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording import clock, kernels
from tcs_friction.recording.columns import Mask, Nanoseconds, counted
from tcs_friction.recording.mending import mended
from tcs_friction.recording.recording import Column

STRANGE = 3
"""Messages that cannot follow the others from which on it is a publisher (control/stamps.py: AnswerRule.STRANGE)."""
APART = 10.0
"""Times the usual difference of a signal from message to message, beyond which it does not follow."""
BETWEEN = 1.5
"""Usual steps of time from the message before to the one after: below, the one between has no place of its own."""
OFTEN = 0.1
"""Share of the messages from which on they are no accident, whatever their stamps (clock.USABLE)."""
FILLING = 0.9
"""Of the range: where all jumps are as large, the position wraps (unwrap.py)."""
MOST = 4
"""Publishers that are told apart, one after the other."""
FEWEST = 4
"""Messages of which one may be a stranger to the others."""
BLOCKS, BLOCK = 64, 256
"""Stretches of messages that are looked at first, and how long they are: a publisher that says as much as the other for a
sixty-fourth of the recording is seen in them, one that says less by its stamps."""
UNEVEN = 0.002
"""Share of the steps of time that are short before all messages are looked at: one in 500 has no place of its own."""


@dataclass(frozen=True, eq=False)
class Said:
    """What the messages of a topic say of one joint, in the order of the file. times, log_times: (n,) ns.

    signals: (n,) each, NaN where a message has none. Position first; velocity and torque where they are in the same messages.
    """

    times: Nanoseconds
    log_times: Nanoseconds
    signals: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.times)

    def of(self, chosen: Mask | NDArray[np.intp]) -> Said:
        """Some of the messages."""
        signals = {name: values[chosen] for name, values in self.signals.items()}
        return Said(self.times[chosen], self.log_times[chosen], signals)


def of_the_axis(said: Said, whose: str, where: str, told: list[str]) -> Mask | None:
    """Which messages are of the axis, None for all. whose: `joint x on /topic`, for `told`.

    Raises InputError (about `where`) if there are several publishers, and not exactly one says a motion and a torque.
    """
    kept: NDArray[np.intp] | None = None
    for _ in range(MOST):
        now = said if kept is None else said.of(kept)
        with np.errstate(over="ignore", invalid="ignore"):  # of damage that is beyond all numbers
            second = _another(now)
        if second is None:
            break
        chosen, words = _choice(now, second, whose, where)
        told.append(mended(words))
        kept = np.flatnonzero(chosen) if kept is None else kept[chosen]
    if kept is None:
        return None
    mask = np.zeros(len(said), dtype=np.bool_)
    mask[kept] = True
    return mask


def _another(said: Said) -> Mask | None:
    """The messages of a second publisher, None if there is none."""
    second = _without_torque(said)
    if second is not None or not _suspicious(said):
        return second
    second = _of_another_clock(said)
    if second is not None:
        return second
    order = _in_time(said.times)
    found = _contradicting(said if order is None else said.of(order))
    if found is None or order is None:
        return found
    second = np.zeros(len(said), dtype=np.bool_)
    second[order] = found
    return second


def _in_time(times: Nanoseconds) -> NDArray[np.intp] | None:
    """Late messages in their place, each with its own clock where that was set back; None if no message is late."""
    steps = np.diff(times)
    if not np.any(steps < 0):
        return None
    return np.lexsort((times, np.concatenate(([0], np.cumsum(steps < -clock.JUMP)))))


def _choice(said: Said, second: Mask, whose: str, where: str) -> tuple[Mask, str]:
    """The publisher that moves and says a torque, and what is told of that."""
    lacking = [_lacks(said.of(one)) for one in (~second, second)]
    numbers = [int(np.count_nonzero(one)) for one in (~second, second)]
    if bool(lacking[0]) == bool(lacking[1]):
        both = f"both with {' and '.join(_needed(said))}" if not lacking[0] else f"{lacking[0]} in one, {lacking[1]} in the other"
        found = f"{numbers[0]} and {numbers[1]} messages of two publishers of {whose} that contradict each other, {both}"
        raise InputError(where, found, "one publisher of a joint")
    out = 0 if lacking[0] else 1
    words = f"{whose}: {counted(numbers[out], 'message')} of a second publisher, with {lacking[out]}, left out"
    return (second if out == 0 else ~second), words


def _needed(said: Said) -> list[str]:
    return [{"position": "motion"}.get(name, name) for name in said.signals if name != "velocity"]


def _lacks(said: Said) -> str:
    """What a publisher does not say, "" if it says motion and torque."""
    for name, values in said.signals.items():
        fine = values[np.isfinite(values)]
        if name != "velocity" and (not len(fine) or np.ptp(fine) == 0.0):
            return "no motion" if name == "position" else f"no {name}"
    return ""


def _without_torque(said: Said) -> Mask | None:
    """Messages without position or torque that stand between others: where they are left out, no message is missing."""
    lacking = np.zeros(len(said), dtype=np.bool_)
    for name, values in said.signals.items():
        if name != "velocity":
            lacking |= ~np.isfinite(values)
    if not STRANGE <= np.count_nonzero(lacking) <= len(said) - STRANGE:
        return None
    whole = np.flatnonzero(~lacking)
    steps = np.diff(said.times[whole])
    across = steps[np.diff(whole) > 1]
    fine = across < BETWEEN * clock.usual_period(said.times[whole])
    return lacking if len(across) and np.mean(fine) >= 1.0 - OFTEN else None


def _of_another_clock(said: Said) -> Mask | None:
    """Messages whose stamps are of a clock of their own, which goes on whenever they come; None if all are of one."""
    apart = said.log_times - said.times
    if np.count_nonzero(np.abs(np.diff(apart)) > clock.JUMP) < 2 * STRANGE:
        return None
    ordered = np.sort(apart)
    widest = int(np.argmax(np.diff(ordered)))
    second = apart > ordered[widest]
    fewest = min(np.count_nonzero(second), np.count_nonzero(~second))
    if fewest < max(STRANGE, OFTEN * len(second)):
        return None
    rising = [np.mean(np.diff(said.times[one]) >= 0) for one in (second, ~second)]
    return second if min(rising) >= 1.0 - OFTEN else None


def _suspicious(said: Said) -> bool:
    """A quick look: are some messages without a place in time, or do some of a few stretches not follow each other."""
    steps = np.diff(said.times)
    some = steps[:: max(1, len(steps) // (BLOCKS * BLOCK))]
    if not np.any(some > 0):
        return False
    usual = np.median(some[some > 0])
    if np.count_nonzero(steps < 0.75 * usual) > max(STRANGE - 1, UNEVEN * len(steps)):
        return True
    if len(said) < FEWEST:
        return False
    starts = np.unique(np.linspace(0, max(0, len(said) - BLOCK), BLOCKS).astype(int))
    rows = starts[:, None] + np.arange(min(BLOCK, len(said)))
    for values in said.signals.values():
        over, nearest, smaller = _sizes(values[rows])
        counts = np.count_nonzero((over < 0.5 * smaller) & (smaller > APART * _usual_of_rows(nearest)), axis=1)
        if counts.sum() >= STRANGE and counts.max() >= OFTEN * rows.shape[1]:
            return True
    return False


def _usual_of_rows(nearest: Column) -> Column:
    """(n, 1): the median of each row of what is above 0, 0 where nothing is; a tenth of the time of a loop of medians."""
    count = np.count_nonzero(nearest > 0.0, axis=1)
    ordered = np.sort(np.where(nearest > 0.0, nearest, np.inf), axis=1)
    each = np.arange(len(nearest))
    middle = 0.5 * (ordered[each, np.maximum(count - 1, 0) // 2] + ordered[each, np.minimum(count // 2, nearest.shape[1] - 1)])
    return np.where(count > 0, middle, 0.0)[:, None]


def _sizes(values: Column) -> tuple[Column, Column, Column]:
    """Of each message but the ends, along the last axis: between its neighbours, to the nearer one, the smaller of the steps."""
    steps = np.abs(np.diff(values, axis=-1))
    over = np.abs(values[..., 2:] - values[..., :-2])
    return over, np.fmin(steps[..., 1:], over), np.minimum(steps[..., 1:], steps[..., :-1])


def _strangers(values: Column) -> NDArray[np.intp]:
    """Messages that are far from the one before and the one after, which are close to each other."""
    if len(values) < FEWEST:
        return np.zeros(0, dtype=np.intp)
    over, nearest, smaller = _sizes(values)
    moving = nearest[nearest > 0.0]
    usual = float(np.median(moving)) if len(moving) else 0.0
    return np.flatnonzero((over < 0.5 * smaller) & (smaller > APART * usual)) + 1


def _contradicting(said: Said) -> Mask | None:
    """The messages whose position cannot be reached from the others, or whose torque or velocity never changes between them."""
    for name, values in said.signals.items():
        strange = _strangers(values)
        if name == "position":
            if _are_another(said, strange) and not _wraps(values, strange):
                traced = _traced(said, values, strange)
                if np.count_nonzero(traced) >= STRANGE:
                    return traced
            continue
        if len(strange) < STRANGE:
            continue
        found, counts = np.unique(values[strange], return_counts=True)
        same = values == found[np.argmax(counts)]
        if np.count_nonzero(same[strange]) >= (1.0 - OFTEN) * np.count_nonzero(same) and _are_another(said, np.flatnonzero(same)):
            return same
    return None


def _are_another(said: Said, strange: NDArray[np.intp]) -> bool:
    """Whether messages that do not follow the others are somebody else's: they are many, or come between the others."""
    if len(strange) < STRANGE:
        return False
    if len(strange) > OFTEN * len(said):
        return True
    inner = strange[(strange > 0) & (strange < len(said) - 1)]
    across = said.times[inner + 1] - said.times[inner - 1]
    return bool(np.median(across) < BETWEEN * clock.usual_period(said.times))


def _wraps(position: Column, strange: NDArray[np.intp]) -> bool:
    sizes = np.abs(position[strange] - position[strange - 1])
    return bool(np.median(sizes) > FILLING * np.ptp(position[np.isfinite(position)]))


def _traced(said: Said, position: Column, strange: NDArray[np.intp]) -> Mask:
    """The messages that follow the clearest of the strange ones rather than the one before it."""
    rows = []
    for values in said.signals.values():
        steps = np.abs(np.diff(values))
        nearest = np.fmin(steps[1:], np.abs(values[2:] - values[:-2]))
        moving = nearest[nearest > 0.0]
        scale = float(np.median(moving)) if len(moving) else 1.0
        rows.append(np.where(np.isfinite(values), values, 0.0) / scale)
    clearest = int(strange[np.argmax(np.abs(position[strange] - position[strange - 1]))])
    seconds = (said.times - said.times[0]) * 1e-9
    labels = np.zeros(len(said), dtype=np.bool_)
    kernels.trace_two(np.ascontiguousarray(rows), seconds, clearest, labels)
    return labels if np.count_nonzero(labels) <= len(labels) // 2 else ~labels
