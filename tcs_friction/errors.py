"""The errors a user of this package meets: one line each, saying where, what was found and what was expected."""

from __future__ import annotations


class TcsError(Exception):
    """Base of every error raised on purpose.

    `where` names the file, topic, key or signal; `found` says what is wrong there; `expected` says what
    would have been right (may be empty when `found` already says it). `str()` is the one line shown to people.
    """

    exit_status = 1

    def __init__(self, where: str, found: str, expected: str = "") -> None:
        self.where = where
        self.found = found
        self.expected = expected
        parts = [found, f"expected {expected}"] if expected else [found]
        super().__init__(f"{where}: {', '.join(parts)}".replace("\n", " "))


class InputError(TcsError):
    """Wrong usage or bad input: a file, a key, a value. Exit status 2."""

    exit_status = 2


class JobError(TcsError):
    """The input was fine and the job ran, but could not do what was asked. Exit status 1."""
