"""What was mended in a recording on reading it: notes that say so, and whoever will have nothing mended."""

from __future__ import annotations

from collections.abc import Sequence

from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Recording

MENDED = "mended: "
DAMAGED = "damaged: "
"""What the notes on something put right, or lost, begin with."""


def mended(line: str) -> str:
    """A note on something that was not as it should be and has been put right.

    >>> mended("the last row is cut, left out")
    'mended: the last row is cut, left out'
    """
    return f"{MENDED}{line}"


def mendings(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """The notes that tell of something mended or lost, each once."""
    notes = (note for recording in recordings for note in recording.notes)
    return tuple(dict.fromkeys(note for note in notes if MENDED in note or note.startswith(DAMAGED)))


def refuse_mended(recordings: Sequence[Recording]) -> None:
    """For --strict. Raises InputError for the first thing that was mended or lost."""
    for recording in recordings:
        for note in mendings([recording]):
            raise InputError(recording.source, note.replace(MENDED, ""), "nothing to mend (--strict)")
