"""Reading of command lines: what is wrong with one is said in one line."""

from __future__ import annotations

import argparse
import sys
from types import ModuleType

from tcs_friction.errors import printable

MOST_DIGITS = 18


class _Parser(argparse.ArgumentParser):
    """argparse in this project's voice: one line."""

    def error(self, message: str) -> None:  # type: ignore[override]
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        sys.exit(2)


def parser_of(name: str, module: ModuleType) -> argparse.ArgumentParser:
    """The parser of a command or benchmark of that name: its module's docstring and `add_arguments(parser)`."""
    parser = _Parser(
        prog=f"tcs-friction {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add_arguments(parser)
    return parser


def positive(word: str) -> int:
    """A whole number from 1 on, as the `type` of an argument."""
    if not (word.isdecimal() and len(word) <= MOST_DIGITS and int(word) > 0):
        raise argparse.ArgumentTypeError(f"{word[:MOST_DIGITS]!r} is no whole number from 1 on, of at most {MOST_DIGITS} digits")
    return int(word)


def name_word(word: str) -> str:
    """A name that can be written into a file, as the `type` of an argument: bytes that are no UTF-8 cannot."""
    if not word.isprintable():
        raise argparse.ArgumentTypeError(f"'{printable(word)}' is no text")
    return word


def share_word(word: str) -> float:
    """A share, as 1% or 0.01, as the `type` of an argument."""
    number, percent = (word[:-1], 0.01) if word.endswith("%") else (word, 1.0)
    try:
        value = percent * float(number)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"{word!r} is no share from 0 to 1, such as 1% or 0.01")
    return value
