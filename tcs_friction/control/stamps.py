"""Which message may follow which: one rule for every node of the loop, for stamps (ns) and for positions.

Lock-step: stamps are simulated time. An equal stamp is a repetition, an older one a new run.

Real time: stamps come from a driver's clock, positions from its encoder, and either may jump. A message follows the one
before if its stamp is newer, by no more than the time that has passed, and its position can have been reached meanwhile with
the speed that is reported and the acceleration that the axis is capable of. What does not follow is refused, unless it goes
on like that for `patience` seconds: then the clock or the position was set anew, and a new run begins there. The first message
of all is judged like that as well. A stray message, an older stamp or a second publisher's clock therefore never restart
anything, and a driver that was restarted is believed after a moment. A message that comes twice or too late is passed over
while others are being made sure of; only when nothing has followed those for `patience` seconds do others take their place.

What answers a state has that state's stamp. An answer with the stamp of no young state comes from a stranger.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

from tcs_friction.control.plausible import NO_LIMIT
from tcs_friction.control.turns import TURN, beside

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
    speed: float
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
        self,
        slack: float = 0.1,
        patience: float = 0.5,
        reach: float = math.inf,
        period: float = 1e-3,
        acceleration: float = math.inf,
        noise: float = 0.0,
        continuous: bool = False,
    ) -> None:
        """Set the limits of real time; those of a continuous axis hold in lock-step, too.

        Parameters
        ----------
        slack: by how much a stamp may be ahead of the time that has passed since the one before, s.
        patience: for how long messages must follow each other until a jump is believed, s.
        reach: largest speed of the position, rad/s.
        period: usual time between two messages, s.
        acceleration: largest acceleration, rad/s^2.
        noise: by how much a position may be off, rad.
        continuous: whether positions are angles that may begin anew after a turn.
        """
        self._slack, self._patience, self._reach, self._period = slack, patience, reach, period
        self._acceleration, self._noise, self._continuous = acceleration, noise, continuous

    def judge(self, stamp: int, position: float = 0.0, now: float = 0.0, speed: float = math.nan) -> Step:
        """What the message is. `now` is steady time in s, of no meaning in lock-step; `speed` is NaN where none is reported."""
        last = self.last
        if self._lock_step and last < stamp < STAMP_END and not self._continuous:  # the usual case first
            self.last = stamp
            return NEXT
        if not 0 <= stamp < STAMP_END:
            self.reason = f"stamp of {stamp / SECOND:g} s is no time"
            return REFUSED
        if stamp == last:
            return REPEATED
        if self._lock_step:
            return self._judge_in_lock_step(_Heard(stamp, position, speed, now))
        return self._judge_in_real_time(_Heard(stamp, position, speed, now))

    def _judge_in_lock_step(self, heard: _Heard) -> Step:
        newer = heard.stamp > self.last
        self.reason = self._turn_objection(self._before, heard) if newer and self._before else ""
        if self.reason:
            return REFUSED
        self._before, self.last = heard if self._continuous else None, heard.stamp
        return NEXT if newer else NEW_RUN

    def _judge_in_real_time(self, heard: _Heard) -> Step:
        if heard.stamp == 0:
            self.reason = "no stamp"
            return Step.REFUSED
        objection = self._objection(self._before, heard) if self._before else ""
        if self._before and not objection:
            self._accept(self._before, heard)
            return Step.NEXT
        self.reason = objection
        doubtful = self._doubtful
        if doubtful is not None and heard.stamp <= doubtful.stamp and heard.at - doubtful.at < self._patience:
            if (heard.stamp, heard.position) != (doubtful.stamp, doubtful.position):
                self.reason = objection or self._objection(doubtful, heard)
            return Step.REFUSED
        self._doubtful = heard
        against = "" if doubtful is None else self._objection(doubtful, heard)
        if doubtful is None or against:
            self._doubtful_since = heard.at
            self.reason = objection or against
        elif heard.at - self._doubtful_since >= self._patience:
            self._accept(doubtful, heard)
            return Step.NEW_RUN
        return Step.REFUSED

    def _accept(self, before: _Heard, heard: _Heard) -> None:
        if heard.speed != heard.speed:  # none is reported
            step = self._step(before, heard)
            heard = replace(heard, speed=step * SECOND / (heard.stamp - before.stamp))
        self._before, self._doubtful = heard, None
        self.last = heard.stamp

    def _objection(self, before: _Heard, heard: _Heard) -> str:
        """Why a message cannot follow another, "" when it can."""
        span, passed = (heard.stamp - before.stamp) / SECOND, heard.at - before.at
        if span <= 0.0:
            return f"stamp {-span:.6g} s older than the one before"
        if span > passed + self._slack:
            return f"stamp {span:.6g} s after the one before, {passed:.3g} s later"
        step, allowed = abs(self._step(before, heard)), self._largest_step(before, heard, span)
        if step > allowed:
            return f"step of {step:.3g} within {span:.3g} s, at most {allowed:.3g} can be"
        return self._turn_objection(before, heard)

    def _expected(self, before: _Heard, heard: _Heard) -> float:
        """The step that the speeds tell, 0 where none is reported."""
        reported = _reported(before, heard)
        return sum(reported) / len(reported) * (heard.stamp - before.stamp) / SECOND if reported else 0.0

    def _step(self, before: _Heard, heard: _Heard) -> float:
        step = heard.position - before.position
        return beside(step, self._expected(before, heard)) if self._continuous else step

    def _turn_objection(self, before: _Heard, heard: _Heard) -> str:
        """Why it is not known over how many turns a continuous axis has come, "" when it is or nobody knows what it can do."""
        if not self._continuous or self._reach >= NO_LIMIT:
            return ""
        span = (heard.stamp - before.stamp) / SECOND
        step, expected, late = self._step(before, heard), self._expected(before, heard), span + self._period
        off = self._reach * late
        if reported := _reported(before, heard):
            fastest = max(map(abs, reported))
            off = min(off + abs(expected), self._acceleration * late**2 + fastest * self._period + self._noise)
        other = step - math.copysign(TURN, step - expected)
        if abs(other - expected) > off:
            return ""
        return f"step of {step:.3g} or {other:.3g} within {span:.3g} s: which turn is not known"

    def _largest_step(self, before: _Heard, heard: _Heard, span: float) -> float:
        """How far the axis can have come. One period is added, for stamps are not exact and speeds are filtered."""
        span += self._period
        reported = _reported(before, heard)
        if not reported:
            return self._reach * span
        speed = max(map(abs, reported)) + self._acceleration * span
        return min(self._reach, speed) * span + self._noise


def _reported(before: _Heard, heard: _Heard) -> list[float]:
    return [speed for speed in (before.speed, heard.speed) if speed == speed]


class RecentStates:
    """The stamps (ns) of the states of the last `limit` seconds, up to the newest."""

    def __init__(self, limit: float) -> None:
        self._order: deque[int] = deque()
        self._stamps: set[int] = set()
        self.configure(limit)

    def configure(self, limit: float) -> None:
        """Another limit, s."""
        self.limit = limit
        self._limit = limit * SECOND

    def add(self, stamp: int) -> None:
        """A new state. One that is older than the newest begins a new run, and forgets the last one."""
        if stamp < self.newest:
            self._order.clear()
            self._stamps.clear()
        if stamp not in self._stamps:
            self._order.append(stamp)
            self._stamps.add(stamp)
        while stamp - self._order[0] > self._limit:
            self._stamps.discard(self._order.popleft())

    @property
    def newest(self) -> int:
        """-1 before the first."""
        return self._order[-1] if self._order else -1

    def may_come(self, stamp: int) -> bool:
        """Whether a state of this stamp may come soon."""
        return 0 <= self.newest < stamp <= self.newest + self._limit

    def __contains__(self, stamp: int) -> bool:
        return stamp in self._stamps


class AnswerRule:
    """Real time: whether a message that answers joint states may be used. Its stamp is that of the state it answers.

    It must be about one of the recent states and must not be older than the answer before. Two different answers to one state
    come from two publishers, and so do answers to no state when there are `STRANGE` of them within the limit of the states:
    `contradicted` is when that was heard last (steady time, s).
    """

    STRANGE = 3
    """One may be a message that was broken on its way, or late."""
    MOST_WAITING = 10

    def __init__(self, states: RecentStates) -> None:
        self._states = states
        self.contradicted = -math.inf
        self._last = -1
        self._values: tuple[float, ...] = ()
        self._strange: deque[float] = deque(maxlen=self.STRANGE)
        self._waiting: list[tuple[int, bytes]] = []

    def wait(self, stamp: int, data: bytes) -> bool:
        """Keep an answer that has overtaken its state; False when it cannot have, or when too many are kept already."""
        may = self._states.may_come(stamp) and len(self._waiting) < self.MOST_WAITING
        if may:
            self._waiting.append((stamp, data))
        return may

    def due(self) -> list[bytes]:
        """The answers that were kept and are to be judged now: their state has come, or cannot come any more."""
        if not self._waiting:
            return []
        ready = [data for stamp, data in self._waiting if not self._states.may_come(stamp)]
        self._waiting = [(stamp, data) for stamp, data in self._waiting if self._states.may_come(stamp)]
        return ready

    def objection(self, stamp: int, values: tuple[float, ...], now: float) -> str:
        """Why the answer may not be used, "" when it may."""
        if stamp not in self._states:
            return self._stranger(stamp, now)
        if self._last in self._states and stamp < self._last:
            return f"stamp {(self._last - stamp) / SECOND:.6g} s older than the one before"
        if stamp == self._last and values != self._values:
            self.contradicted = now
            return "contradicts another with the same stamp"
        self._last, self._values = stamp, values
        return ""

    def _stranger(self, stamp: int, now: float) -> str:
        self._strange.append(now)
        if len(self._strange) == self.STRANGE and now - self._strange[0] <= self._states.limit:
            self.contradicted = now
        away = stamp - self._states.newest
        side = "older" if away < 0 else "newer"
        return f"stamp {abs(away) / SECOND:.6g} s {side} than the newest state, and of none of the last {self._states.limit:g} s"
