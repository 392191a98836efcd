"""Which lines a node's log gets of its problems and warnings. No ROS here.

/diagnostics has all of them every second; the log has each once. A text is no other one because its numbers have changed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

WARN_EVERY = 10.0
"""s between two lines of warnings in the log."""
_NUMBER = re.compile(r"\d+(\.\d+)?")


def words(text: str) -> str:
    """A text without its numbers."""
    return _NUMBER.sub("", text)


class Problems:
    """Every problem once when it comes, and once that all are gone."""

    def __init__(self) -> None:
        self._told: dict[str, str] = {}

    def lines(self, problems: Mapping[str, str]) -> list[str]:
        """What is new among the problems that stand, by cause."""
        now = {cause: words(text) for cause, text in problems.items()}
        new = [text for cause, text in problems.items() if now[cause] != self._told.get(cause)]
        self._told = now
        return new

    @property
    def any(self) -> bool:
        """Whether any stood when they were looked at last."""
        return bool(self._told)


class Warnings:
    """A warning when it comes, at most one in `every` seconds; then the last that was held back, and how many there were."""

    def __init__(self, every: float = WARN_EVERY) -> None:
        self._every = every
        self._at = -math.inf
        self._words = self._last = ""
        self._held = 0

    def line(self, warning: str, now: float) -> str:
        """What to log now (steady time, s), "" for nothing. `warning` is what there is to warn of, "" for nothing."""
        new = words(warning)
        if new and new != self._words:
            self._held, self._last = self._held + 1, warning
        self._words = new
        if not self._held or now - self._at < self._every:
            return ""
        held, self._held, self._at = self._held, 0, now
        return self._last if held == 1 else f"{self._last} (the last of {held} different warnings since the line before)"
