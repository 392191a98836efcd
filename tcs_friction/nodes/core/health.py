"""What a node knows about its own condition, for /diagnostics: what is wrong, what has happened, counters. No ROS here.

Ages are measured on the steady clock, in both clocks of the loop. In real time every input has an age limit, and what came
later than that between two reports is reported even if it is well again by then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

LISTED = 4
"""Events named in the message of one report; all of them are among its values."""
MOST_EVENTS = 100
"""Events that one report tells apart; there may be thousands."""
OTHERS = "more events than a report can hold"


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass
class Arrivals:
    """When an input came, on the steady clock (s), and the longest gap since the last report."""

    level: Level
    count: int = 0
    last: float = -1.0
    longest: float = 0.0


@dataclass(frozen=True)
class Judgement:
    """Limits by which a real-time report is judged."""

    period: float = 1e-3  # s, between two ticks
    age_limit: float = 0.1  # s, of an input
    rate_limit: float = 0.9  # share of the ticks that must come
    overrun_limit: float = 0.05  # share of the ticks that may be late
    start_limit: float = 5.0  # s from the first report on in which an input may still come for the first time
    names_rate: bool = True  # say that what is heard comes at another rate; one node of an axis is enough

    def shown(self) -> dict[str, str]:
        """The limits as values of a report, beside what they limit."""
        rate = 1.0 / self.period
        return {
            "rate, limits [1/s]": f"{self.rate_limit * rate:.1f} to {(2.0 - self.rate_limit) * rate:.1f}",
            "overruns, limit [1/s]": f"{self.overrun_limit * rate:.1f}",
            "age of inputs, limit [s]": f"{self.age_limit:.3f}",
        }


@dataclass
class Health:
    """Counters that a node's callbacks advance and its report reads."""

    ticks: int = 0
    refused: int = 0  # inputs that were not finite, out of range or out of order
    overruns: int = 0  # ticks that came later than two periods after the one before (real time)
    repeats: int = 0  # inputs that had to be sent again (lock-step)
    last_tick: float = 0.0  # steady time, s
    stamp: int = -1  # ns, of what was answered last; -1 where ticks are the node's own
    values: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, Arrivals] = field(default_factory=dict)
    _problems: dict[str, str] = field(default_factory=dict)
    _warnings: dict[str, str] = field(default_factory=dict)
    _events: dict[str, int] = field(default_factory=dict)
    _before: tuple[float, int, int] = (0.0, 0, 0)
    _stamp_before: int = -1
    _begun: float = 0.0
    _was: Level = Level.OK  # the worst of what is well again since the last report
    _limits: dict[str, str] = field(default_factory=dict)
    _disbelieved: dict[str, str] = field(default_factory=dict)

    # What callbacks say

    def fail(self, cause: str, text: str) -> None:
        """Something is wrong until `well(cause)` is said."""
        self._warnings.pop(cause, None)
        self._problems[cause] = text

    def doubt(self, cause: str, text: str) -> None:
        """Something is doubtful until `well(cause)` is said."""
        if cause in self._problems:
            self.well(cause)
        self._warnings[cause] = text

    def well(self, *causes: str) -> None:
        """These causes are gone. What was wrong since the last report is still in the next one."""
        for cause in causes:
            if cause in self._problems:
                self._was = Level.ERROR
                self.note(self._problems.pop(cause))
            elif cause in self._warnings:
                self.note(self._warnings.pop(cause))

    def note(self, event: str) -> None:
        """Something happened; it is in the next report."""
        if event not in self._events and len(self._events) >= MOST_EVENTS:
            event = OTHERS
        self._events[event] = self._events.get(event, 0) + 1

    def forget_events(self) -> None:
        """What happened so far is not reported."""
        self._events.clear()
        self._was = Level.OK

    def refuse(self, what: str) -> None:
        """Count an input that was refused and say why."""
        self.refused += 1
        self.note(what)

    def disbelieve(self, name: str, reason: str) -> None:
        """An expected input was heard and is not believed; it is named so where nothing else comes."""
        self._disbelieved[name] = reason

    def expect(self, name: str, level: Level = Level.ERROR) -> None:
        """Real time: this input has to come; `level` says how bad it is when it does not."""
        self.inputs.setdefault(name, Arrivals(level)).level = level

    def forget(self, name: str) -> None:
        """An input that does not have to come any more."""
        if self.inputs.pop(name, None):
            self.well(f"no {name}")
            self.values.pop(f"age of {name} [s]", None)

    def heard(self, name: str, now: float, period: float = 0.0) -> None:
        """Real time: an expected input came. With a period, one that is two of them late is an overrun."""
        arrivals = self.inputs[name]
        if arrivals.last >= 0.0:
            gap = now - arrivals.last
            if gap > arrivals.longest:
                arrivals.longest = gap
            if period and gap > 2.0 * period:
                self.overruns += 1
        arrivals.last = now
        arrivals.count += 1

    # What the report says

    @property
    def problem(self) -> str:
        """What is wrong now, "" when nothing is."""
        return "; ".join(self._problems.values())

    @property
    def problems(self) -> Mapping[str, str]:
        """What is wrong now, by cause."""
        return self._problems

    @property
    def warning(self) -> str:
        """What is doubtful now or happened since the last report."""
        events = self._told()
        more = [f"and {len(events) - LISTED} more"] if len(events) > LISTED else []
        return "; ".join([*self._warnings.values(), *events[:LISTED], *more])

    def _told(self) -> list[str]:
        return [text if count == 1 else f"{text} ({count} times)" for text, count in self._events.items()]

    def level(self) -> Level:
        """The worst of what is so now or was since the last report."""
        if self._problems:
            return Level.ERROR
        return max(self._was, Level.WARN) if self._warnings or self._events else Level.OK

    def judge(self, now: float, limits: Judgement) -> None:
        """Real time: ages of inputs, rate and overruns since the last report against their limits."""
        self._begun = self._begun or now
        self._limits = limits.shown()
        for name, arrivals in self.inputs.items():
            age = now - arrivals.last
            if arrivals.last < 0.0 and now - self._begun < limits.start_limit:
                self.doubt(f"no {name}", f"waiting for {name}")
                continue
            if arrivals.last < 0.0 or age > limits.age_limit:
                since = "" if arrivals.last < 0.0 else f" for {age:.1f} s"
                heard = f": heard and not believed ({self._disbelieved[name]})" if name in self._disbelieved else ""
                say = self.fail if arrivals.level is Level.ERROR else self.doubt
                say(f"no {name}", f"no {name}{since}{heard}")
                self.values[f"age of {name} [s]"] = f"{age:.3f}" if since else "never came"
                continue
            self.well(f"no {name}")
            if arrivals.longest > limits.age_limit:
                self.note(f"{name} stayed away for {arrivals.longest:.3f} s, the limit is {limits.age_limit:g} s")
            self.values[f"age of {name} [s]"] = f"{age:.3f}"
            arrivals.longest = 0.0
        self._disbelieved.clear()
        then, ticks, overruns = self._before
        expected = (now - then) / limits.period
        if not then or self.ticks == ticks or self._stamp_before < 0 <= self.stamp:
            return  # what is heard has begun in between
        share = (self.ticks - ticks) / expected
        interval = self._interval(self.ticks - ticks)
        if abs(interval - limits.period) > (1.0 - limits.rate_limit) * limits.period:
            if limits.names_rate:
                found = f"states come every {interval:.4g} s, period is {limits.period:g} s"
                self.note(f"{found}: set it for all nodes, or mend the rate")
        elif share < limits.rate_limit or share > 2.0 - limits.rate_limit:
            rate, wanted = share / limits.period, 1.0 / limits.period
            self.note(f"{rate:.0f} ticks per second instead of {wanted:.0f}")
        if self.overruns - overruns > limits.overrun_limit * expected:
            self.note(f"{self.overruns - overruns} overruns in {now - then:.0f} s")

    def _interval(self, ticks: int) -> float:
        """Mean of the intervals (s) between what was answered since the last report; NaN where that is not known."""
        before = self._stamp_before
        return (self.stamp - before) * 1e-9 / ticks if 0 <= before < self.stamp else math.nan

    def report(self, now: float) -> dict[str, str]:
        """The values shown: rate since the report before, time without a tick, counters. `now` is steady time in s.

        Events are forgotten thereafter.
        """
        then, ticks, _ = self._before
        rate = (self.ticks - ticks) / (now - then) if then and now > then else 0.0
        self._before, self._stamp_before = (now, self.ticks, self.overruns), self.stamp
        events = {f"event {number}": text for number, text in enumerate(self._told(), 1)}
        self.forget_events()
        idle = f"{now - self.last_tick:.1f}" if self.last_tick else "no tick yet"
        counters = {
            "ticks": str(self.ticks),
            "rate [1/s]": f"{rate:.1f}",
            "idle for [s]": idle,
            "inputs refused": str(self.refused),
            "overruns": str(self.overruns),
            "repeats": str(self.repeats),
        }
        return counters | self._limits | self.values | events
