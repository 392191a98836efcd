"""The file in which the monitor keeps what it has learned; without a name nothing is kept."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from tcs_friction.config import axis_mapping, write_bytes
from tcs_friction.errors import InputError, TcsError, refusal
from tcs_friction.monitor.baseline import Baseline
from tcs_friction.monitor.kept import packed, unpacked
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.physics.axis import Axis


def identity(axis: Axis, period: float, signals: tuple[str, ...]) -> str:
    """What was learned holds for the same model, period (s) and recorded signals: a checksum of them."""
    watched = json.dumps([axis_mapping(axis), period, signals], sort_keys=True)
    return hashlib.sha256(watched.encode()).hexdigest()


def save_learned(path: Path, baseline: Baseline, watched: str) -> None:
    """The file appears whole or not at all. Raises JobError where it cannot be written."""
    write_bytes(path, packed(baseline, watched))


def load_learned(path: Path, watched: str) -> Baseline | None:
    """What was saved for the same `watched`, None where there is no file. Raises InputError for any other file."""
    try:
        return unpacked(path.read_bytes(), watched, str(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(str(path), str(refusal(error).found), "a file of what was learned") from None


class LearnedFile:
    """Says on /diagnostics why what it has is of no use, or why it cannot be written."""

    def __init__(self, health: Health, waiter: Waiter) -> None:
        self._health, self._waiter = health, waiter
        self._name = self._watched = ""

    def recall(self, name: str, watched: str) -> Baseline | None:
        """What was learned before of the same thing, None for nothing; from now on the file is this one."""
        self._name, self._watched = name, watched
        try:
            return load_learned(Path(name), watched) if name else None
        except TcsError as error:
            self._health.doubt("learning", f"learning anew: {error}")
            return None

    async def keep(self, baseline: Baseline) -> None:
        """Write what was learned, in a thread."""
        name, watched = self._name, self._watched
        if not name:
            return
        try:
            await self._waiter.in_thread(lambda: save_learned(Path(name), baseline, watched))
        except TcsError as error:
            self._health.doubt("learning", f"what was learned is not kept: {error}")

    def forget(self) -> None:
        """What is learned anew is not known after a restart either, until it is learned."""
        try:
            if self._name:
                Path(self._name).unlink(missing_ok=True)
        except OSError as error:
            self._health.note(f"{self._name} stays: {error.strerror}")
