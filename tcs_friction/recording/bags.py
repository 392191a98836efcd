"""Bags in: every recording that rosbag2 or ROS 1 wrote, whole or damaged, becomes a Recording."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tcs_friction.errors import InputError, nearest, printable
from tcs_friction.recording import mcap_read, ros1_read, sqlite_read
from tcs_friction.recording.align import align
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.decode import Batch, topic_columns
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.joints import joints_of, signals_of
from tcs_friction.recording.mcap_index import IndexedBag
from tcs_friction.recording.mending import DAMAGED, mended, refuse_mended
from tcs_friction.recording.metadata import listed_files
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.storage import ZSTD_MAGIC, Damage, UnpackError, unpack, unpack_file, zstd
from tcs_friction.recording.table_files import is_table, read_table, refuse_foreign
from tcs_friction.recording.table_roles import joint_names
from tcs_friction.recording.tables import import_table

Scan = mcap_read.McapScan | sqlite_read.SqliteScan | ros1_read.Ros1Scan
SCANS: dict[bytes, type[Scan]] = {
    mcap_read.MAGIC: mcap_read.McapScan,
    sqlite_read.MAGIC: sqlite_read.SqliteScan,
    ros1_read.MAGIC: ros1_read.Ros1Scan,
}
SUFFIXES: dict[str, type[Scan]] = {
    ".mcap": mcap_read.McapScan, ".db3": sqlite_read.SqliteScan, ".bag": ros1_read.Ros1Scan
}  # fmt: skip

NOTHING_CHOSEN = Choice()

MOST_MISSING = 5
"""Missing files named in a note."""


def read_recordings(
    bags: Sequence[Path], signals: SignalMap, choice: Choice = NOTHING_CHOSEN, kind: str | None = None
) -> tuple[Recording, ...]:
    """One recording a bag or table, whose columns are told by their names, as `choice` has it. kind: of the axis, if it is known.

    Raises InputError when a bag is none, or lacks a topic, field or joint, when a table lacks a column, when the torques of
    several are in units that do not convert, and when something is mended that must not be.
    """
    own = chosen_signals(bags, signals, choice)
    return agreeing(tuple(map(partial(_recording, own, choice, kind), map(Path, bags))), choice)


def chosen_signals(bags: Sequence[Path], signals: SignalMap, choice: Choice) -> SignalMap:
    """The signals of the joint that is meant, in all bags that of the first one. Raises InputError for a number that none has."""
    first = next((path for path in map(Path, bags) if not is_table(path)), None)
    if first is None or choice.settled or not choice.joint:
        return signals
    return signals_of(Bag(first), signals, choice.joint)


def joints_in(path: Path, signals: SignalMap | None, choice: Choice = NOTHING_CHOSEN) -> tuple[str, ...]:
    """The joints of a bag or table, by name or, of arrays without names, number. signals: of one of them, in a bag.

    Raises InputError where there are none.
    """
    if is_table(path) or signals is None:
        names = joint_names(read_table(path), choice.columns, str(path))
    else:
        names = joints_of(Bag(path), signals)
    if not names:
        raise InputError(str(path), "names no joints", "positions and torques of several")
    return names


def agreeing(recordings: Sequence[Recording], choice: Choice) -> tuple[Recording, ...]:
    """Recordings as one data set. Raises InputError where their torques are in other units, or one was mended under --strict."""
    same_torque_unit(recordings)
    if choice.strict:
        refuse_mended(recordings)
    return tuple(recordings)


def _recording(signals: SignalMap, choice: Choice, kind: str | None, path: Path) -> Recording:
    if is_table(path):
        return import_table(path, choice.joint, choice.columns, signals, kind).recording
    if choice.columns:
        raise InputError("--column", f"given for {path}", "a table")
    bag = Bag(path)
    sources = [source for _, source in signals.named()]
    columns, notes = read_columns(bag, sources)
    return align(columns, signals, str(bag.path), notes)


def read_columns(bag: Bag | IndexedBag, sources: Collection[SignalSource]) -> tuple[dict[str, TopicColumns], list[str]]:
    """The columns of every topic that `sources` name, and what was found on the way.

    Raises InputError naming the nearest topic, field or joint when one does not exist or is empty.
    """
    wanted: dict[str, list[SignalSource]] = {}
    for source in sources:
        wanted.setdefault(source.topic, []).append(source)
    notes: list[str] = []
    columns = topic_columns(bag.batches(wanted), wanted, str(bag.path), notes, bag.allowance)
    known = {channel.topic for channel in bag.channels}
    for topic in wanted:
        if topic not in known:
            expected = nearest(topic, known) if known else f"topics in it{bag.lament()}"
            raise InputError(str(bag.path), f"no topic {topic}", expected)
        if topic not in columns:
            raise InputError(str(bag.path), f"no message on {topic}{bag.lament()}", "some")
    return columns, [*bag.notes, *notes]


@dataclass
class Bag:
    """The storage files of one recording, read forward as often as `batches` is called.

    After `batches` has ended, `channels` has every topic met, `damage` what was lost, `notes` both in words.
    Raises InputError when the path is no bag.
    """

    path: Path
    channels: set[Channel] = field(default_factory=set)
    damage: Damage = field(default_factory=Damage)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.path.exists():
            raise InputError(str(self.path), "does not exist", "a bag (a directory, .mcap, .db3 or .bag)")
        self.files = [self.path]
        self.stated: int | None = None
        self._file_notes: list[str] = []
        self._abandoned = False
        if self.path.is_dir():
            self.files = self._listed()
        elif not self.path.is_file():
            raise InputError(str(self.path), "is no regular file", "a bag (a directory, .mcap, .db3 or .bag)")
        self.allowance = Allowance(str(self.path), sum(path.stat().st_size for path in self.files))

    def lament(self) -> str:
        """The damage for the end of an error message."""
        return f" ({self.damage})" if self.damage else ""

    def abandon(self) -> None:
        """End a reading that is under way in another thread, at its next piece of the file."""
        self._abandoned = True

    def batches(self, topics: Collection[str] | None = None) -> Iterator[Batch]:
        """Messages of the topics (None: all) in the order in which the files hold them, unpacked."""
        self.channels, self.damage, read = set(), Damage(), 0
        joined: list[str] = []
        self.allowance.renew()
        for path in self.files:
            with self._plain(path) as plain:
                scan = self._scan(path, plain)
                if scan is None:
                    continue
                for batch in scan.batches():
                    if self._abandoned:
                        return
                    if topics is None or batch.channel.topic in topics:
                        yield self._unpacked(batch)
                self.channels.update(scan.channels.values())
                if isinstance(scan, mcap_read.McapScan) and scan.files > 1:
                    self.channels.update(scan.earlier)
                    joined.append(mended(f"{path.name}: {scan.files} mcap files one behind the other, all read"))
                read += scan.read
        if self.damage and self.damage.unsure and self.stated is not None and self.stated >= read:
            self.damage.lost_messages, self.damage.unsure = self.stated - read, False
        self.notes = [printable(note) for note in (*self._file_notes, *joined, *([str(self.damage)] if self.damage else []))]
        if not self.channels:
            raise InputError(str(self.path), f"nothing whole in it{self.lament()}", "a recording with messages")

    def _scan(self, path: Path, plain: Path) -> Scan | None:
        """The reader for a file, by its first bytes, else its suffix; None if it is lost beside others."""
        with plain.open("rb") as stream:
            head = stream.read(16)
        suffix = path.suffix if path.suffix != ".zstd" else Path(path.stem).suffix
        kind = next((kind for magic, kind in SCANS.items() if head.startswith(magic)), SUFFIXES.get(suffix))
        size = plain.stat().st_size
        found = "" if kind else f"begins with {head[:8]!r}"
        if not size:
            found = "is empty (0 bytes)" if plain == path else "cannot be unpacked"
        if kind is sqlite_read.SqliteScan and head != sqlite_read.MAGIC:
            found = found or "is no sqlite3 database"
        if found and len(self.files) == 1:
            refuse_foreign(path, head)
            raise InputError(str(path), found, "a rosbag2 mcap or sqlite3 file, or a ROS 1 bag")
        if found:
            self.damage.add(f"{path.name} {found}")
            return None
        assert kind is not None
        return kind(plain, self.damage, self.allowance)

    def _listed(self) -> list[Path]:
        """The files of a directory: those its metadata names, else all that look like storage."""
        present = sorted((p for p in self.path.iterdir() if _is_storage(p)), key=_natural)
        metadata = self.path / "metadata.yaml"
        if not metadata.exists():
            if (self.path / "meta" / "info.json").is_file():
                raise InputError(str(self.path), "is a LeRobot data set", "one of its files, data/chunk-000/....parquet")
            if not present:
                raise InputError(str(self.path), "is a directory without metadata.yaml, .mcap, .db3 or .bag files", "a bag")
            self._file_notes.append(f"metadata.yaml is missing; {len(present)} storage files found by name")
            return present
        try:
            names, self.stated = listed_files(metadata)
            named = [path for name in names if (path := self.path / name).name == name]
        except InputError as error:
            broken = f"metadata.yaml is broken ({error.found}); {len(present)} storage files found by name"
            self._file_notes.append(mended(broken))
            named = present
        files = [path for path in named if path.is_file()]
        if missing := [path.name for path in named if path not in files]:
            shown = ", ".join(missing[:MOST_MISSING]) + (f" and {more} more" if (more := len(missing) - MOST_MISSING) > 0 else "")
            self._file_notes.append(f"{DAMAGED}{shown} missing, the rest read")
        files = files or present
        if not files:
            raise InputError(str(self.path), "none of its storage files exists", "the files that metadata.yaml names")
        return files

    @contextmanager
    def _plain(self, path: Path) -> Iterator[Path]:
        """The storage file itself, or an unpacked copy if the whole file is compressed."""
        with path.open("rb") as stream:
            if stream.read(4) != ZSTD_MAGIC:
                yield path
                return
        with tempfile.TemporaryDirectory() as scratch:
            plain = Path(scratch, path.stem)
            with path.open("rb") as packed, plain.open("wb") as out:
                if not unpack_file(packed, out, self.allowance):
                    self.damage.add(f"{path.name} cannot be unpacked to its end")
            yield plain

    def _unpacked(self, batch: Batch) -> Batch:
        """The batch with messages decompressed, if they are compressed one by one."""
        if batch.channel.encoding != "cdr" or not len(batch):
            return batch
        first = int(batch.starts[0])
        if batch.buffer[first : first + 4].tobytes() != ZSTD_MAGIC:
            return batch
        whole, parts = [], []
        for index, payload in enumerate(batch.payloads()):
            try:
                parts.append(self._message(payload))
                whole.append(index)
            except UnpackError:
                self.damage.add("messages that cannot be unpacked", len(payload), 1)
        lengths = np.array([len(part) for part in parts], dtype=np.int64)
        starts = np.cumsum(lengths) - lengths
        buffer = np.frombuffer(b"".join(parts), np.uint8)
        times = batch.log_times[whole]
        return Batch(batch.channel, buffer, times, starts, lengths, unpacked_from=batch.buffer)

    def _message(self, payload: bytes) -> bytes:
        """One message out of its own zstd frame."""
        self.allowance.spend(1)
        try:
            size = zstd.get_frame_info(payload).decompressed_size
        except (zstd.ZstdError, ValueError):
            raise UnpackError("broken head") from None
        return unpack(payload, "zstd", size if size is not None else 0, self.allowance)


def _is_storage(path: Path) -> bool:
    suffix = Path(path.stem).suffix if path.suffix == ".zstd" else path.suffix
    return suffix in SUFFIXES and path.is_file()


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts bag_10 after bag_9."""
    return [(int(part or 0), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", path.name)]
