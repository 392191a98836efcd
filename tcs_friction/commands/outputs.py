"""Where results go: what is checked of it before any work."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tcs_friction.errors import InputError


def never_over_an_input(outputs: Iterable[Path], inputs: Iterable[Path | None]) -> None:
    """Raises InputError if a file that would be written is one of the files read, also through a link.

    inputs: files, bags that are directories (all that lies in them counts), None for what was not given.
    """
    read = [path for given in inputs if given is not None for path in _files(given)]
    for output in outputs:
        for path in read:
            if _same(output, path):
                raise InputError(str(output), f"would be written over the input {path}", "another place for the results (-o)")


def results_over_no_input(directory: Path, names: Iterable[str], inputs: Iterable[Path | None]) -> None:
    """The same for a directory of results: files of these names, and pictures of whatever name."""
    never_over_an_input([*(directory / name for name in names), *directory.glob("*.png")], inputs)


def _files(given: Path) -> list[Path]:
    """A file, or the files of a bag."""
    try:
        return [given, *given.iterdir()] if given.is_dir() else [given]
    except OSError:  # said by the reader, in words
        return [given]


def _same(output: Path, given: Path) -> bool:
    try:
        return output.samefile(given)
    except OSError:  # the output does not exist yet
        return False
