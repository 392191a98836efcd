"""Positions that wrap become continuous, whatever the modulus; spikes, gaps, new zeros and quick motion are no wraps."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.errors import InputError
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.tables import import_table
from tcs_friction.recording.unwrap import unwrapped

TURN = 2.0 * np.pi
T = np.arange(9000) * 0.004
MOTION = 7.0 * np.sin(0.4 * T) + 3.0 * np.sin(1.3 * T)
SPEED = 2.8 * np.cos(0.4 * T) + 3.9 * np.cos(1.3 * T)
TURNS = MOTION / TURN


def centred(values: np.ndarray, modulus: float) -> np.ndarray:
    return np.mod(values + 0.5 * modulus, modulus) - 0.5 * modulus


@pytest.mark.parametrize(
    ("true", "recorded", "said"),
    [
        (MOTION, np.mod(MOTION, TURN), "6.2832 rad"),
        (MOTION, centred(MOTION, TURN), "6.2832 rad"),
        (360.0 * TURNS, np.mod(360.0 * TURNS, 360.0), "360"),
        (np.round(65536 * TURNS), np.mod(np.round(65536 * TURNS), 65536.0), "65536"),
        (MOTION, np.mod(MOTION, np.pi), "3.1416 rad"),
        (1.37 * MOTION, np.mod(1.37 * MOTION, 7.77), "7.77"),
        (0.003 * T - 0.05, centred(0.003 * T - 0.05 + np.pi, TURN), "6.2832 rad"),
    ],
    ids=["turn", "half turns either way", "degrees", "counter", "half turn", "any modulus", "once"],
)
def test_whatever_wraps_becomes_continuous(true: np.ndarray, recorded: np.ndarray, said: str) -> None:
    found = unwrapped(T, recorded)
    assert np.ptp(found.position - true) < 1e-3 * found.modulus
    assert found.places == np.count_nonzero(np.abs(np.diff(recorded)) > 0.5 * np.ptp(recorded))
    assert found.notes == (f"position: wraps at {said}, unwrapped at {found.places} place{'s'[: found.places != 1]}",)


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (360.0, "the position wraps at 360: it is in deg, expected the unit deg to be said for it"),
        (400.0, "it is in gon"),
        (65536.0, "the position wraps at 65536: it holds counts, expected signals: position: {scale: of a count}"),
        (4096.0, "it holds counts"),
        (TURN, ""),
        (7.77, ""),
    ],
)
def test_what_wraps_where_no_radian_does_is_refused(turn: float, said: str, tmp_path: Path) -> None:
    true = np.round(turn * TURNS) if turn > 1000.0 else turn * TURNS  # a counter has whole numbers
    rows = zip(T, np.mod(true, turn), np.cos(T), strict=True)
    table = tmp_path / "axis.csv"
    table.write_text("time,position,torque\n" + "".join(f"{t:.3f},{q:.9g},{u:.6g}\n" for t, q, u in rows))
    if not said:
        assert "unwrapped" in " ".join(import_table(table, "axis", {}).recording.notes)
        return
    with pytest.raises(InputError, match=re.escape(said)):
        import_table(table, "axis", {})
    if "deg" in said or "gon" in said:
        unit = said.split("it is in ")[1].split(",")[0]
        position = import_table(table, "axis", {"position": f"position:{unit}"}).recording.position
        assert np.ptp(position - MOTION) < 1e-6


@pytest.mark.parametrize(
    ("name", "unit"),
    [("encoder_counts", ""), ("az_pos_ticks", ""), ("PositionCounts", ""), ("position [counts]", ""), ("angle", "s,lsb,Nm\n")],
)
def test_counts_without_a_scale_are_refused(name: str, unit: str, tmp_path: Path) -> None:
    table = tmp_path / "axis.csv"
    table.write_text(f"time,{name},torque\n{unit}" + "".join(f"{t:.3f},{1e3 * np.sin(t):.0f},{np.cos(t):.6g}\n" for t in T[:400]))
    said = f"column '{name}' holds counts, expected signals: position: {{scale: of a count}}"
    with pytest.raises(InputError, match=re.escape(said)):
        import_table(table, "axis", {"position": name})
    source = SignalSource("/joint_states", "position", "axis", scale=1e-3)
    signals = SignalMap(source, SignalSource("/joint_states", "effort", "axis"))
    found = import_table(table, "axis", {"position": name}, signals).recording.position
    assert np.abs(found).max() == pytest.approx(1.0, abs=0.1)


def test_noise_at_north_and_a_reference_beside_it() -> None:
    true = TURN + 1e-3 * np.random.default_rng(0).standard_normal(len(T))
    found = unwrapped(T, np.mod(true, TURN))
    assert np.ptp(found.position - true) < 1e-9
    assert np.allclose(found.beside(np.mod(true + 0.01, TURN)), found.position + 0.01, atol=1e-9)
    assert unwrapped(T, MOTION).beside(MOTION) is MOTION


@pytest.mark.parametrize("top", [0.3, 0.6, 0.9])
def test_a_wheel_that_turns_quickly_is_unwrapped_by_its_velocity_or_refused(top: float) -> None:
    """top: turns within a sample."""
    t = np.arange(3000) * 0.01
    speed = TURN * top / 0.01 * np.sin(0.5 * t)
    true = -TURN * top / 0.01 / 0.5 * np.cos(0.5 * t)
    assert np.ptp(unwrapped(t, np.mod(true, TURN), speed).position - true) < 1e-9
    if top < 0.4:
        assert np.ptp(unwrapped(t, np.mod(true, TURN)).position - true) < 1e-9
    else:
        with pytest.raises(InputError, match=r"bag: the position wraps at 6\.2832 rad and moves by up to 3\.1\d? within"):
            unwrapped(t, np.mod(true, TURN), where="bag")
        with pytest.raises(InputError, match="nobody can tell"):
            unwrapped(t, np.mod(true, TURN), 3.0 * speed)  # rpm, perhaps


@pytest.mark.parametrize("rate", [0.42, 0.47, 0.49, 0.55])
def test_a_steady_quick_wheel_is_refused(rate: float) -> None:
    t = np.arange(2000) * 0.01
    true = TURN * rate * np.arange(2000) + 0.1
    with pytest.raises(InputError, match="which way round nobody can tell"):
        unwrapped(t, np.mod(true, TURN))
    assert np.ptp(unwrapped(t, np.mod(true, TURN), np.full(2000, TURN * rate / 0.01)).position - true) < 1e-9


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_velocity_made_from_what_wraps_loses_its_spikes(share: float) -> None:
    recorded = np.mod(MOTION, TURN)
    backward = np.concatenate([[SPEED[0]], np.diff(recorded) / 0.004])
    velocity = backward if share == 1.0 else np.gradient(recorded, 0.004)
    found = unwrapped(T, recorded, velocity)
    assert np.ptp(found.position - MOTION) < 1e-9
    assert found.velocity is not None
    assert np.abs(found.velocity - SPEED).max() < 0.02
    assert "at wraps replaced by the velocity around them" in found.notes[1]


def test_spikes_are_said_and_not_unwrapped() -> None:
    short = 0.4 * np.sin(T)
    recorded = short.copy()
    recorded[5000] += 3.0
    recorded[7000:7002] = 65535.0
    found = unwrapped(T, recorded)
    assert np.flatnonzero(found.spikes).tolist() == [5000, 7000, 7001]
    assert np.array_equal(found.position, recorded)
    assert found.notes == ("position: 3 samples far off and back at once, left out",)
    wrapping = np.mod(MOTION, TURN)
    wrapping[6001] = 700.0
    found = unwrapped(T, wrapping)
    assert np.flatnonzero(found.spikes).tolist() == [6001]
    assert np.ptp(np.delete(found.position - MOTION, 6001)) < 1e-9


def test_a_spike_of_a_turn_is_a_turn() -> None:
    recorded = 3.0 + 0.4 * np.sin(T)
    recorded[[400, 5000]] += TURN
    recorded[7000] += 500.0
    found = unwrapped(T, recorded)
    fine = np.arange(len(T)) != 7000
    assert np.ptp((found.position - 0.4 * np.sin(T))[fine & ~found.spikes]) < 1e-9


@pytest.mark.parametrize("until", [0.3, 6.1])
def test_a_position_that_is_set_anew_is_cut_there(until: float) -> None:
    recorded = np.concatenate([np.linspace(0.0, until, 2000), 0.5 * np.sin(T[:7000])])
    found = unwrapped(T, recorded + 10.0)
    if until > 1.0:
        assert found.cuts == (2000,)
        assert found.notes == ("position: jumps by 6.1 within a sample (1 place), no motion and no wrap; cut there",)
    else:
        assert found.cuts == (), "less than half of the range: nobody can tell it"
    assert found.modulus == 0.0
    assert np.array_equal(found.position, recorded + 10.0)


@pytest.mark.parametrize("period", [2.3, 3.7, 4.0, 5.0, 7.0])
def test_quick_motion_over_a_short_range_is_motion(period: float) -> None:
    recorded = 0.01 * np.sin(TURN / period * np.arange(3000) + 0.1)
    speed = 0.01 * TURN / period / 0.004 * np.cos(TURN / period * np.arange(3000) + 0.1)
    for velocity in (None, speed):
        found = unwrapped(T[:3000], recorded, velocity)
        assert np.array_equal(found.position, recorded)
        assert not found.spikes.any()
        assert not found.cuts


def test_a_pause_is_no_wrap_and_a_wrap_in_a_pause_is_no_step() -> None:
    keep = np.r_[0:3000, 4500:9000]
    moved = np.where(keep < 3000, 0.0, 5.0) + 0.01 * np.sin(T[keep])
    assert unwrapped(T[keep], moved).notes == ()
    found = unwrapped(T[keep], np.mod(MOTION, TURN)[keep])
    for part in (slice(0, 3000), slice(3000, None)):
        assert np.ptp((found.position - MOTION[keep])[part]) < 1e-9


@given(st.lists(st.floats(-1e9, 1e9), min_size=0, max_size=40), st.booleans())
def test_whatever_the_numbers_the_position_is_the_same_modulo_what_was_found(values: list[float], moving: bool) -> None:
    recorded = np.array(values)
    t = np.arange(len(recorded), dtype=float)
    try:
        found = unwrapped(t, recorded, np.gradient(recorded) if moving and len(values) > 1 else None)
    except InputError:
        return
    turns = (found.position - recorded) / found.modulus if found.modulus else found.position - recorded
    assert np.allclose(turns, np.rint(turns), atol=1e-6)
    assert all(0 < cut < len(recorded) for cut in found.cuts)
