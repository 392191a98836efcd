"""What was found and handled in bags while reading them, for people who run a command."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from tcs_friction.errors import printable
from tcs_friction.recording.recording import Recording


def tell_notes(recordings: Sequence[Recording]) -> None:
    """Each note on a line of stderr; one that several bags share is said once."""
    for line in note_lines((recording.source, recording.notes) for recording in recordings):
        print(f"tcs-friction: {printable(line)}", file=sys.stderr)


def note_lines(notes: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """`bag: note` for every note, `bag and 2 more: note` where other bags have the same."""
    sources: dict[str, list[str]] = {}
    for source, found in notes:
        for note in found:
            sources.setdefault(note, []).append(source)
    return [
        f"{bags[0]}{f' and {len(bags) - 1} more' if len(bags) > 1 else ''}: {note}" for note, bags in sources.items()
    ]
