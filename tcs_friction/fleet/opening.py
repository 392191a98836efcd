"""A recording opened, wherever it lies: as it is, streamed by its own index, or from a copy in a temporary folder.

Streamed are whole mcap files: only the chunks with wanted topics are fetched. Everything else that is not on a local disk
(sqlite3, ROS 1, tables, damaged mcap files) is copied for as long as it is worked on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path, PurePosixPath

from tcs_friction.errors import TcsError, one_line
from tcs_friction.fleet.sources import METADATA, Found, filesystem
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.mcap_index import IndexedBag, NoIndexError


@contextmanager
def opened(found: Found, by_index: bool = False) -> Iterator[Bag | IndexedBag]:
    """A bag to read. by_index: also of a local file only what is wanted. Raises InputError when it is none."""
    with ExitStack() as stack:
        bag: Bag | IndexedBag | None = None
        if by_index or not found.local:
            bag = _indexed(found, stack)
        yield bag if bag is not None else Bag(stack.enter_context(at_hand(found)))


@contextmanager
def at_hand(found: Found) -> Iterator[Path]:
    """Where the recording lies on a local disk."""
    first = found.files[0].path
    if found.local:
        yield Path(first).parent if found.folder else Path(first)
        return
    fs = filesystem(found.protocol)
    with tempfile.TemporaryDirectory(prefix="tcs-friction-") as scratch:
        folder = Path(scratch)
        for file in found.files:
            fs.get_file(file.path, str(folder / PurePosixPath(file.path).name))
        yield folder if found.folder else folder / PurePosixPath(first).name


def _indexed(found: Found, stack: ExitStack) -> IndexedBag | None:
    files = [file for file in found.files if PurePosixPath(file.path).name != METADATA]
    if not all(file.path.endswith(".mcap") for file in files):
        return None
    fs = filesystem(found.protocol)
    streams = [stack.enter_context(fs.open(file.path, "rb", cache_type="none")) for file in files]
    opened_files = [(file.path, stream, file.size) for file, stream in zip(files, streams, strict=True)]
    try:
        return IndexedBag(found.name, opened_files)
    except NoIndexError:
        return None


def reason_of(error: BaseException, found: Found) -> str:
    """Why a recording failed, in one line that does not depend on where a copy of it lay."""
    if isinstance(error, TcsError):
        told = f"{error.found}, expected {error.expected}" if error.expected else error.found
        named = [PurePosixPath(file.path).name for file in found.files]
        part = next((name for name in named if name != METADATA and error.where.endswith(name)), "")
        return one_line(f"{part}: {told}" if part and found.folder else told)
    return one_line(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)
