"""The record type checks itself once and stays as it is."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Recording

T = np.arange(5.0)


def make(**changes: Any) -> Recording:
    return Recording(**({"t": T, "position": T * 2, "torque": T * 3, "source": "here"} | changes))


def test_a_recording_is_read_only_and_whole_by_default() -> None:
    recording = make(exogenous={"wind": T})
    assert recording.segments == (slice(0, 5),)
    assert recording.duration == 4.0
    for values in (recording.t, recording.position, recording.exogenous["wind"]):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    with pytest.raises(TypeError):
        recording.exogenous["rain"] = T  # type: ignore[index]


@pytest.mark.parametrize(
    ("changes", "culprit"),
    [
        ({"t": np.array([0.0, 1.0, 1.0, 2.0, 3.0])}, r"t\[2\] does not"),
        ({"t": np.array([0.0])}, "shape"),
        ({"t": T[:1], "position": T[:1], "torque": T[:1]}, "1 samples"),
        ({"torque": np.array([0.0, 1.0, np.nan, 2.0, 3.0])}, r"torque\[2\] is nan"),
        ({"velocity": T[:4]}, r"velocity has shape \(4,\)"),
        ({"exogenous": {"wind": np.full(5, np.inf)}}, "exogenous wind"),
        ({"segments": (slice(2, 4), slice(0, 2))}, "segment"),
        ({"segments": (slice(3, 3),)}, "segment"),
    ],
)
def test_a_bad_recording_names_the_culprit(changes: dict[str, Any], culprit: str) -> None:
    with pytest.raises(InputError, match=f"here: .*{culprit}"):
        make(**({"t": T} | changes))


def test_a_part_keeps_times_and_shifts_segments() -> None:
    recording = make(segments=(slice(0, 2), slice(3, 5)), velocity=T, exogenous={"wind": T})
    part = recording.part(slice(1, 4))
    assert part.t.tolist() == [1.0, 2.0, 3.0]
    assert part.segments == (slice(0, 1), slice(2, 3))
    assert part.exogenous["wind"].tolist() == [1.0, 2.0, 3.0]


def test_recordings_travel_between_processes() -> None:
    recording = make(velocity=T, exogenous={"wind": T}, segments=(slice(1, 5),), notes=("a note",))
    copy = pickle.loads(pickle.dumps(recording))
    assert copy.segments == recording.segments
    assert copy.notes == recording.notes
    assert copy.exogenous["wind"].tolist() == T.tolist()
