"""Where results go: looked at before the work, and named when the system refuses it in the midst of the work.

`output_directory`, `output_file`, `output_path` and `new_output` turn a word into a path and raise InputError where it cannot be
written. They are the `type` of every -o argument, and nodes call them when a job names a directory.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tcs_friction.errors import InputError, JobError, writing_into

ROOM = 1 << 20
"""Bytes that have to fit before a job begins: a report with its pictures, or the first chunk of a bag."""


def output_directory(word: str | Path) -> Path:
    """A directory that exists or can be made, and takes files."""
    path = _named(word, "a directory to write to")
    with _refused(path, "a directory to write to"):
        if path.exists() and not path.is_dir():
            raise NotADirectoryError(0, "is a file")
        _try(path)
    return path


def output_place(word: str) -> str:
    """A directory as `output_directory` has it, or a URL, which is looked at when it is opened."""
    return word if "://" in word else str(output_directory(word))


def output_file(word: str | Path) -> Path:
    """A file to write, in place of one that may be there."""
    path = _named(word, "a file to write")
    with _refused(path, "a file to write"):
        if path.exists() and not path.is_file():
            raise OSError(0, "is a directory" if path.is_dir() else "is no ordinary file")
        _try(path.absolute().parent)
    return path


def output_path(word: str | Path) -> Path:
    """A directory or a file, as one or the other of the above."""
    path = Path(word)
    return output_directory(word) if path.is_dir() else output_file(word)


def new_output(word: str | Path) -> Path:
    """A name that nothing has yet, in a place that can be written."""
    path = _named(word, "a new name in a place to write to")
    with _refused(path, "a new name in a place to write to"):
        with contextlib.suppress(FileNotFoundError):
            path.lstat()
            raise InputError(str(path), "exists already", "a new name")
        _try(path.absolute().parent)
    return path


def _named(word: str | Path, expected: str) -> Path:
    if not str(word):  # Path("") is the working directory, which nobody meant
        raise InputError("output", "''", expected)
    return Path(word)


@contextlib.contextmanager
def _refused(path: Path, expected: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror or error})", expected) from None


def _try(directory: Path) -> None:
    """Write ROOM bytes where `directory` is or would be made, and leave nothing behind. Raises OSError when that is refused.

    Permissions alone do not tell: the superuser passes them all, and a full or read-only file system has none.
    """
    while not directory.exists():
        directory = directory.absolute().parent
    with tempfile.TemporaryFile(dir=directory) as file:
        file.write(bytes(ROOM))
        file.flush()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """What the system refuses while `path` is written, under whatever temporary name, is a JobError that names `path`."""
    try:
        yield
    except OSError as error:
        raise JobError(str(path), f"cannot be written ({error.strerror or error})") from None


def scratch_beside(path: Path) -> Path:
    """A name that nobody has, in the same directory, for what is renamed when it is whole; the umask says its permissions."""
    return path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")


@contextlib.contextmanager
def staged(directory: Path, *others: str) -> Iterator[Path]:
    """A folder to write into, whose files move into `directory` when all are there; an error leaves nothing behind.

    others: names, or patterns, of files that only some runs write. What an earlier run has left of all these goes first, so that
    whoever ends the process in between leaves files of one run. Raises InputError when `directory` cannot be written to.
    """
    part: Path | None = None
    try:
        with writing_into(directory):
            part = Path(tempfile.mkdtemp(prefix=".part-", dir=directory))
            yield part
            new = sorted(part.iterdir(), key=_is_page)
            left = {directory / path.name for path in new}.union(*(directory.glob(name) for name in others))
            for old in sorted(left, key=_is_page, reverse=True):
                old.unlink(missing_ok=True)
            for path in new:
                os.replace(path, directory / path.name)
    finally:
        if part is not None:
            shutil.rmtree(part, ignore_errors=True)


def _is_page(path: Path) -> bool:
    """Whether a file shows the others: it comes last, and goes first."""
    return path.suffix == ".html"
