"""Recording message by message into a bag that grows: split by size or time, readable up to the last flush at any moment."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tcs_friction.errors import JobError
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.layout import CODES
from tcs_friction.recording.mcap_write import McapWriter
from tcs_friction.recording.write import StorageFile, write_metadata
from tcs_friction.writable import new_output

_NESTED = re.compile(r"^\s*((?:\w+/)*\w+)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+", re.MULTILINE)
_PRIMITIVES = frozenset((*CODES, "string", "wstring"))
_SEPARATOR = "=" * 80


class BagRecorder:
    """A bag directory being written. Times in ns; sizes in bytes; a limit of 0 never splits.

    metadata.yaml is written at the end; a bag whose recorder was killed has none and is read without it.
    Raises InputError if the directory exists or cannot be made. When the system takes no more, the call that notices raises
    JobError; what was recorded before stays readable, and all that is left to do is `close`.
    """

    def __init__(self, path: Path, compression: str = "", split_size: int = 0, split_duration: int = 0) -> None:
        self.path = new_output(path)
        self._compression = compression
        self._split_size = split_size
        self._split_duration = split_duration
        self._channels: list[tuple[Channel, str]] = []
        self._files: list[StorageFile] = []
        self._opened = 0
        self._begun = -1
        self._failed = False
        with self._writing():
            path.mkdir(parents=True)
            self._writer = self._open()

    @property
    def counts(self) -> dict[str, int]:
        """Messages so far by topic."""
        totals = dict.fromkeys((channel.topic for channel, _ in self._channels), 0)
        files = [file.counts for file in self._files]
        if len(self._files) == self._opened - 1:  # the last one is not finished
            files.append(tuple(self._writer.counts))
        for counts in files:
            for (channel, _), count in zip(self._channels, counts, strict=False):
                totals[channel.topic] += count
        return totals

    def add_topic(self, channel: Channel, type_hash: str = "") -> int:
        """Announce a topic; the number to write its messages with, the same in every file."""
        self._channels.append((channel, type_hash))
        return self._writer.add_channel(channel, type_hash)

    def write(self, number: int, log_time: int, payload: bytes) -> None:
        """One message, into the next file if this one is full."""
        if self._begun < 0:
            self._begun = log_time
        elif self._full(log_time):
            with self._writing():
                self._finish()
                self._writer = self._open()
            self._begun = log_time
        try:
            self._writer.write(number, log_time, payload)
        except OSError as error:  # no context manager: messages come by the thousand
            raise self._failure(error) from None

    def flush(self) -> None:
        """Everything so far survives the end of this process."""
        with self._writing():
            self._writer.flush()

    def close(self) -> None:
        """Finish the last file and write the metadata; after a failure as far as there is room for it."""
        failed_before = self._failed
        try:
            with self._writing():
                self._finish()
                write_metadata(self.path, [channel for channel, _ in self._channels], self._files)
        except JobError:
            if not failed_before:
                raise

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> JobError:
        self._failed = True
        return JobError(str(self.path), f"cannot be written any more ({error.strerror}); what came before is kept")

    def _full(self, log_time: int) -> bool:
        if self._split_duration and log_time - self._begun >= self._split_duration:
            return True
        return bool(self._split_size) and self._writer.pending_size >= self._split_size

    def _open(self) -> McapWriter:
        writer = McapWriter(self.path / f"{self.path.name}_{self._opened}.mcap", self._compression)
        self._opened += 1
        for channel, type_hash in self._channels:
            writer.add_channel(channel, type_hash)
        return writer

    def _finish(self) -> None:
        writer = self._writer
        if writer.closed:
            return
        try:
            writer.close()
        finally:
            self._files.append(StorageFile(writer.path.name, writer.start, writer.end, tuple(writer.counts)))


def definition_text(msgtype: str, find: Callable[[str], str | None]) -> str:
    """A type's definition with all that it is made of, as bags hold it; "" if one part cannot be found.

    find: the .msg text of a type (`package/msg/Name`), None if there is none.
    """
    parts: dict[str, str] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop(0)
        if name in parts:
            continue
        text = find(name)
        if text is None:
            return ""
        parts[name] = text
        waiting.extend(_nested(text, name.split("/")[0]))
    first, *others = parts.items()
    blocks = [f"{_SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{text}" for name, text in others]
    return "\n".join([first[1], *blocks])


def _nested(text: str, package: str) -> list[str]:
    lines = "\n".join(line.split("#")[0] for line in text.splitlines())
    found = []
    for name in _NESTED.findall(lines):
        parts = name.split("/")
        if parts[0] not in _PRIMITIVES:
            found.append(f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}")
    return found
