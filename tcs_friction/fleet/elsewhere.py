"""Results of a fleet that are kept elsewhere than on this machine, for whoever only reads them."""

from __future__ import annotations

from typing import Any

from fsspec.core import url_to_fs
from pyarrow.fs import FSSpecHandler, PyFileSystem

from tcs_friction.errors import InputError


def storage_of(url: str) -> tuple[Any, str]:
    """pyarrow's file system of a URL and the path in it. Raises InputError where there are no results of a fleet."""
    try:
        found, path = url_to_fs(url)
        there = found.exists(f"{path.rstrip('/')}/rows")
    except Exception as error:  # a plug-in for each kind of storage raises its own
        raise InputError(url, f"cannot be opened ({error})", "a URL that fsspec knows") from None
    if not there:
        raise InputError(url, "holds no results of a fleet", "the OUT of ./tcs fleet PATHS... -o OUT")
    return PyFileSystem(FSSpecHandler(found)), path
