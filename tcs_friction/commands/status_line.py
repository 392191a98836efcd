"""How far a long command is: one line on a terminal, nothing into a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

CLEARED = "\r\033[K"


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """Shows a text in place of the one before, on stderr; at the end the line is empty."""
    terminal = sys.stderr.isatty()

    def show(text: str) -> None:
        if terminal:
            print(f"{CLEARED}{text}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        show("")
