"""Numbers as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def unbroken(words: str) -> str:
    """The same words on one line, wherever a page would break it."""
    return words.replace(" ", "\N{NO-BREAK SPACE}")


def interval(lower: float, upper: float, unit: str) -> str:
    """A range, to the third digit of its width.

    >>> interval(-1.3e-17, 5.3126, "rad/s"), interval(2.0, 2.0, "")
    ('0.00 to 5.31 rad/s', '2 to 2')
    """
    width = upper - lower
    places = max(2 - math.floor(math.log10(width)), 0) if width > 0.0 else 0
    return f"{lower:z.{places}f} to {upper:z.{places}f} {unit}".rstrip()


def with_error(value: float, std: float | None) -> str:
    """A value with its standard error, both to the error's second digit.

    >>> with_error(72.0013, 0.012), with_error(0.5, None), with_error(296123.0, 1234.0)
    ('72.001 ± 0.012', '0.5', '296100 ± 1200')
    """
    if std is None or not math.isfinite(std) or std <= 0.0:
        return f"{value:.5g}"
    digits = 1 - math.floor(math.log10(std))
    if digits > 6 or abs(value) >= 1e7:
        return f"{value:.5g} ± {std:.2g}"
    places = max(digits, 0)
    return f"{round(value, digits):.{places}f} ± {round(std, digits):.{places}f}"


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table for a terminal: the first column to the left, numbers to the right.

    >>> aligned([["", "rms"], ["friction law", "0.0146"]])
    ['                 rms', 'friction law  0.0146']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = [[row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])] for row in rows]
    return ["  ".join(line).rstrip() for line in cells]
