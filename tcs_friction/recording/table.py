"""A table as its file holds it, and what its names may be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Column

MAX_COLUMNS = 4096
"""Columns of a table; a drive's logger has tens."""

MAX_NAME = 256
"""Characters of a column's name."""

RUN_BY_SPREADSHEETS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""What a text cell begins with that a spreadsheet runs as a formula (OWASP, CSV injection)."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns by name.

    units: of columns for which something else than their name tells it. starts: of columns of times, which are in s, when they
    are 0: ns since 1970, 0 where nobody knows. notes: what was left out or assumed. headless: whether the names are only numbers,
    from 1. texts: the first cell of columns that begin with words.
    """

    columns: Mapping[str, Column]
    units: Mapping[str, str] = field(default_factory=dict)
    starts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    headless: bool = False
    texts: Mapping[str, str] = field(default_factory=dict)


def checked(names: Sequence[str], path: Path) -> Sequence[str]:
    """The names of the columns. Raises InputError when two are equal, or there are too many or too long ones."""
    if len(names) > MAX_COLUMNS or any(len(name) > MAX_NAME for name in names):
        found = f"{len(names)} columns, the longest name of {max(map(len, names))} characters"
        raise InputError(str(path), found, f"at most {MAX_COLUMNS} columns and {MAX_NAME} characters")
    twin = next((name for name, count in Counter(names).items() if count > 1), None)
    if twin is not None:
        raise InputError(str(path), f"{names.count(twin)} columns with the same name {twin!r}", "a name for each column")
    return names
