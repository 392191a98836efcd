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
