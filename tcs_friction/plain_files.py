"""Ordinary files: a pipe into which nobody writes would hold its reader for ever, and a device may have no end."""

from __future__ import annotations

import stat
from pathlib import Path

from tcs_friction.errors import InputError


def plain_file(path: Path, what: str) -> Path:
    """The path, if it is an ordinary file; `what` is expected there. Raises InputError for anything else."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise InputError(str(path), "no such file", what) from None
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be read ({_reason(error)})", what) from None
    if stat.S_ISDIR(mode):
        raise InputError(str(path), "is a directory", what)
    if not stat.S_ISREG(mode):
        raise InputError(str(path), "is no regular file", what)
    return path


def read_plain(path: Path, most: int, what: str) -> bytes:
    """The first `most` bytes of an ordinary file. Raises InputError where it is none, or cannot be read."""
    try:
        with plain_file(path, what).open("rb") as stream:
            return stream.read(most)
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({_reason(error)})", what) from None


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
