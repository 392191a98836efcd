"""One source of torque or motion hands over to another within a stated time, never in a step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Step = Callable[..., Any]


def between(new: float, old: float, share: float) -> float:
    """A number with a share (0 to 1) of the old one."""
    return new + share * (old - new)


def between_both(new: tuple[float, float], old: tuple[float, float], share: float) -> tuple[float, float]:
    """Two numbers, likewise."""
    return between(new[0], old[0], share), between(new[1], old[1], share)


class Handover:
    """What the source that was put in place last gives, and that of the one before while it leaves.

    mix: of what the new and the old source give, and the share of the old one.
    """

    def __init__(self, step: Step, reset: Callable[[], None], mix: Callable[[Any, Any, float], Any] = between) -> None:
        self._source, self._reset, self._mix = step, reset, mix
        self.step = step
        """One tick; that of the source itself as long as nothing is leaving."""

    def replace(self, step: Step, reset: Callable[[], None], ticks: float) -> None:
        """Hand over within so many ticks to another one, which goes on from the state that it has."""
        leaving, mix, share, fall = self.step, self._mix, 1.0, 1.0 / max(ticks, 1.0)

        def both(*given: Any) -> Any:
            nonlocal share
            share -= fall
            found = step(*given)
            if share > 0.0:
                return mix(found, leaving(*given), share)
            if self.step is both:
                self.step = step
            return found

        self.step, self._source, self._reset = both, step, reset

    def reset(self) -> None:
        """Forget the past: at rest, and nothing is leaving."""
        self.step = self._source
        self._reset()
