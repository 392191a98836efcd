"""The curves of one axis: from the samples that a node heard to bins for every length of window.

The node's thread appends to the histories. All else happens in the page's thread: `advance` takes what has come since.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tcs_friction.control.stamps import SECOND
from tcs_friction.live.bins import Bins, Extremes, thinned
from tcs_friction.live.history import History, Rows, Stamps
from tcs_friction.live.joining import Join
from tcs_friction.live.trail import Trail
from tcs_friction.nodes.page.state import TOPICS

WINDOWS = (5, 20, 60, 240)
"""Lengths of the windows, s."""
BINS = 500
"""Bins of a window: as many as a plot has columns to draw them."""
SLACK = SECOND // 2
"""Stamps that go back by more than this, ns, begin another run; what goes back by less is left out."""
AWAY = max(WINDOWS) * SECOND
"""So does a step forward of more than this: a graph with another clock, such as one in real time after one in lock-step."""
ERROR = "error"
JUDGED_MOST = 20_000
"""Samples of which the tracking error is judged at most: 5 s at 4 kHz."""
STATES, REFERENCE, ESTIMATE, COMPENSATION = "joint_states", "reference", "friction_estimate", "friction_compensation"


@dataclass(frozen=True)
class Curve:
    """A curve of the page: where its numbers come from."""

    channel: str
    column: int


CURVES: Mapping[str, Curve] = {
    "error": Curve(ERROR, 0),
    "speed": Curve(STATES, 1),
    "reference_speed": Curve(REFERENCE, 1),
    "torque_command": Curve("torque_command", 0),
    "torque_applied": Curve(STATES, 2),
    "friction_estimate": Curve(ESTIMATE, 0),
    "friction_compensation": Curve(COMPENSATION, 0),
}


class Channel:
    """One topic, or what is computed from two: its history and its bins."""

    def __init__(self, columns: int) -> None:
        self.history = History(columns)
        self.bins = {window: Bins(window * SECOND // BINS, columns, BINS) for window in WINDOWS}
        self._taken = 0
        self._last = -1

    def clear(self) -> None:
        """Forget the bins; what comes is another run."""
        for bins in self.bins.values():
            bins.clear()

    def take(self) -> tuple[bool, Stamps, Rows]:
        """What has come since the last call, with ascending stamps, and whether a new run begins with it."""
        first, stamps, values = self.history.since(self._taken)
        self._taken = first + len(stamps)
        before = np.concatenate(([self._last], stamps[:-1])) if len(stamps) else stamps
        anew = np.flatnonzero((stamps < before - SLACK) | ((before >= 0) & (stamps > before + AWAY)))
        begun = bool(len(anew))
        if begun:
            stamps, values = stamps[anew[-1] :], values[anew[-1] :]
            self.clear()
            self._last = -1
        new = np.diff(np.maximum.accumulate(stamps), prepend=self._last) > 0
        new &= stamps > self._last
        stamps, values = stamps[new], values[new]
        if len(stamps):
            self._last = int(stamps[-1])
        for bins in self.bins.values():
            bins.add(stamps, values)
        return begun, stamps, values


class Traces:
    """All curves of one axis. `run` counts the runs, `now` is the newest stamp (ns), -1 before the first."""

    def __init__(self) -> None:
        self.channels = {topic: Channel(columns) for topic, columns in TOPICS.items()} | {ERROR: Channel(1)}
        self.trails = {ESTIMATE: Trail(), COMPENSATION: Trail()}
        self.run = 0
        self.now = self.begun = -1
        self._tracking = Join(TOPICS[STATES], TOPICS[REFERENCE])
        self._feedforward = Join(TOPICS[REFERENCE], TOPICS[COMPENSATION])

    def advance(self) -> int:
        """Take what has come; the number of samples."""
        new = {STATES: self.channels[STATES].take()}
        if new[STATES][0]:
            self._forget()
        new |= {topic: self.channels[topic].take() for topic in TOPICS if topic != STATES}
        if any(begun for begun, *_ in new.values()):
            self.run += 1
            self._tracking.clear()
            self._feedforward.clear()
        stamps = new[STATES][1]
        if len(stamps):
            self.now = int(stamps[-1])
            self.begun = int(stamps[0]) if self.begun < 0 else self.begun
        self._derive(new[STATES][1:], new[REFERENCE][1:], new[COMPENSATION][1:])
        estimate = new[ESTIMATE][2]
        self.trails[ESTIMATE].add(new[ESTIMATE][1], estimate[:, 1], estimate[:, 0])
        return sum(len(stamps) for _, stamps, _ in new.values())

    def _forget(self) -> None:
        """The states' stamps went back, so what was heard of the other topics is of the run before."""
        self.begun = -1
        for name, channel in self.channels.items():
            if name != STATES:
                channel.clear()
        for trail in self.trails.values():
            trail.clear()

    def _derive(self, states: tuple[Stamps, Rows], reference: tuple[Stamps, Rows], torque: tuple[Stamps, Rows]) -> None:
        """Tracking error, and the compensation with the speed that it is for."""
        stamps, is_at, should = self._tracking.add(states, reference)
        error = self.channels[ERROR]
        for stamp, value in zip(stamps.tolist(), (should[:, 0] - is_at[:, 0]).tolist(), strict=True):
            error.history.append(stamp, value)
        error.take()
        stamps, should, torques = self._feedforward.add(reference, torque)
        switched_on = torques[:, 0] != 0.0
        self.trails[COMPENSATION].add(stamps[switched_on], should[switched_on, 1], torques[switched_on, 0])

    def bins(self, curve: str, window: int, first: int) -> Extremes:
        """The bins of a curve from number `first` on, with one column."""
        chosen = CURVES[curve]
        found = self.channels[chosen.channel].bins[window].since(first)
        own = slice(chosen.column, chosen.column + 1)
        return Extremes(found.number, found.low[:, own], found.high[:, own])

    def detail(self, curve: str, begin: int, end: int) -> tuple[int, Extremes]:
        """A curve between two stamps (ns) in as many bins as a window has: their width (ns), and the bins.

        From the samples where they are still there, else from the finest bins that reach so far back.
        """
        chosen = CURVES[curve]
        channel, own = self.channels[chosen.channel], slice(chosen.column, chosen.column + 1)
        if channel.history.oldest() <= begin:
            stamps, values = channel.history.between(begin, end)
            return thinned(stamps, values[:, own], BINS)
        reaching = [window for window in WINDOWS if self.now - window * SECOND <= begin]
        bins = channel.bins[(reaching or WINDOWS[-1:])[0]]
        found = bins.since(begin // bins.width)
        inside = found.number <= end // bins.width
        return bins.width, Extremes(found.number[inside], found.low[inside, own], found.high[inside, own])

    def error_rms(self, seconds: float) -> float | None:
        """RMS tracking error (rad) over the newest `seconds`, None while there is none."""
        begin = self.now - round(seconds * SECOND)
        _, values = self.channels[ERROR].history.between(begin, self.now, JUDGED_MOST)
        return float(np.sqrt(np.mean(values[:, 0] ** 2))) if len(values) else None

    def newest(self, topic: str) -> list[float]:
        """The newest sample of a topic, [] before the first."""
        history = self.channels[topic].history
        _, _, values = history.since(history.count - 1)
        return [float(value) for value in values[-1]] if len(values) else []
