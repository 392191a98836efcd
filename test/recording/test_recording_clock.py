"""Stamps become one rising time: late, double, stray ones, clocks set back, gaps."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.recording import clock

MS = 1_000_000
START = 1_700_000_000_000_000_000
REGULAR = START + np.arange(200, dtype=np.int64) * MS


def test_good_stamps_are_left_alone() -> None:
    line = clock.timeline(REGULAR, REGULAR)
    assert np.array_equal(line.times, REGULAR)
    assert np.array_equal(line.rows, np.arange(200))
    assert line.notes == ()


def test_late_messages_are_sorted_and_counted() -> None:
    order = np.arange(200)
    order[[50, 51]] = order[[51, 50]]
    order[[100, 103]] = order[[103, 100]]
    line = clock.timeline(REGULAR[order], REGULAR)
    assert np.array_equal(line.times, REGULAR)
    assert np.array_equal(order[line.rows], np.arange(200))
    assert line.notes == ("4 messages out of order, sorted by stamp",)


def test_the_first_of_equal_stamps_is_kept() -> None:
    stamps = np.sort(np.concatenate((REGULAR, REGULAR[40:42])))
    line = clock.timeline(stamps, stamps)
    assert np.array_equal(line.times, REGULAR)
    assert line.rows[40:43].tolist() == [40, 42, 44]
    assert line.notes == ("2 messages with a stamp seen before left out",)


def test_a_clock_set_back_goes_on_by_the_log_time() -> None:
    log_times = np.concatenate((REGULAR[:120], REGULAR[120:] + 500 * MS))
    stamps = np.concatenate((REGULAR[:120], REGULAR[120:] - 3_600_000 * MS))
    line = clock.timeline(stamps, log_times)
    assert np.array_equal(line.times, log_times)
    assert line.restarts == (120,)
    assert "clock set back once" in line.notes[0]


def test_stray_stamps_are_left_out() -> None:
    stamps = REGULAR.copy()
    stamps[77] += 10**15
    stamps[120:122] = 5
    line = clock.timeline(stamps, REGULAR)
    assert np.array_equal(line.rows, np.delete(np.arange(200), [77, 120, 121]))
    assert np.array_equal(line.times, REGULAR[line.rows])
    assert line.notes == ("3 messages with stray stamps left out",)


def test_stray_stamps_at_the_ends_are_left_out() -> None:
    stamps = REGULAR.copy()
    stamps[0], stamps[-1] = 7, 10**15
    line = clock.timeline(stamps, REGULAR)
    assert np.array_equal(line.rows, np.arange(1, 199))


def test_a_long_pause_is_no_stray() -> None:
    stamps = np.concatenate((REGULAR[:100], REGULAR[100:] + 60_000 * MS))
    line = clock.timeline(stamps, stamps)
    assert np.array_equal(line.times, stamps)


def test_missing_messages_are_counted_only_at_a_steady_rate() -> None:
    assert clock.dropped(np.delete(REGULAR, [3, 50, 51, 52])) == 4
    assert clock.dropped(np.cumsum(np.random.default_rng(0).integers(1, 10 * MS, 500))) == 0
    assert clock.dropped(REGULAR[:1]) == 0
    assert clock.gap_limit(REGULAR) == 10 * MS


@given(st.lists(st.integers(-(2**62), 2**62), min_size=2, max_size=60))
def test_whatever_the_stamps_time_rises_and_no_row_comes_twice(stamps: list[int]) -> None:
    log_times = START + np.arange(len(stamps), dtype=np.int64) * MS
    line = clock.timeline(np.array(stamps, dtype=np.int64), log_times)
    assert np.all(np.diff(line.times) > 0)
    assert len(set(line.rows.tolist())) == len(line.rows) == len(line.times)
    assert np.all(np.diff(line.times) > 0) or len(line.times) < 2


def test_a_simulated_clock_begins_at_0() -> None:
    simulated = np.arange(200, dtype=np.int64) * MS
    assert clock.empty_stamps(simulated) == 0
    assert clock.empty_stamps(np.concatenate(([0, 0], simulated))) == 0, "said again while nobody answers"
    assert clock.empty_stamps(np.concatenate(([0], REGULAR))) == 1
    assert clock.empty_stamps(np.zeros(5, dtype=np.int64)) == 5
    assert clock.empty_stamps(simulated - MS) == 2
    assert clock.empty_stamps(REGULAR) == 0
