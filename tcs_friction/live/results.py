"""Recordings and reports below one directory, and nothing else: what is there, and the bytes of a file of it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tcs_friction.errors import TcsError
from tcs_friction.recording.info import bag_info, info_text

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".json": "application/json",
    ".yaml": "text/plain; charset=utf-8",
    ".csv": "text/plain; charset=utf-8",
}
"""Files that are handed out. Everything else is not there."""
REPORT = ".html"
LISTED = {"identification.json": "identification"}
"""Files without a report beside them that are listed as well, and as what."""
BAG = "metadata.yaml"
DEEPEST, MOST_ENTRIES, MOST_LISTED = 4, 20_000, 200
LOOK_EVERY = 2.0  # s
LARGEST = 64 << 20  # bytes of a file that is handed out
LARGEST_BAG = 256 << 20  # bytes of a recording that is looked through


class Results:
    """The directory may come later. What is in it is looked for at most every LOOK_EVERY seconds."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._looked = -LOOK_EVERY
        self._listed: list[dict[str, Any]] = []

    def listed(self) -> list[dict[str, Any]]:
        """Newest first: `path` below the directory, `kind`, `bytes`, and `time` (s since 1970)."""
        now = time.monotonic()
        if now - self._looked >= LOOK_EVERY:
            self._looked = now
            found = sorted(self._entries(), key=lambda entry: (-entry["time"], entry["path"]))
            self._listed = found[:MOST_LISTED]
        return self._listed

    def _entries(self) -> Iterator[dict[str, Any]]:
        """Walks without following links, not too deep and not too long."""
        seen = 0
        for folder, folders, names in os.walk(self.root):
            depth = len(Path(folder).relative_to(self.root).parts)
            folders[:] = sorted(name for name in folders if not name.startswith(".")) if depth < DEEPEST else []
            seen += len(folders) + len(names)
            if seen > MOST_ENTRIES:
                return
            if BAG in names:
                folders.clear()
                yield self._entry(Path(folder), "recording", sum(_size(Path(folder, name)) for name in names))
                continue
            for name in names:
                kind = "report" if name.endswith(REPORT) else LISTED.get(name)
                if kind and not (name in LISTED and "report.html" in names):
                    path = Path(folder, name)
                    yield self._entry(path, kind, _size(path))

    def _entry(self, path: Path, kind: str, size: int) -> dict[str, Any]:
        try:
            changed = path.lstat().st_mtime
        except OSError:  # gone meanwhile
            changed = 0.0
        return {"path": str(path.relative_to(self.root)), "kind": kind, "bytes": size, "time": round(changed)}

    def file(self, name: str) -> tuple[Path, str] | None:
        """A file below the directory that may be handed out, and its media type; None for anything else.

        Links are followed before it is decided what is below.
        """
        path = self._below(name)
        kind = TYPES.get(path.suffix.lower()) if path else None
        return (path, kind) if path and kind and path.is_file() and _size(path) <= LARGEST else None

    def recording(self, name: str) -> Path | None:
        """A recording below the directory, all of whose files are below it, too; None for anything else."""
        path = self._below(name)
        if path is None or not (path / BAG).is_file():
            return None
        inside = (self._below(str(Path(name, file.name))) for file in path.iterdir())
        return path if all(inside) else None

    def _below(self, name: str) -> Path | None:
        """Where a name leads, links followed; None where nothing is there or it is not below the directory."""
        try:
            root = self.root.resolve(strict=True)
            path = (root / name.lstrip("/")).resolve(strict=True)
        except (OSError, ValueError, RuntimeError):  # not there, a name too long or with a zero, a loop of links
            return None
        return path if path.is_relative_to(root) and path != root else None


def contents_of(recording: Path) -> str:
    """What is in a recording, for people; in a word why not where that cannot be told."""
    size = sum(_size(path) for path in recording.iterdir())
    if size > LARGEST_BAG:
        return f"{size / 1e6:.0f} MB are too much to be looked through here. On the machine itself: ./tcs bag info {recording}\n"
    try:
        return info_text(bag_info(recording)) + "\n"
    except TcsError as error:
        return f"{error}\n"


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:
        return 0
