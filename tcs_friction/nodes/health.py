"""What a node knows about its own condition, for /diagnostics. No ROS here."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Health:
    """Counters that a node's callbacks advance and its report reads."""

    ticks: int = 0
    refused: int = 0  # inputs that were not finite or out of range
    overruns: int = 0  # ticks that came later than one period after the one before (real time)
    repeats: int = 0  # inputs that had to be sent again (lock-step)
    problem: str = ""  # what is wrong now, "" when nothing is
    warning: str = ""  # what is doubtful now
    last_tick: float = 0.0  # wall time, s
    values: dict[str, str] = field(default_factory=dict)
    _before: tuple[float, int] = (0.0, 0)

    def refuse(self, what: str) -> None:
        """Count an input that was refused and say why."""
        self.refused += 1
        self.warning = what

    def report(self, now: float) -> dict[str, str]:
        """The values shown: rate since the report before, time without a tick, counters. `now` is wall time in s."""
        then, ticks = self._before
        rate = (self.ticks - ticks) / (now - then) if then and now > then else 0.0
        self._before = (now, self.ticks)
        idle = f"{now - self.last_tick:.1f}" if self.last_tick else "no tick yet"
        counters = {
            "ticks": str(self.ticks),
            "rate [1/s]": f"{rate:.1f}",
            "idle for [s]": idle,
            "inputs refused": str(self.refused),
            "overruns": str(self.overruns),
            "repeats": str(self.repeats),
        }
        return counters | self.values
