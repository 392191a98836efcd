"""Which message may follow which: one rule for every node of the loop, for stamps (ns) and for positions.

Lock-step: stamps are simulated time. An equal stamp is a repetition, an older one a new run.

Real time: stamps come from a driver's clock, positions from its encoder, and either may jump. A message follows the one
before if its stamp is newer, by no more than the time that has passed, and its position can have been reached meanwhile.
What does not follow is refused, unless it goes on like that for `patience` seconds: then the clock or the position was set
anew, and a new run begins there. The first message of all is judged like that as well. A stray message, an older stamp or a
second publisher's clock therefore never restart anything, and a driver that was restarted is believed after a moment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

SECOND = 1_000_000_000
STAMP_END = 2**31 * SECOND
"""builtin_interfaces/Time has 31 bits for the seconds."""


class Step(Enum):
    """What a message is to the node that hears it."""

    NEXT = "next"
    REPEATED = "repeated"
    NEW_RUN = "new run"
    REFUSED = "refused"


NEXT, REPEATED, NEW_RUN, REFUSED = Step  # members of an enumeration are slow to look up at every tick


@dataclass(frozen=True)
class _Heard:
    stamp: int
    position: float
    at: float  # steady time, s


class FollowRule:
    """Judges the messages of one input. `last` is the stamp that was accepted last, -1 before the first.

    lock_step says which of the two rules; `configure` may change the limits of the other at any time.
    """

    def __init__(self, lock_step: bool) -> None:
        self._lock_step = lock_step
        self.configure()
        self.last = -1
        self.reason = ""
        """Why the last message was refused; "" while a first or changed input is being made sure of."""
        self._before: _Heard | None = None
        self._doubtful: _Heard | None = None
        self._doubtful_since = 0.0

    def configure(
        self, slack: float = 0.1, patience: float = 0.5, reach: float = math.inf, period: float = 1e-3
    ) -> None:
        """Set the limits of real time.

        Parameters
        ----------
        slack: by how much a stamp may be ahead of the time that has passed since the one before, s.
        patience: for how long messages must follow each other until a jump is believed, s.
        reach: largest speed of the position, rad/s.
        period: usual time between two messages, s.
        """
        self._slack, self._patience, self._reach, self._period = slack, patience, reach, period

    def judge(self, stamp: int, position: float = 0.0, now: float = 0.0) -> Step:
        """What the message is; `now` is steady time in s, of no meaning in lock-step."""
        last = self.last
        if self._lock_step and last < stamp < STAMP_END:  # the usual case first
            self.last = stamp
            return NEXT
        if not 0 <= stamp < STAMP_END:
            self.reason = f"stamp of {stamp / SECOND:g} s is no time"
            return REFUSED
        if stamp == last:
            return REPEATED
        if self._lock_step:
            self.last = stamp
            return NEW_RUN
        return self._judge_in_real_time(_Heard(stamp, position, now))

    def _judge_in_real_time(self, heard: _Heard) -> Step:
        if heard.stamp == 0:
            self.reason = "no stamp"
            return Step.REFUSED
        objection = self._objection(self._before, heard) if self._before else ""
        if self._before and not objection:
            self._accept(heard)
            return Step.NEXT
        doubtful, self._doubtful = self._doubtful, heard
        if doubtful is None or self._objection(doubtful, heard):
            self._doubtful_since = heard.at
        elif heard.at - self._doubtful_since >= self._patience:
            self._accept(heard)
            return Step.NEW_RUN
        self.reason = objection
        return Step.REFUSED

    def _accept(self, heard: _Heard) -> None:
        self._before, self._doubtful = heard, None
        self.last = heard.stamp

    def _objection(self, before: _Heard, heard: _Heard) -> str:
        """Why a message cannot follow another, "" when it can."""
        span, passed = (heard.stamp - before.stamp) / SECOND, heard.at - before.at
        if span <= 0.0:
            return f"stamp {-span:.6g} s older than the one before"
        if span > passed + self._slack:
            return f"stamp {span:.6g} s after the one before, {passed:.3g} s later"
        step = abs(heard.position - before.position)
        if step > self._reach * (span + self._period):
            return f"step of {step:.6g} within {span:.3g} s"
        return ""


class AnswerRule:
    """Real time: whether a message that answers joint states may be used. Its stamp is that of the state it answers.

    It must be about a state that is no older than `age_limit` seconds and must not be older than the answer before. Two
    different answers to one state come from two publishers: `contradicted` is when that was heard last (steady time, s).
    """

    def __init__(self, age_limit: float) -> None:
        self.configure(age_limit)
        self.contradicted = -math.inf
        self.restart()

    def configure(self, age_limit: float) -> None:
        """Another age limit, s."""
        self._limit = round(age_limit * SECOND)

    def restart(self) -> None:
        """The states have begun a new run."""
        self.last = -1
        self._values: tuple[float, ...] = ()

    def objection(self, stamp: int, values: tuple[float, ...], state: int, now: float) -> str:
        """Why the answer may not be used, "" when it may. `state` is the stamp of the newest state."""
        if abs(stamp - state) > self._limit:
            self.contradicted = now
            return f"stamp {abs(stamp - state) / SECOND:.6g} s {'older' if stamp < state else 'newer'} than the newest state"
        if stamp < self.last:
            return f"stamp {(self.last - stamp) / SECOND:.6g} s older than the one before"
        if stamp == self.last:
            if values == self._values:
                return ""
            self.contradicted = now
            return "contradicts another with the same stamp"
        self.last, self._values = stamp, values
        return ""
