"""What others ask for over the network: the files they name are not shown to them, the results they ask for stay in one place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tcs_friction.control.config_field import text
from tcs_friction.errors import InputError, TcsError
from tcs_friction.writable import output_directory

LONGEST_NAME = 200
"""Characters of a result's name; file systems take 255 bytes for each part of a path."""


class ContentError(InputError):
    """A file does not do. The message quotes nothing of its content; `quoting`, for the node's own terminal, does."""

    def __init__(self, error: TcsError) -> None:
        super().__init__(error.where, "does not do", error.expected or "another file; the command line says more about it")
        self.quoting = error


@contextmanager
def unquoted() -> Iterator[None]:
    """Errors about a file that is read in here do not quote it: whoever has named it may not be allowed to read it."""
    try:
        yield
    except TcsError as error:
        raise ContentError(error) from None
    except Exception as error:  # whatever is in it must not take the node down
        raise InputError("file", f"cannot be read ({type(error).__name__})", "another file") from None


@dataclass(frozen=True)
class ResultsConfig:
    """For nodes that write what they are asked for."""

    results: str = text("results", "directory that results go below, whatever is asked for over the network", fixed=True)


@contextmanager
def new_results(results: str, name: str, resumes: str = "") -> Iterator[Path | None]:
    """The directory `name` below `results` to write into, None without a name; one that stays empty goes again.

    resumes: name of a file; a directory that has it may hold something already.
    """
    path = result_directory(results, name, resumes) if name else None
    try:
        yield path
    finally:
        if path is not None:
            with suppress(OSError):  # it holds something
                path.rmdir()


def result_directory(results: str, name: str, resumes: str = "") -> Path:
    """The directory `name` below the directory `results`; it is made. New, empty, or with a file of the name `resumes`.

    Raises InputError when the name leads elsewhere, is in use or cannot be made.
    """
    shown = repr(name[:LONGEST_NAME])
    if not name.isprintable() or len(name) > LONGEST_NAME or Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"directory {shown}", "is not allowed", "a name below the node's directory `results`, without `..`")
    root = Path(results).resolve()
    path = (root / name).resolve()
    if path == root or not path.is_relative_to(root):
        raise InputError(f"directory {shown}", "leads elsewhere", f"a name below {root}")
    try:
        path.mkdir(parents=True, exist_ok=True)
        used = any(path.iterdir()) and not (resumes and (path / resumes).is_file())
    except OSError as error:
        raise InputError(str(path), f"cannot be made ({error.strerror or error})", "a directory to write to") from None
    if used:
        raise InputError(str(path), "holds something already", "a new name")
    return output_directory(path)
