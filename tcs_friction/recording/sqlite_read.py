"""Messages of a rosbag2 sqlite3 file, whole or damaged, in the order of their rows."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording.decode import Batch
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.storage import Damage

MAGIC = b"SQLite format 3\x00"
ROWS = 8192
"""Rows fetched at a time."""

BATCH_BYTES = 1 << 25
"""Payload bytes gathered before a batch is handed on."""

Row = tuple[int, int, int, bytes]


class SqliteScan:
    """One pass over one .db3 file. After `batches` has ended, `damage` and `channels` are complete."""

    def __init__(self, path: Path, damage: Damage) -> None:
        self.path = path
        self.damage = damage
        self.channels: dict[int, Channel] = {}
        self.read = 0
        self.stated: int | None = None

    def batches(self) -> Iterator[Batch]:
        """Every readable message, in batches of one channel each. Raises InputError if the topics are unreadable."""
        with _opened(self.path) as connection:
            try:
                self.channels = _channels(connection)
            except (sqlite3.Error, TypeError, ValueError) as error:
                raise InputError(str(self.path), f"its topics cannot be read: {error}", "a rosbag2 sqlite3 file") from None
            waiting: list[Row] = []
            size = 0
            for row in self._rows(connection):
                if len(row) == 4 and isinstance(row[3], bytes) and all(isinstance(cell, int) for cell in row[:3]):
                    waiting.append(row)
                    size += len(row[3])
                else:
                    self.damage.add("rows that are no messages", lost_messages=1)
                if size > BATCH_BYTES or len(waiting) >= 8 * ROWS:
                    yield from self._batches(waiting)
                    waiting, size = [], 0
            yield from self._batches(waiting)

    def _rows(self, connection: sqlite3.Connection) -> Iterator[Row]:
        """Rows by rising id; where a page is broken, ids after it are tried in growing strides."""
        query = "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id"
        last, stride = -(2**63), 1
        with suppress(sqlite3.Error):
            last = int(connection.execute("SELECT min(id) FROM messages").fetchone()[0] or 1) - 1
        broken = False
        while True:
            try:
                cursor = connection.execute(query, (last,))
                while rows := cursor.fetchmany(ROWS if not broken else 1):
                    for row in rows:
                        if not isinstance(row[0], int) or row[0] <= last:
                            raise sqlite3.DatabaseError("rows out of order")
                        last, stride = row[0], 1
                        yield row
                return
            except (sqlite3.Error, OverflowError, MemoryError):
                if broken:  # row by row up to here already
                    last, stride = last + stride, stride * 2
                else:
                    self.damage.add("broken database pages")
                    broken = True
                if stride > 1 << 40 or last > 1 << 50:
                    return

    def _batches(self, rows: list[Row]) -> Iterator[Batch]:
        if not rows:
            return
        topics = np.array([row[1] for row in rows], dtype=np.int64)
        times = np.array([row[2] for row in rows], dtype=np.int64)
        lengths = np.array([len(row[3]) for row in rows], dtype=np.int64)
        starts = np.concatenate(([0], np.cumsum(lengths)[:-1]))
        buffer = np.frombuffer(b"".join([row[3] for row in rows]), np.uint8)
        for number in np.unique(topics).tolist():
            chosen = np.flatnonzero(topics == number)
            if number not in self.channels:
                self.damage.add("messages whose topic is unknown", lost_messages=len(chosen))
                continue
            self.read += len(chosen)
            yield Batch(self.channels[number], buffer, times[chosen], starts[chosen], lengths[chosen])


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database, never written to; with a write-ahead log beside it, a copy that takes the log in."""
    log = path.with_name(f"{path.name}-wal")
    with tempfile.TemporaryDirectory() as scratch:
        options = "mode=ro&immutable=1"
        if broken := _broken_page(path):
            # sqlite would fill the rest of a page that the end of the file cuts with zeros and read on in them
            copy = Path(scratch, "cut.db3")
            shutil.copyfile(path, copy)
            os.truncate(copy, path.stat().st_size - broken)
            path = copy
        elif log.exists() and log.stat().st_size:
            shutil.copyfile(path, Path(scratch, "copy.db3"))
            shutil.copyfile(log, Path(scratch, "copy.db3-wal"))
            path, options = Path(scratch, "copy.db3"), "mode=rw"
        uri = f"{path.resolve().as_uri()}?{options}"
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            # Rows may not claim more than the file holds; a database shorter than its head says is read all the same.
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, 1 << 16))
            with suppress(sqlite3.Error):
                connection.execute("PRAGMA writable_schema = ON")
            connection.text_factory = lambda raw: raw.decode(errors="replace")
            yield connection


def _broken_page(path: Path) -> int:
    """Bytes of the last page if it is not whole, else 0."""
    with path.open("rb") as stream:
        size = int.from_bytes(stream.read(18)[16:18], "big")
    size = 65536 if size == 1 else size
    return path.stat().st_size % size if size >= 512 else 0


def _channels(connection: sqlite3.Connection) -> dict[int, Channel]:
    columns = {row[1] for row in connection.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    definitions: dict[str, tuple[str, str]] = {}
    with suppress(sqlite3.Error):
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        definitions = {str(name): (str(text), str(encoding)) for name, encoding, text in connection.execute(query)}
    rows = connection.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics").fetchall()
    return {
        number: Channel(topic, msgtype, encoding, *definitions.get(msgtype, ("", "")), str(profile or ""))
        for number, topic, msgtype, encoding, profile in rows
        if isinstance(number, int) and all(isinstance(cell, str) for cell in (topic, msgtype, encoding))
    }
