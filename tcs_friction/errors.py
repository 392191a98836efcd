"""The errors a user of this package meets: one line each, saying where, what was found and what was expected."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

MOST_LISTED = 40
MOST_SHOWN = 2000
"""Characters of a message; what is longer is cut in the middle, where it quotes a file."""


QUERY = re.compile(r"(\w:/+[^\s?]*)\?\S*?(?=[,:;.)\]'\"]*(?:\s|$))")


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
        super().__init__(one_line(f"{where}: {', '.join(parts)}"))

    def __reduce__(self) -> tuple[object, ...]:
        """So that a process of a pool can hand it on, whatever its class is made from."""
        return Exception.__new__, (type(self), *self.args), vars(self)


class InputError(TcsError):
    """Wrong usage or bad input: a file, a key, a value. Exit status 2."""

    exit_status = 2


class JobError(TcsError):
    """The input was fine and the job ran, but could not do what was asked. Exit status 1."""


def printable(text: str) -> str:
    """The text with control characters shown as escapes, so that a terminal does not obey what a file says.

    >>> printable("a\\x1b[31m")
    'a\\\\x1b[31m'
    """
    if text.isprintable():
        return text
    shown = (part if part.isprintable() else part.encode("unicode_escape").decode() for part in text)
    return "".join(shown)


def one_line(text: str) -> str:
    """A message as one line of bounded length. The query of a URL is left out: of one that is signed, it is the permission.

    >>> one_line("https://host/bag.mcap?X-Amz-Signature=5e1f: does not exist")
    'https://host/bag.mcap?...: does not exist'
    """
    line = QUERY.sub(r"\1?...", printable(text.replace("\n", " ")))
    if len(line) <= MOST_SHOWN:
        return line
    return f"{line[: MOST_SHOWN // 2]} ... {line[-MOST_SHOWN // 2 :]}"


@contextmanager
def writing_into(directory: Path) -> Iterator[None]:
    """Makes the directory; what the system then refuses to have written there is an InputError that names it."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise InputError(
            str(directory), f"cannot be written ({error.strerror or error})", "a directory to write to"
        ) from None


def refusal(error: OSError) -> JobError:
    """What the system refused, in one line."""
    named = error.filename or error.filename2
    return JobError(str(named) if named is not None else "system", error.strerror or str(error))


def nearest(name: str, known: Iterable[str]) -> str:
    """What to expect instead of an unknown name: the known ones most like it, else what there is.

    >>> nearest("coulom", ["coulomb", "static"])
    'coulomb'
    >>> nearest("zzz", ["coulomb", "static"])
    'one of coulomb, static'
    """
    name, names = name[:MOST_SHOWN], list(dict.fromkeys(known))
    if not names:
        return "nothing else there"
    folded = {candidate.lower(): candidate for candidate in names}
    close = difflib.get_close_matches(name.lower(), folded, n=3, cutoff=0.5)
    if close:
        return " or ".join(folded[match] for match in close)
    return f"one of {', '.join(names[:MOST_LISTED])}{', ...' if len(names) > MOST_LISTED else ''}"
