"""What a long job has done so far, in a file beside its results, so that the job can go on after a restart."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tcs_friction.config import write_whole
from tcs_friction.errors import InputError

STATE = "commission_state.json"
SCHEMA = "tcs_friction/commission_state/1"


class Journal:
    """Stages by name, each noted when its results are there. Without a directory nothing outlives the job."""

    def __init__(self, directory: Path | None, settings: Mapping[str, Any]) -> None:
        """Go on with what the directory has, or begin.

        Raises InputError when it was begun with other settings, or when its state cannot be read.
        """
        self._path = None if directory is None else directory / STATE
        self._settings = json.loads(json.dumps(settings))
        self._done: dict[str, Any] = {}
        if self._path is not None and self._path.is_file():
            self._done = self._read(self._path)

    def _read(self, path: Path) -> dict[str, Any]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            settings, done = dict(content["settings"]), dict(content["done"])
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(str(path), "is no state of a commissioning", "another name for the results") from None
        changed = sorted(name for name in {*settings, *self._settings} if settings.get(name) != self._settings.get(name))
        if content.get("schema") != SCHEMA or changed:
            found = f"begun with other settings ({', '.join(changed) or 'of another version'})"
            raise InputError(str(path.parent), found, "the same settings, or another name for the results")
        return done

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages that are done."""
        return tuple(self._done)

    def get(self, stage: str) -> Any:
        """What was noted of a stage, None when it is still to be done."""
        return self._done.get(stage)

    def note(self, stage: str, content: Any) -> None:
        """A stage is done; `content` is what JSON can hold, not None."""
        self._done[stage] = json.loads(json.dumps(content))
        self._write()

    def clear(self, stage: str) -> None:
        """Remove what an interrupted stage has left in the directory."""
        if self._path is not None:
            shutil.rmtree(self._path.parent / stage, ignore_errors=True)

    def _write(self) -> None:
        if self._path is not None:
            content = {"schema": SCHEMA, "settings": self._settings, "done": self._done}
            write_whole(self._path, json.dumps(content, indent=1) + "\n")

    def finish(self) -> None:
        """The job is over: there is nothing to go on with."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
