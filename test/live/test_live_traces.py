"""From samples to curves: nothing in between loses a peak, whatever comes and however it comes."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tcs_friction.live.bins import Bins, extremes, thinned
from tcs_friction.live.history import History
from tcs_friction.live.joining import LONGEST_WAIT, Join
from tcs_friction.live.traces import BINS, CURVES, WINDOWS, Traces
from tcs_friction.live.trail import Trail

MS = 1_000_000
BUSY = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""On a machine that is busy with other tests."""
NUMBER = st.one_of(st.floats(-1e6, 1e6), st.just(float("nan")))


@st.composite
def samples(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Ascending stamps with gaps of any kind, and values, some of which are no numbers."""
    gaps = draw(st.lists(st.integers(1, 50 * MS), min_size=1, max_size=80))
    values = draw(st.lists(NUMBER, min_size=len(gaps), max_size=len(gaps)))
    return np.cumsum(gaps), np.array(values)[:, np.newaxis]


@BUSY
@given(samples(), st.integers(1, 200 * MS))
def test_every_sample_lies_between_the_extremes_of_its_bin_and_each_extreme_is_a_sample(
    data: tuple[np.ndarray, np.ndarray], width: int
) -> None:
    stamps, values = data
    found = extremes(stamps, values, width)
    assert np.all(np.diff(found.number) > 0)
    for k, low, high in zip(found.number, found.low[:, 0], found.high[:, 0], strict=True):
        inside = values[stamps // width == k, 0]
        inside = inside[np.isfinite(inside)]
        if len(inside):
            assert (low, high) == (inside.min(), inside.max())
        else:
            assert np.isnan(low)
            assert np.isnan(high)
    assert set(stamps // width) == set(found.number)


@BUSY
@given(samples(), st.lists(st.integers(1, 30), min_size=1, max_size=10))
def test_bins_filled_bit_by_bit_are_those_of_all_samples_at_once(data: tuple[np.ndarray, np.ndarray], parts: list[int]) -> None:
    stamps, values = data
    bins, at = Bins(20 * MS, 1, 40), 0
    for size in [*parts, len(stamps)]:
        bins.add(stamps[at : at + size], values[at : at + size])
        at += size
    whole = extremes(stamps, values, 20 * MS)
    kept = whole.number > whole.number[-1] - 40
    found = bins.since(0)
    np.testing.assert_array_equal(found.number, whole.number[kept])
    np.testing.assert_array_equal(found.low, whole.low[kept])
    np.testing.assert_array_equal(found.high, whole.high[kept])


@BUSY
@given(samples(), st.integers(1, 50))
def test_thinned_curves_have_the_largest_value_and_not_more_bins_than_asked_for(
    data: tuple[np.ndarray, np.ndarray], most: int
) -> None:
    stamps, values = data
    _, found = thinned(stamps, values, most)
    assert len(found.number) <= most + 1
    if np.isfinite(values).any():
        assert np.nanmax(found.high) == np.nanmax(values)


def test_thinning_nothing_gives_nothing() -> None:
    _, found = thinned(np.empty(0, dtype=np.int64), np.empty((0, 1)), 10)
    assert len(found.number) == 0


def test_a_history_keeps_the_newest_and_says_where_they_begin() -> None:
    history = History(2, capacity=8)
    assert history.oldest() == -1
    for k in range(20):
        history.append(k, float(k), -float(k))
    first, stamps, values = history.since(3)
    assert first == 20 - len(stamps)
    assert len(stamps) >= 7
    np.testing.assert_array_equal(stamps, range(first, 20))
    np.testing.assert_array_equal(values[:, 1], -stamps.astype(float))
    assert history.oldest() == 12


def test_a_reader_never_sees_a_sample_that_the_writer_is_overwriting() -> None:
    """Each sample says its own number three times; a torn one would contradict itself."""
    history, over = History(2, capacity=64), threading.Event()

    def write() -> None:
        k = 0
        while not over.is_set():
            history.append(k, float(k), float(k))
            k += 1

    thread = threading.Thread(target=write)
    thread.start()
    try:
        for _ in range(3000):
            first, stamps, values = history.since(0)
            np.testing.assert_array_equal(stamps, first + np.arange(len(stamps)))
            np.testing.assert_array_equal(values[:, 0], stamps)
            np.testing.assert_array_equal(values[:, 1], stamps)
    finally:
        over.set()
        thread.join()


def test_between_takes_the_newest_run_only() -> None:
    history = History(1, capacity=100)
    for stamp in [*range(50), *range(10, 30)]:
        history.append(stamp, float(stamp))
    stamps, _ = history.between(5, 20)
    np.testing.assert_array_equal(stamps, range(10, 21))
    stamps, _ = history.between(5, 29, most=4)
    np.testing.assert_array_equal(stamps, range(26, 30))


@BUSY
@given(st.sets(st.integers(0, 60)), st.sets(st.integers(0, 60)), st.lists(st.integers(0, 15), max_size=12))
def test_samples_join_by_stamp_each_pair_once(left: set[int], right: set[int], steps: list[int]) -> None:
    """In parts of any size; one that comes after a later pair has been found has no partner any more."""
    join, sides = Join(1, 1), [np.array(sorted(side), dtype=np.int64) for side in (left, right)]
    found: list[int] = []
    for end in [*np.cumsum(steps), 61]:
        new = [(side[side < end], side[side < end, np.newaxis].astype(float)) for side in sides]
        sides = [side[side >= end] for side in sides]
        stamps, first, second = join.add(*new)
        np.testing.assert_array_equal(first, second)
        found += stamps.tolist()
    assert found == sorted(left & right)


def test_samples_whose_partners_never_come_do_not_pile_up() -> None:
    join = Join(1, 1)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 1))
    for k in range(20):
        join.add((np.arange(1000) + 1000 * k, np.zeros((1000, 1))), nothing)
    assert len(join._stamps[0]) == LONGEST_WAIT


def test_a_trail_has_the_largest_friction_of_every_moment() -> None:
    stamps = np.arange(1000, dtype=np.int64) * MS
    torque = np.sin(stamps / 3e7)
    torque[517] = 9.0
    torque[3] = np.nan
    trail = Trail(100)
    trail.add(stamps, stamps / 1e9, torque)
    points = trail.since(0)
    assert len(points) == 100
    assert [0.517, 9.0] in points.tolist()
    assert len(trail.since(trail.count - 5)) == 5
    trail.clear()
    assert len(trail.since(0)) == 0


def feed(traces: Traces, begin: int, end: int, peak: int = -1) -> None:
    """States, references, torques and estimates of some milliseconds."""
    write = {topic: channel.history.append for topic, channel in traces.channels.items()}
    for k in range(begin, end):
        write["joint_states"](k * MS, 1.0, 0.5, 50.0 if k == peak else 3.0)
        write["reference"](k * MS, 1.0 + 1e-6 * k, 0.5, 0.0)
        write["torque_command"](k * MS, 2.0)
        write["friction_estimate"](k * MS, float("nan") if k % 2 else 1.5, 0.5)
        write["friction_compensation"](k * MS, 1.25)


@pytest.mark.parametrize("window", WINDOWS)
def test_one_sample_among_many_is_in_every_window(window: int) -> None:
    traces = Traces()
    for begin in range(0, 4000, 40):
        feed(traces, begin, begin + 40, peak=1234)
        traces.advance()
    assert max(traces.bins("torque_applied", window, 0).high[:, 0]) == 50.0
    width, found = traces.detail("torque_applied", 1200 * MS, 1300 * MS)
    assert width < MS
    assert found.high.max() == 50.0


def test_what_is_derived_from_two_topics_has_one_value_for_each_state() -> None:
    traces = Traces()
    feed(traces, 0, 500)
    traces.advance()
    found = traces.bins("error", 5, 0)
    np.testing.assert_allclose(found.high[:, 0], 1e-6 * np.minimum(10 * found.number + 9, 499), atol=1e-12)
    assert traces.error_rms(5.0) == pytest.approx(1e-6 * np.sqrt(np.mean(np.arange(500.0) ** 2)))
    assert set(traces.trails["friction_compensation"].since(0)[:, 1]) == {1.25}
    assert set(traces.trails["friction_estimate"].since(0)[:, 1]) == {1.5}


def test_a_new_run_begins_with_empty_curves() -> None:
    traces = Traces()
    feed(traces, 0, 2000, peak=1500)
    traces.advance()
    run = traces.run
    feed(traces, 0, 100)
    traces.advance()
    assert traces.run > run
    assert traces.begun == 0
    assert traces.now == 99 * MS
    for curve in CURVES:
        assert traces.bins(curve, 20, 0).number.max() * 40 <= 100, curve
    assert traces.bins("torque_applied", 20, 0).high.max() == 3.0


def test_stamps_of_another_clock_begin_a_new_run() -> None:
    """Real time after lock-step; the page counts its time from the beginning of the run."""
    traces, date = Traces(), 1_700_000_000_000
    feed(traces, 0, 2000)
    traces.advance()
    feed(traces, date, date + 100)
    traces.advance()
    assert traces.run == 1
    assert traces.begun == date * MS
    assert traces.bins("speed", 20, 0).number.min() == date // 40
    feed(traces, date + 200_000, date + 200_100)  # a pause that still fits into a window
    traces.advance()
    assert (traces.run, traces.begun) == (1, date * MS)


def test_what_a_topic_said_in_the_run_before_is_gone_though_it_says_nothing_more() -> None:
    traces = Traces()
    feed(traces, 0, 2000)
    traces.advance()
    for k in range(100):
        traces.channels["joint_states"].history.append(k * MS, 1.0, 0.5, 3.0)
    traces.advance()
    for curve in ("error", "reference_speed", "torque_command", "friction_estimate", "friction_compensation"):
        assert len(traces.bins(curve, 20, 0).number) == 0, curve
    assert len(traces.bins("speed", 20, 0).number) > 0
    assert len(traces.trails["friction_estimate"].since(0)) == 0


def test_repeated_and_late_samples_are_left_out() -> None:
    traces = Traces()
    feed(traces, 0, 50)
    feed(traces, 20, 60)
    assert traces.advance() == 5 * 60
    feed(traces, 30, 70)
    assert traces.advance() == 5 * 10
    assert traces.run == 0


def test_detail_comes_from_bins_where_the_samples_have_gone() -> None:
    traces = Traces()
    for channel in traces.channels.values():
        channel.history = History(channel.history.columns, capacity=200)
    for begin in range(0, 3000, 50):
        feed(traces, begin, begin + 50, peak=1000)
        traces.advance()
    width, found = traces.detail("torque_applied", 900 * MS, 1100 * MS)
    assert width == 5_000 * MS // BINS
    assert found.high.max() == 50.0
    assert traces.newest("reference")[1] == 0.5
    assert Traces().newest("reference") == []


@BUSY
@given(st.lists(st.tuples(st.integers(0, 10**19 // 10), NUMBER), max_size=60))
def test_no_order_of_stamps_breaks_the_curves(given: list[tuple[int, float]]) -> None:
    traces = Traces()
    for k, (stamp, value) in enumerate(given):
        traces.channels["joint_states"].history.append(stamp, value, value, value)
        if k % 7 == 0:
            traces.advance()
    traces.advance()
    for window in WINDOWS:
        assert np.all(np.diff(traces.bins("speed", window, 0).number) > 0)
