"""Recordings and reports below one directory, and nothing else: what is there, and the bytes of a file of it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
DEEPEST, MOST_ENTRIES, MOST_LISTED = 4, 20_000, 200
LOOK_EVERY = 2.0  # s
LARGEST = 64 << 20  # bytes of a file that is handed out


class Results:
    """The directory may come later. What is in it is looked for at most every LOOK_EVERY seconds."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._looked = -LOOK_EVERY
        self._listed: list[dict[str, Any]] = []

    def listed(self) -> list[dict[str, Any]]:
        """Newest first: `path` below the directory, `kind` report or recording, `bytes`, and `time` (s since 1970)."""
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
            if "metadata.yaml" in names:
                folders.clear()
                yield self._entry(Path(folder), "recording", sum(_size(Path(folder, name)) for name in names))
                continue
            for name in names:
                if name.endswith(REPORT):
                    path = Path(folder, name)
                    yield self._entry(path, "report", _size(path))

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
        if "\0" in name:
            return None
        try:
            root = self.root.resolve()
            path = (root / name.lstrip("/")).resolve()
            allowed = path.is_relative_to(root) and path.is_file() and path.stat().st_size <= LARGEST
        except (OSError, ValueError, RuntimeError):  # a name too long, a loop of links
            return None
        kind = TYPES.get(path.suffix.lower())
        return (path, kind) if allowed and kind else None


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:
        return 0
