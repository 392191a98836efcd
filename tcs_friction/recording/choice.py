"""What a person says of recordings that do not say it themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tcs_friction.errors import InputError


@dataclass(frozen=True)
class Choice:
    """columns: of a table, signal -> column or column:unit. joint: name, of a table also number.

    strict: whether a recording that would have to be mended is refused instead.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    joint: str = ""
    strict: bool = False


def columns_of(words: Sequence[str]) -> dict[str, str]:
    """`SIGNAL=COLUMN[:unit]` words as a mapping. Raises InputError for what is none, and for a signal named twice."""
    chosen: dict[str, str] = {}
    for word in words:
        signal, separator, column = word.partition("=")
        if not separator:
            raise InputError("--column", repr(word), "SIGNAL=COLUMN")
        if signal in chosen:
            raise InputError("--column", f"{chosen[signal]!r} and {column!r} for {signal}", "one column for a signal")
        chosen[signal] = column
    return chosen
