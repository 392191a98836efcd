"""A position that stops being read is cut out; an axis that rests is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.cli import main
from tcs_friction.conditioning.checks import check_position
from tcs_friction.errors import InputError
from tcs_friction.recording.frozen import LEAST, frozen
from tcs_friction.recording.mending import refuse_mended
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.tables import import_table

T: Column = 0.004 * np.arange(6000.0)
MOTION: Column = np.asarray(0.7 * np.sin(0.8 * T) + 0.2 * np.sin(2.1 * T))
SPEED: Column = np.asarray(0.56 * np.cos(0.8 * T) + 0.42 * np.cos(2.1 * T))


def stopped(*parts: slice) -> np.ndarray:
    position = MOTION.copy()
    for part in parts:
        position[part] = position[part.start]
    return position


def table(path: Path, **columns: np.ndarray) -> Path:
    header = ",".join({"t": "time [s]", "q": "az_deg", "v": "velocity [deg/s]", "u": "torque [N m]"}[name] for name in columns)
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",", header=header, comments="")
    return path


@pytest.mark.parametrize("parts", [(slice(2000, 3100),), (slice(500, 530), slice(2000, 2100)), (slice(0, 900),)])
def test_a_position_that_comes_back_elsewhere_was_frozen(parts: tuple[slice, ...]) -> None:
    repeated, notes = frozen(T, stopped(*parts))
    assert repeated is not None
    expected = np.zeros(len(T), dtype=bool)
    for part in parts:
        expected[part.start + 1 : part.stop] = True
    assert np.array_equal(repeated, expected)
    longest = max(parts, key=lambda part: part.stop - part.start)
    assert f"for {T[longest.stop - 1] - T[longest.start]:.4g} s from {T[longest.start]:.4g} s on" in notes[0]


def test_without_a_way_back_only_the_velocity_tells() -> None:
    position = stopped(slice(3000, 6000))
    assert frozen(T, position) == (None, ())
    repeated, _ = frozen(T, position, SPEED + 0.05)  # an offset of the velocity is no motion
    assert repeated is not None
    assert np.array_equal(np.flatnonzero(repeated), np.arange(3001, 6000))


@given(st.integers(LEAST, 3000), st.floats(1e-6, 1e-2), st.floats(-0.1, 0.1))
def test_an_axis_that_rests_is_not_frozen(rest: int, resolution: float, offset: float) -> None:
    """It begins with the speed at which it stopped, and a reading of the velocity at rest may have an offset and noise."""
    still = np.full(rest, MOTION[2000])
    slowly = MOTION[2000] + 0.3 * (1.0 - np.cos(np.linspace(0.0, np.pi, 2000)))
    position = np.round(np.concatenate([MOTION[:2001], still, slowly]) / resolution) * resolution
    seconds: Column = 0.004 * np.arange(float(len(position)))
    noise = 1e-4 * np.random.default_rng(rest).standard_normal(len(position))
    velocity = np.gradient(np.concatenate([MOTION[:2001], still, slowly]), 0.004) + offset + noise
    assert frozen(seconds, position, velocity) == (None, ())


def test_what_was_set_or_comes_after_a_pause_is_not_frozen() -> None:
    """A new zero of an axis at rest, an episode that begins elsewhere, a clock that begins anew."""
    at_rest = np.concatenate([MOTION[:2000], np.full(500, MOTION[2000]), np.full(500, 0.1)])
    assert frozen(T[:3000], at_rest) == (None, ())
    elsewhere = stopped(slice(2000, 3000))
    later: Column = np.asarray(T + np.where(np.arange(len(T)) >= 3000, 10.0, 0.0))
    assert frozen(later, elsewhere) == (None, ())
    assert frozen(T, elsewhere, None, (3000,)) == (None, ())


def test_a_frozen_stretch_is_cut_said_and_refused_by_strict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deg = np.degrees(stopped(slice(2000, 3100)))
    path = table(tmp_path / "a.csv", t=T, q=deg, u=np.sin(T))
    recording = import_table(path, "", {}).recording
    assert len(recording) == len(T) - 1099
    assert [part.stop for part in recording.segments] == [2001, len(recording)]
    with pytest.raises(InputError, match=r"frozen for 4\.396 s from 8 s on"):
        refuse_mended([recording])
    assert main(["bag", "info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "mended: position: frozen for 4.396 s from 8 s on" in said
    assert "rad, recorded in deg in column 'az_deg'" in said
    assert "N m, recorded in Nm in column 'torque [N m]'" in said


def test_a_position_that_never_changes_beside_a_velocity_is_named() -> None:
    still: Column = np.zeros(100)
    with pytest.raises(InputError, match="never changes, expected a recording in which the axis moves"):
        check_position(Recording(T[:100], still, T[:100], np.full(100, 0.01)))
    with pytest.raises(InputError, match="never changes, and the velocity does, expected the position of the axis: is its"):
        check_position(Recording(T[:100], still, T[:100], SPEED[:100]))
