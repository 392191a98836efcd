"""One feed-forward hands the torque over to another within a stated time, never in a step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Step = Callable[..., float]


class Handover:
    """The torque of the feed-forward that was put in place last, and of the one before while it leaves."""

    def __init__(self, step: Step, reset: Callable[[], None]) -> None:
        self._step, self._reset = step, reset
        self._leaving: Step | None = None
        self._share = self._fall = 0.0

    def replace(self, step: Step, reset: Callable[[], None], ticks: float) -> None:
        """Hand over to another one, which starts anew, within so many ticks."""
        before = Handover(self._step, self._reset)
        before._leaving, before._share, before._fall = self._leaving, self._share, self._fall
        self._step, self._reset = step, reset
        self._reset()
        self._leaving, self._share, self._fall = before.step, 1.0, 1.0 / max(ticks, 1.0)

    def reset(self) -> None:
        """Forget the past: at rest, and nothing is leaving."""
        self._leaving = None
        self._reset()

    def step(self, *reference: Any) -> float:
        """One tick: the torque to add to the command, N m."""
        torque = self._step(*reference)
        if self._leaving is None:
            return torque
        self._share -= self._fall
        torque += max(self._share, 0.0) * (self._leaving(*reference) - torque)
        if self._share <= 0.0:
            self._leaving = None
        return torque
