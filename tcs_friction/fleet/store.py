"""What a run keeps in OUT: its rows, and what the first looks saw; a folder, or an object store by its URL.

    OUT/rows/axis=NAME/month=YYYY-MM/   rows as they are finished, a file each; one file for all once a run is over
    OUT/looks.jsonl                     the first looks: a cache, which may be lost

A file appears whole or not at all. A row is in its file before it counts as done, so a run that is killed goes on from there. One
that cannot be read is told of and set aside under another name; what was in it is worked on again.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import json
import os
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from fsspec.core import url_to_fs
from pyarrow import ArrowException, parquet
from pyarrow.dataset import dataset

from tcs_friction.errors import InputError, JobError
from tcs_friction.fleet.look import Look
from tcs_friction.fleet.rows import FILE_SCHEMA, PARTITIONING, SCHEMA, Row, from_table, to_table

LOOKS = "looks.jsonl"
KEY = ["axis", "month", "recording", "piece", "input_hash", "version", "status"]
UNREADABLE = ".unreadable"  # behind the name of a file that is set aside
SEEN_EVERY = 30.0  # s between two writings of the looks, or longer where writing them takes long


@dataclass(frozen=True)
class Kept:
    """Where a row lies and what it is of."""

    axis: str
    month: str
    recording: str
    piece: int
    input_hash: str
    version: str
    status: str

    @property
    def identity(self) -> tuple[str, str, int]:
        """What makes two rows the same work."""
        return self.input_hash, self.version, self.piece


class Store:
    """A place for the results of runs. Raises InputError when it cannot be reached or written, or another run is at it."""

    def __init__(self, out: str) -> None:
        self.out = out
        self.notes: list[str] = []
        self._looks: dict[str, Look] = {}
        self._written = (0.0, 0.0)  # when the looks were written last, and how long that took
        try:
            self.fs, self.root = url_to_fs(out)
            self.local = "file" in self.fs.protocol
            self.fs.makedirs(self._path("rows"), exist_ok=True)
            self._read_looks()
        except Exception as error:  # every store has its own
            raise InputError(out, f"cannot be written ({_said(error)})", "a folder or URL to write to") from None

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Within, no other run on this machine writes here; of object stores nobody can say that."""
        if not self.local:
            yield
            return
        with open(self._path(".lock"), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InputError(self.out, "another run is writing there", "one run at a time") from None
            yield

    def _path(self, name: str) -> str:
        return f"{self.root.rstrip('/')}/{name}"

    # rows

    def kept(self) -> list[Kept]:
        """Every row that is there."""
        return [Kept(**row) for row in self._table(self._files("rows"), KEY).to_pylist()]

    def _table(self, paths: list[str], columns: Sequence[str] = SCHEMA.names) -> Any:
        """What is in these files, those set aside that cannot be read."""
        try:
            return self._read(paths, columns)
        except (OSError, ArrowException):
            return self._read([path for path in paths if not self._set_aside(path)], columns)

    def _set_aside(self, path: str) -> bool:
        """Whether a file had to be given another name, since it cannot be read."""
        try:
            self._read([path])
        except (OSError, ArrowException) as error:
            self.notes.append(f"{path}: cannot be read ({_said(error)}), set aside; what was in it is worked on again")
            self.fs.mv(path, f"{path}{UNREADABLE}")
            return True
        return False

    def _read(self, paths: list[str], columns: Sequence[str] = SCHEMA.names) -> Any:
        found = dataset(
            paths, schema=SCHEMA, filesystem=self.fs, format="parquet", partitioning=PARTITIONING,
            partition_base_dir=self._path("rows"), exclude_invalid_files=False,
        )  # fmt: skip
        return found.to_table(columns=list(columns))

    def write(self, row: Row) -> None:
        """Keep one row."""
        digest = hashlib.sha256(f"{row.recording}\n{row.input_hash}\n{row.version}\n{row.piece}".encode())
        self._write_rows(self._partition(row.axis, row.month), f"{digest.hexdigest()[:24]}.parquet", [row])

    def _partition(self, axis: str, month: str) -> str:
        return self._path(f"rows/axis={_quoted(axis)}/month={_quoted(month)}")

    def _write_rows(self, folder: str, name: str, rows: Iterable[Row]) -> None:
        table = to_table(rows).select(FILE_SCHEMA.names)
        sink = io.BytesIO()
        parquet.write_table(table, sink, compression="zstd")
        self._write(f"{folder}/{name}", sink.getvalue())

    def row(self, kept: Kept) -> Row | None:
        """The whole row, None if it has gone."""
        for row in self.rows_beside(kept):
            if (row.recording, row.input_hash, row.version, row.piece) == (kept.recording, *kept.identity):
                return row
        return None

    def rows_beside(self, kept: Kept) -> list[Row]:
        """All rows of its axis and month."""
        return from_table(self._table(self._files_in(self._partition(kept.axis, kept.month))))

    def settle(self, superseded: Collection[Kept]) -> None:
        """Leave each row once, none of `superseded`, and one file for each axis and month."""
        gone = set(superseded)
        folders: dict[str, list[str]] = {}
        for path in self._files("rows"):
            folders.setdefault(path.rpartition("/")[0], []).append(path)
        for folder, paths in sorted(folders.items()):
            touched = any(folder == self._partition(kept.axis, kept.month) for kept in gone)
            if len(paths) > 1 or touched:
                self._settle_folder(folder, paths, gone)

    def _settle_folder(self, folder: str, paths: list[str], gone: set[Kept]) -> None:
        rows = {_kept(row): row for row in from_table(self._table(paths))}
        current = (row for kept, row in rows.items() if kept not in gone)
        left = sorted(current, key=lambda row: (row.start, row.recording, row.piece))
        name = ""
        if left:
            text = "\n".join(map(repr, left))
            name = f"rows-{hashlib.sha256(text.encode()).hexdigest()[:24]}.parquet"
            self._write_rows(folder, name, left)
        for path in paths:
            if (not name or not path.endswith(f"/{name}")) and self.fs.exists(path):  # else it is set aside
                self.fs.rm_file(path)

    # looks

    def look(self, key: str) -> Look | None:
        """What was seen of a recording, by `Found.look`."""
        return self._looks.get(key)

    def keep_look(self, look: Look) -> None:
        """Remember it; written now and then."""
        self._looks[look.key] = look
        at, took = self._written
        if time.monotonic() - at > max(SEEN_EVERY, 20.0 * took):
            self.write_looks()

    def write_looks(self) -> None:
        """Write all of them."""
        began = time.monotonic()
        text = "".join(f"{json.dumps(asdict(look))}\n" for look in self._looks.values())
        self._write(self._path(LOOKS), text.encode())
        self._written = (time.monotonic(), time.monotonic() - began)

    def _read_looks(self) -> None:
        self._written = (time.monotonic(), 0.0)
        if not self.fs.exists(self._path(LOOKS)):
            return
        with contextlib.suppress(ValueError, TypeError, KeyError):  # a cache
            for line in self.fs.cat_file(self._path(LOOKS)).decode().splitlines():
                content = json.loads(line)
                look = Look(**content | {name: tuple(content[name]) for name in ("axes", "starts", "samples")})
                self._looks[look.key] = look

    # files

    def _files(self, name: str) -> list[str]:
        self.fs.invalidate_cache()
        return sorted(path for path in self.fs.find(self._path(name)) if path.endswith(".parquet"))

    def _files_in(self, folder: str) -> list[str]:
        return [path for path in self._files("rows") if path.rpartition("/")[0] == folder]

    def _write(self, path: str, content: bytes) -> None:
        try:
            if not self.local:
                self.fs.pipe_file(path, content)  # an object appears whole
                return
            folder, _, name = path.rpartition("/")
            os.makedirs(folder, exist_ok=True)
            scratch = f"{folder}/.{name}.{os.getpid()}.part"
            try:
                with open(scratch, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(scratch, path)
            finally:
                with contextlib.suppress(OSError):
                    os.unlink(scratch)
        except Exception as error:
            raise JobError(self.out, f"cannot be written ({_said(error)})") from None


def _kept(row: Row) -> Kept:
    return Kept(row.axis, row.month, row.recording, row.piece, row.input_hash, row.version, row.status)


def _quoted(text: str) -> str:
    from urllib.parse import quote

    return quote(text, safe="")


def _said(error: Exception) -> str:
    return (getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__)[:300]
