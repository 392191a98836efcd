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
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.decode import Batch
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.storage import MAX_TOPICS, Damage, by_number

MAGIC = b"SQLite format 3\x00"
BATCH_ROWS = 1 << 16
BATCH_BYTES = 1 << 25
"""Rows, or payload bytes, gathered before a batch is handed on."""

STEPS_BROKEN = 20
"""Steps (see Allowance) of a query that starts behind a broken page."""

ALLOWED = (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_PRAGMA)
"""What may be done with a database: a view, a virtual table or a computed column could run for ever."""

Row = tuple[int, int, int, bytes]


class SqliteScan:
    """One pass over one .db3 file. After `batches` has ended, `damage` and `channels` are complete."""

    def __init__(self, path: Path, damage: Damage, allowance: Allowance) -> None:
        self.path = path
        self.damage = damage
        self.allowance = allowance
        self.channels: dict[int, Channel] = {}
        self.read = 0
        self.stated: int | None = None

    def batches(self) -> Iterator[Batch]:
        """Every readable message, in batches of one channel each. Raises InputError if the topics are unreadable."""
        with _opened(self.path) as connection:
            try:
                self.channels = _channels(connection, self.damage)
                _check_messages(connection)
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
                if size > BATCH_BYTES or len(waiting) >= BATCH_ROWS:
                    yield from self._batches(waiting)
                    waiting, size = [], 0
            yield from self._batches(waiting)

    def _rows(self, connection: sqlite3.Connection) -> Iterator[Row]:
        """Rows by rising id; where a page is broken, ids after it are tried in growing strides."""
        query = "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id"
        last, stride = -(2**63), 1
        with suppress(sqlite3.Error, TypeError, ValueError):
            last = int(connection.execute("SELECT id FROM messages ORDER BY id LIMIT 1").fetchone()[0]) - 1
        broken = False
        while True:
            try:
                for row in connection.execute(query, (last,)):
                    if not isinstance(row[0], int) or row[0] <= last:
                        raise sqlite3.DatabaseError("rows out of order")
                    if not self.allowance.unpack(len(row[3]) if isinstance(row[3], bytes) else 0):
                        self.damage.add("rows that claim more than the file holds")
                        return
                    last, stride = row[0], 1
                    yield row
                return
            except (sqlite3.Error, OverflowError, MemoryError):
                self.allowance.spend(STEPS_BROKEN)
                if broken:
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
        for number, chosen in by_number(topics):
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
            connection.set_authorizer(_authorize)
            connection.text_factory = lambda raw: raw.decode(errors="replace")
            yield connection


def _broken_page(path: Path) -> int:
    """Bytes of the last page if it is not whole, else 0."""
    with path.open("rb") as stream:
        size = int.from_bytes(stream.read(18)[16:18], "big")
    size = 65536 if size == 1 else size
    return path.stat().st_size % size if size >= 512 else 0


def _authorize(action: int, _first: str | None, _second: str | None, _database: str | None, inside: str | None) -> int:
    """Refuse everything but reading tables; `inside` names the view or trigger that asks."""
    return sqlite3.SQLITE_OK if action in ALLOWED and inside is None else sqlite3.SQLITE_DENY


def _columns(connection: sqlite3.Connection, table: str) -> dict[str, tuple[str, int]]:
    """Type and place in the primary key (0: none) of each stored column. Raises ValueError if it is no ordinary table."""
    stored = "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = ? AND rootpage > 0"
    if connection.execute(stored, (table,)).fetchone() is None:
        raise ValueError(f"{table} is no ordinary table")
    rows = connection.execute(f"PRAGMA table_xinfo({table})")
    return {name: (str(kind).upper(), key) for _, name, kind, _, _, key, hidden in rows if not hidden}


def _check_messages(connection: sqlite3.Connection) -> None:
    """Raises ValueError unless messages can be read in the order of their ids as they lie there."""
    columns = _columns(connection, "messages")
    missing = {"id", "topic_id", "timestamp", "data"} - columns.keys()
    keys = [name for name, (_, key) in columns.items() if key]
    if missing or keys != ["id"] or columns["id"][0] != "INTEGER":
        raise ValueError("messages is not the table that rosbag2 makes")


def _channels(connection: sqlite3.Connection, damage: Damage) -> dict[int, Channel]:
    columns = _columns(connection, "topics")
    if missing := {"id", "name", "type", "serialization_format"} - columns.keys():
        raise ValueError(f"topics lacks {', '.join(sorted(missing))}")
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    definitions: dict[str, tuple[str, str]] = {}
    with suppress(sqlite3.Error, ValueError):
        _columns(connection, "message_definitions")
        query = f"SELECT topic_type, encoding, encoded_message_definition FROM message_definitions LIMIT {MAX_TOPICS}"
        definitions = {str(name): (str(text), str(encoding)) for name, encoding, text in connection.execute(query)}
    query = f"SELECT id, name, type, serialization_format, {qos} FROM topics LIMIT {MAX_TOPICS}"
    found = {
        number: damage.channel(topic, msgtype, encoding, *definitions.get(msgtype, ("", "")), str(profile or ""))
        for number, topic, msgtype, encoding, profile in connection.execute(query)
        if isinstance(number, int) and all(isinstance(cell, str) for cell in (topic, msgtype, encoding))
    }
    return {number: channel for number, channel in found.items() if channel is not None}
