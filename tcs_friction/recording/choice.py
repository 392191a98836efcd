"""What a person says of recordings that do not say it themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tcs_friction.errors import InputError

MOST_DIGITS = 5
MOST_SHOWN = 40
"""Characters of a name in a message."""


@dataclass(frozen=True)
class Choice:
    """columns: of a table, signal -> column or column:unit. joint: name, of a table also number.

    strict: whether a recording that would have to be mended is refused instead. settled: whether the signals of bags are those of
    the joint already, so that none has to be asked once more which of its joints a number is.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    joint: str = ""
    strict: bool = False
    settled: bool = False


def joint_number(word: str) -> int | None:
    """A joint's number from 0 on, None for a name. One that has more digits than any recording has joints is merely too large."""
    if not word.isdecimal():
        return None
    return int(word) if len(word) <= MOST_DIGITS else 10**MOST_DIGITS


def no_joint(word: str, expected: str, where: str = "--joint") -> InputError:
    """The refusal of a joint that a recording has not."""
    return InputError(where, f"no joint {word[:MOST_SHOWN]!r}{' ...' if len(word) > MOST_SHOWN else ''}", expected)


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
