"""One axis as the page shows it: what the node's thread hands over, and what of it each page still has to be sent.

The node's thread only appends and replaces; nothing here waits for it, and it waits for nothing here.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.control.stamps import SECOND
from tcs_friction.control.tracking import ARCSEC
from tcs_friction.live.bins import Extremes
from tcs_friction.live.headline import SILENT_AFTER, Headline, Situation, headline
from tcs_friction.live.results import Results
from tcs_friction.live.traces import BINS, COMPENSATION, CURVES, ESTIMATE, REFERENCE, STATES, WINDOWS, Traces
from tcs_friction.nodes.page.state import Condition, Job, Switches
from tcs_friction.physics.axis import Axis

MOST_NODES, MOST_ORDERS = 60, 8
FORGOTTEN = 300.0  # s after which a node that has gone is no longer listed
JUDGED = 5.0  # s over which the tracking error is judged
SHOWN = ("rate [1/s]", "idle for [s]", "overruns", "inputs refused", "repeats")
"""Values of a report that have a column of their own."""


@dataclass(frozen=True)
class Units:
    """Units of an axis as the page writes them, and what one unit of the tracking error is in rad (m)."""

    error: str
    speed: str
    torque: str
    position: str
    error_size: float


ROTARY = Units("arcsec", "rad/s", "N m", "rad", float(ARCSEC))
LINEAR = Units("µm", "m/s", "N", "m", 1e-6)


def units_of(axis: Axis) -> Units:
    """How the page writes what this axis does."""
    usual = ROTARY if axis.kind == "rotary" else LINEAR
    return replace(usual, torque=axis.unit("N m"))


@dataclass
class Cursor:
    """What a page has been sent: of which run and window, up to which bin of each curve and which point of each trail."""

    window: int = WINDOWS[1]
    run: int = -1
    bins: dict[str, int] = field(default_factory=dict)
    points: dict[str, int] = field(default_factory=dict)
    status: dict[str, Any] = field(default_factory=dict)

    def restart(self, window: int, run: int) -> None:
        """Everything is to be sent anew."""
        self.window, self.run = window, run
        self.bins.clear()
        self.points.clear()


class Hub:
    """A sink for the page's node, and frames for pages."""

    def __init__(self, name: str, units: Units, results: Path, steady: Callable[[], float] = time.monotonic) -> None:
        self.name = name
        self.units = units
        self.results = Results(results)
        self.traces = Traces()
        self._steady = steady
        self._heard = -1.0
        self._states = 0
        self._conditions: dict[str, Condition] = {}
        self._switches, self._job = Switches(), Job()
        self._orders: deque[str] = deque(maxlen=MOST_ORDERS)

    # The node's thread

    def writer(self, topic: str) -> Callable[..., None]:
        """As of Sink."""
        return self.traces.channels[topic].history.append

    def report(self, name: str, condition: Condition) -> None:
        """As of Sink."""
        if name in self._conditions or len(self._conditions) < MOST_NODES:
            self._conditions = {**self._conditions, name: condition}

    def switched(self, switches: Switches) -> None:
        """As of Sink."""
        self._switches = switches

    def told(self, job: Job) -> None:
        """As of Sink."""
        self._job = job

    def next_order(self) -> str:
        """As of Sink."""
        return self._orders.popleft() if self._orders else ""

    # The page's thread

    def order(self, name: str) -> None:
        """One of ORDERS, or with the name of an effect, for the node to carry out."""
        self._orders.append(name)

    def can_cancel(self, name: str) -> bool:
        """Whether the compensator's model has an effect of this name."""
        return any(effect.name == name and effect.asked is not None for effect in self._switches.effects)

    def advance(self) -> None:
        """Take what the node has heard; to be called some 20 times a second."""
        self.traces.advance()
        states = self.traces.channels[STATES].history.count
        if states != self._states:
            self._states, self._heard = states, self._steady()
        now = self._steady()
        if any(now - condition.at > FORGOTTEN for condition in self._conditions.values()):
            self._conditions = {name: c for name, c in self._conditions.items() if now - c.at <= FORGOTTEN}

    def frame(self, cursor: Cursor, window: int) -> dict[str, Any]:
        """What a page lacks, and the cursor moved on. `clear`: what it had is of another run or window."""
        traces = self.traces
        clear = cursor.run != traces.run or cursor.window != window
        if clear:
            cursor.restart(window, traces.run)
        width = window * SECOND // BINS
        bins = {name: self._bins(cursor, name) for name in CURVES}
        return {
            "clear": clear,
            "window": window,
            "width": width / SECOND,
            "zero": max(traces.begun, 0) // width,
            "now": max(traces.now, 0) / width,
            "bins": {name: found for name, found in bins.items() if found["k"]},
            "points": {name: points for name in traces.trails if (points := self._points(cursor, name))},
        }

    def _bins(self, cursor: Cursor, curve: str) -> dict[str, list[Any]]:
        found = self.traces.bins(curve, cursor.window, cursor.bins.get(curve, 0))
        if len(found.number):
            cursor.bins[curve] = int(found.number[-1])  # once more next time: it may not be full
        return self._shown(curve, found)

    def _shown(self, curve: str, found: Extremes) -> dict[str, list[Any]]:
        size = self.units.error_size if curve == "error" else 1.0
        low, high = found.low[:, 0] / size, found.high[:, 0] / size
        return {"k": found.number.tolist(), "lo": _numbers(low), "hi": _numbers(high)}

    def _points(self, cursor: Cursor, name: str) -> list[list[float | None]]:
        trail = self.traces.trails[name]
        points = trail.since(cursor.points.get(name, 0))
        cursor.points[name] = trail.count
        return [_numbers(point) for point in points]

    def zoomed(self, window: int, begin: float, end: float) -> dict[str, Any]:
        """The curves between two times (s of the run) as finely as they are known."""
        width = window * SECOND // BINS
        origin = max(self.traces.begun, 0) // width * width
        first, last = origin + round(begin * SECOND), origin + round(end * SECOND)
        curves = {}
        for name in CURVES:
            size, found = self.traces.detail(name, first, last)
            times = ((found.number + 0.5) * size - origin) / SECOND
            curves[name] = {"t": times.round(9).tolist(), **{k: v for k, v in self._shown(name, found).items() if k != "k"}}
        return {"begin": begin, "end": end, "curves": curves}

    def status(self, control: bool) -> dict[str, Any]:
        """All but the curves: a few numbers of now, the headline, nodes, switches, the job, results."""
        now = self._steady()
        error = self.traces.error_rms(JUDGED)
        shown = "" if error is None else f"{error / self.units.error_size:.3g} {self.units.error}"
        head = headline(Situation(now, self._heard, self._conditions, self._switches, self._job, shown))
        return {
            "headline": asdict(head),
            "numbers": self._numbers_now(head, error),
            "nodes": [self._row(name, c, now) for name, c in sorted(self._conditions.items())],
            "switches": list(self._switches.positions),
            "mode": self._switches.mode,
            "model": Path(self._switches.model).name,
            "effects": [asdict(effect) for effect in self._switches.effects],
            "job": {**asdict(self._job), "progress": _number(self._job.progress), "running": self._job.running},
            "results": self.results.listed(),
            "control": control,
        }

    def _numbers_now(self, head: Headline, error: float | None) -> dict[str, float | None]:
        newest = self.traces.newest
        state, reference = newest(STATES), newest(REFERENCE)
        lost = head.state in ("Graph lost", "No graph")
        found: dict[str, float | None] = {
            "error_rms": None if error is None else error / self.units.error_size,
            "position": state[0] if state else None,
            "speed": state[1] if state else None,
            "reference_speed": reference[1] if reference else None,
            "torque": state[2] if state else None,
            "friction_estimate": next(iter(newest(ESTIMATE)), None),
            "friction_compensation": next(iter(newest(COMPENSATION)), None),
        }
        return {name: None if lost or value is None else _number(value) for name, value in found.items()}

    def _row(self, name: str, condition: Condition, now: float) -> dict[str, Any]:
        age = now - condition.at
        ages = [_age(value) for key, value in condition.values.items() if key.startswith("age of ")]
        return {
            "name": name,
            "level": condition.level,
            "silent": age > SILENT_AFTER,
            "age": round(age, 0 if age > SILENT_AFTER else 1),
            "message": condition.message,
            "values": [condition.values.get(key, "") for key in SHOWN],
            "inputs": max((age for age in ages if age is not None), default=None),
            "all": dict(condition.values),
        }

    def hello(self) -> dict[str, Any]:
        """What a page has to know before anything else."""
        return {"axis": self.name, "units": asdict(self.units), "windows": list(WINDOWS), "bins": BINS, "columns": list(SHOWN)}


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a status that are not as they were."""
    return {name: value for name, value in now.items() if name not in before or before[name] != value}


def _age(words: str) -> float | None:
    """An age as a report says it; None for what is no number, such as "never came"."""
    try:
        return _number(float(words))
    except ValueError:
        return None


def _number(value: float) -> float | None:
    """With six digits; None for what is no number."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
