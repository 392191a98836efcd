"""What was found while reading bags is told, once."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.commands.notes import note_lines, tell_notes
from tcs_friction.recording.recording import Recording


def test_each_note_is_said_once_with_its_bags() -> None:
    notes = [("a", ["time base: header stamps", "1 gap"]), ("b", ["time base: header stamps"]), ("c", ["damaged"])]
    assert note_lines(notes) == ["a and 1 more: time base: header stamps", "a: 1 gap", "c: damaged"]


def test_notes_go_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    line = np.arange(3.0)
    tell_notes([Recording(line, line, line, source="bag", notes=("damaged: 3 messages lost",))])
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "tcs-friction: bag: damaged: 3 messages lost\n")
