"""The watch over one running axis: learns, then judges every block of ticks, and says once what has changed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.config_field import setting, validate
from tcs_friction.monitor.bank import COORDINATES, LOOK
from tcs_friction.monitor.baseline import Baseline, learned, moving
from tcs_friction.monitor.evidence import JUDGED, LEFT, OTHER, Evidence, combined, fresh, judge
from tcs_friction.monitor.finding import Finding, finding
from tcs_friction.monitor.residual import (
    BLOCK,
    COLUMNS,
    RESIDUAL,
    clock,
    evaluator,
    follow,
    interrupt,
    ticks_per_block,
)
from tcs_friction.physics.axis import Axis

Array = NDArray[np.float64]

MOST_FILLED = 5
"""Ticks that may be missing in a row and are filled with a straight line."""
COMPUTING = 0.99
"""What is said of a learning period that is over and has yet to be learned from."""
MOST_ROWS = 2_000_000
"""Blocks of a learning period at most, eleven hours."""


@dataclass(frozen=True)
class WatchConfig:
    """How long to learn and how rarely to raise a false alarm."""

    learning_time: float = setting(1800.0, "s", 30.0, 1e5, "motion (not rest) to learn from before anything is judged")
    alarm_interval: float = setting(
        30.44, "d", 0.01, 1e5, "of motion: mean time between false alarms, at least, of an axis that does not change"
    )

    def validate(self, where: str = "watch") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)

    @property
    def limit(self) -> float:
        """Natural logarithm of the evidence at which a change is told: that of the looks in an alarm interval."""
        return math.log(self.alarm_interval * 86400.0 / (LOOK * BLOCK))


def compiled(baseline: Baseline) -> None:
    """Have the tests compiled now, and not between two ticks."""
    judge(baseline, fresh(baseline), np.zeros(COLUMNS))


class Watch:
    """One `tick` for each state. `period`: s between ticks. signals: names of the recorded signals that act on the axis."""

    def __init__(self, axis: Axis, period: float, config: WatchConfig | None = None, signals: tuple[str, ...] = ()) -> None:
        self.axis, self.period = axis, period
        self.config = config or WatchConfig()
        self.config.validate()
        self._evaluator = evaluator(axis, period, signals)
        size = ticks_per_block(period)
        self._ticks = np.zeros((size, 3 + 2 * len(signals)))
        self._filled = 0
        self._row = np.empty((1, COLUMNS))
        self._last: tuple[float, float] | None = None
        self.stretches = 0
        """How often what came did not follow what had come before."""
        row, ticks = self._row.copy(), self._ticks
        follow(evaluator(axis, period, signals), ticks[:, 0], ticks[:, 1], ticks[:, 2:], row)  # compiled before the first tick
        self.learn_anew()

    def learn_anew(self) -> None:
        """Forget what was learned; a change that was told is forgotten as well."""
        self.baseline: Baseline | None = None
        self.evidence: Evidence | None = None
        self.told: Finding | None = None
        self._rows: list[Array] = []
        self._moved = 0

    # Time

    @property
    def clock(self) -> float:
        """s since the first tick, gaps included."""
        return clock(self._evaluator)

    def interrupt(self, span: float = 0.0) -> None:
        """What comes next does not follow what came before; `span` (s) lies between."""
        interrupt(self._evaluator, max(span, 0.0))
        self._filled, self._last = 0, None
        self.stretches += 1

    def tick(
        self, span: float, position: float, torque: float, temperature: float = 20.0, signals: Sequence[float] = ()
    ) -> bool:
        """A state `span` (s) after the one before: position (rad), torque (N m) held until it; whether a block has ended.

        signals: value and rate (1/s) of each. A few missing ticks are filled; a longer gap interrupts.
        """
        missing = round(span / self.period) - 1 if self._last is not None else 0
        if not 0 <= missing <= MOST_FILLED:
            self.interrupt(span)
            missing = 0
        ended = False
        if missing and self._last is not None:
            for k in range(1, missing + 1):
                share = k / (missing + 1)
                before = self._last
                q, u = before[0] + share * (position - before[0]), before[1] + share * (torque - before[1])
                ended |= self._put(q, u, temperature, signals)
        self._last = (position, torque)
        return self._put(position, torque, temperature, signals) or ended

    def _put(self, position: float, torque: float, temperature: float, signals: Sequence[float]) -> bool:
        at = self._filled
        self._ticks[at, 0], self._ticks[at, 1], self._ticks[at, 2] = position, torque, temperature
        if signals:
            self._ticks[at, 3:] = signals
        self._filled = at + 1
        if self._filled < len(self._ticks):
            return False
        self._filled = 0
        ticks = self._ticks
        if not follow(self._evaluator, ticks[:, 0], ticks[:, 1], ticks[:, 2:], self._row):
            return False
        self.block(self._row[0])
        return True

    # Blocks

    def block(self, row: Array) -> None:
        """Learn from a block (COLUMNS,), or judge it."""
        if self.baseline is None or self.evidence is None:
            if len(self._rows) < MOST_ROWS:
                self._rows.append(row.copy())
                self._moved += bool(moving(row[None])[0])
        elif judge(self.baseline, self.evidence, row) and self.told is None and self.log_evidence >= self.config.limit:
            self.told = finding(self.baseline, self.evidence, self.axis)

    @property
    def is_learning(self) -> bool:
        """Whether nothing is judged yet."""
        return self.baseline is None

    @property
    def learned_share(self) -> float:
        """How much of the learning period is over, 0 to 1; less than 1 until what it has shown is computed and judged by."""
        return min(self.learned_time / self.config.learning_time, COMPUTING) if self.is_learning else 1.0

    @property
    def learned_time(self) -> float:
        """s of motion that were learned from so far."""
        return self._moved * BLOCK

    @property
    def has_seen_enough(self) -> bool:
        """Whether the learning period is over and `learned` may be asked."""
        return self.baseline is None and self.learned_time >= self.config.learning_time

    @property
    def rows(self) -> Array:
        """The blocks (n, COLUMNS) of the learning period."""
        return np.array(self._rows).reshape(-1, COLUMNS)

    def learned(self, rows: Array | None = None) -> Baseline:
        """What the learning period, or blocks (n, COLUMNS) of it, have shown; takes seconds. Raises JobError for too little."""
        seen = self.rows if rows is None else rows
        baseline = learned(seen, self.axis.cycle)
        compiled(baseline)
        return baseline

    def adopt(self, baseline: Baseline) -> None:
        """Judge from now on."""
        self.baseline, self.evidence, self.told = baseline, fresh(baseline, self.clock), None
        self._rows = []

    def forget_change(self) -> None:
        """Begin to judge anew with what was learned."""
        if self.baseline is not None:
            self.adopt(self.baseline)

    # What it says

    @property
    def residual(self) -> float:
        """N m, of the last block against the model as it is."""
        return float(self._row[0, RESIDUAL])

    @property
    def left(self) -> float:
        """N m, of the last block, less what was learned; NaN while learning and where it is not judged."""
        return float(self.evidence.status[LEFT]) if self.evidence is not None else math.nan

    @property
    def log_evidence(self) -> float:
        """Natural logarithm of the evidence of a change, of all coordinates together; 0 for none."""
        return float(combined(self.evidence.logs)) if self.evidence is not None else 0.0

    @property
    def over_alarm(self) -> float:
        """Common logarithm of the evidence over that of an alarm: from 0 on a change is told."""
        return (self.log_evidence - self.config.limit) / math.log(10.0)

    @property
    def strongest(self) -> Finding | None:
        """What the evidence speaks for most now; None while learning."""
        return None if self.baseline is None or self.evidence is None else finding(self.baseline, self.evidence, self.axis)

    def evidence_by_coordinate(self) -> dict[str, float]:
        """Common logarithm of the e-value of each coordinate."""
        logs = np.zeros(len(COORDINATES)) if self.evidence is None else self.evidence.logs
        return {name: float(x) / math.log(10.0) for name, x in zip(COORDINATES, logs, strict=True)}

    @property
    def judged_share(self) -> float:
        """Share of the blocks since the learning period whose motion is like what was learned."""
        if self.evidence is None:
            return 0.0
        judged, other = float(self.evidence.status[JUDGED]), float(self.evidence.status[OTHER])
        return judged / (judged + other) if judged + other else 1.0
