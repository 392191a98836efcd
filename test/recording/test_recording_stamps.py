"""Stamps that were never set, clocks at another pace, stretches of a file in another order."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording import clock
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.stamps import pace

MS = 1_000_000
START = 1_790_000_000_000_000_000
COUNT = 3000
LOG = START + np.arange(COUNT, dtype=np.int64) * 4 * MS
TRUE = np.arange(COUNT) * 0.004
POSITION, BESIDE = SignalSource("/state", "position"), SignalSource("/state", "effort")
TORQUE = SignalSource("/drive", "data")


def one_topic(stamps: np.ndarray, log_times: np.ndarray = LOG) -> Recording:
    values = {POSITION: np.sin(TRUE), BESIDE: np.cos(TRUE)}
    return align({"/state": TopicColumns("/state", log_times, stamps, values)}, SignalMap(POSITION, BESIDE), "bag")


def two_topics(stamps: np.ndarray, torque_stamps: np.ndarray | None, log_times: np.ndarray = LOG) -> Recording:
    """The torque is the time in s."""
    state = TopicColumns("/state", log_times, stamps, {POSITION: np.sin(TRUE)})
    drive = TopicColumns("/drive", log_times, torque_stamps, {TORQUE: TRUE})
    return align({"/state": state, "/drive": drive}, SignalMap(POSITION, TORQUE), "bag")


@pytest.mark.parametrize("where", [[0], [1500], [COUNT - 1], list(range(7)), list(range(0, COUNT, 3))])
def test_stamps_that_were_never_set_cost_their_messages_alone(where: list[int]) -> None:
    """The log times, which come in bursts, are not used."""
    stamps = LOG.copy()
    stamps[where] = 0
    found = one_topic(stamps, START + (LOG - START) // (20 * MS) * (20 * MS) + 25 * MS)
    good = np.delete(np.arange(COUNT), where)
    assert np.allclose(found.t, TRUE[good] - TRUE[good[0]], atol=1e-9)
    assert np.array_equal(found.position, np.sin(TRUE)[good])
    out = f"{len(where)} message{'s'[: len(where) != 1]} left out"
    said = f"mended: /state: {len(where)} of {COUNT} header stamps are empty, {out}"
    assert found.notes[:2] == (said, "time base: header stamps of /state")


@pytest.mark.parametrize("place", [0, 1, 1500, COUNT - 1])
@pytest.mark.parametrize("wrong", [5, -(10**15), 10**15, 700 * MS])
def test_a_stamp_that_is_wildly_wrong_is_a_stray(place: int, wrong: int) -> None:
    """In the future by 0.7 s as well, unless it is the last: then nobody can tell it from a pause."""
    if place == COUNT - 1 and wrong == 700 * MS:
        return
    stamps = LOG.copy()
    stamps[place] = wrong if wrong == 5 else stamps[place] + wrong
    found = one_topic(stamps)
    good = np.delete(np.arange(COUNT), place)
    assert np.array_equal(found.position, np.sin(TRUE)[good])
    assert any("stray" in note or "are empty" in note for note in found.notes)


def test_a_pause_before_the_last_message_is_a_pause() -> None:
    stamps = LOG.copy()
    stamps[-1] += 5000 * MS
    line = clock.timeline(stamps, stamps + 3 * MS)
    assert len(line.times) == COUNT
    assert line.notes == ()


def test_another_pace_of_the_log_times_is_said() -> None:
    """A simulator at 0.4 of real time whose first seven stamps were not set."""
    simulated = 37_500 * MS + (LOG - START)
    simulated[:7] = 0
    found = one_topic(simulated, START + (LOG - START) * 5 // 2)
    assert found.duration == pytest.approx(TRUE[-1] - TRUE[7])
    assert "/state: header stamps run 0.4 times as fast as the log times" in found.notes


def test_log_times_at_another_pace_than_the_few_stamps_that_were_set_are_refused() -> None:
    stamps = np.zeros(COUNT, dtype=np.int64)
    stamps[::10] = START + (LOG[::10] - START) // 3
    with pytest.raises(InputError, match=r"2700 of 3000 header stamps are empty, and the others run 0\.3333 times as fast"):
        one_topic(stamps)
    stamps[::10] = LOG[::10] - 2 * MS
    assert "time base: log times of /state" in one_topic(stamps).notes


@pytest.mark.parametrize("rate", [0.4, 1.0 + 2e-3, 3.0])
def test_a_topic_without_stamps_is_brought_onto_a_clock_at_another_pace(rate: float) -> None:
    stamps = START + np.rint(TRUE * 1e9).astype(np.int64)
    log_times = START + 10 * MS + np.rint(TRUE / rate * 1e9).astype(np.int64)
    found = two_topics(stamps, None, log_times)
    assert np.allclose(found.torque, found.t, atol=5e-3)
    assert np.mean(found.torque - found.t) == pytest.approx(0.0, abs=4.1e-3)
    assert any(f"and run {rate:.4g} times as fast" in note for note in found.notes)


def test_two_header_clocks_at_different_paces_meet_in_the_log_times() -> None:
    simulated = 37_500 * MS + np.rint(TRUE * 1e9).astype(np.int64)
    log_times = START + np.rint(TRUE * 2.5e9).astype(np.int64)
    found = two_topics(simulated, log_times - 10 * MS, log_times)
    assert np.allclose(found.torque, found.t, atol=5e-3)
    assert any("header stamps on another clock" in note and "run 0.4 times as fast" in note for note in found.notes)


@pytest.mark.parametrize("stamps_beside", [True, False])
def test_clocks_that_do_not_keep_pace_are_no_bridge(stamps_beside: bool) -> None:
    """A simulator that slows down: a third at 1, a third at 0.5, a third at 0.25 of real time."""
    stamps = 37_500 * MS + np.rint(TRUE * 1e9).astype(np.int64)
    steps = np.repeat([4, 8, 16], COUNT // 3) * MS
    log_times = START + np.cumsum(steps)
    with pytest.raises(InputError, match="do not keep pace, and /drive has no stamps of the same clock"):
        two_topics(stamps, log_times if stamps_beside else None, log_times)
    assert len(two_topics(stamps, stamps, log_times)) == COUNT, "no bridge is needed"


def test_a_pace_is_told_through_jitter_and_not_from_a_few() -> None:
    random = np.random.default_rng(0)
    log_times = LOG + random.integers(0, 30 * MS, COUNT)
    assert not pace(LOG, log_times).drifts
    assert pace(START + (LOG - START) // 2, log_times).rate == pytest.approx(0.5, rel=2e-3)
    assert not pace(LOG[:10] * 2, LOG[:10]).drifts
    frozen = pace(np.full(COUNT, START), LOG)
    assert frozen.rate == 1.0
    assert pace(LOG, np.full(COUNT, START)).rate == 1.0


def shuffled(order: list[int], pieces: int = 10) -> np.ndarray:
    return np.concatenate([np.arange(COUNT).reshape(pieces, -1)[part] for part in order])


@pytest.mark.parametrize(
    "order",
    [[0, 2, 1, 3, 4, 5, 6, 7, 8, 9], [*range(9, -1, -1)], [3, 1, 4, 0, 5, 9, 2, 6, 8, 7], [*range(5, 10), *range(5)]],
)
def test_stretches_in_another_order_are_sorted_and_not_a_clock_set_back(order: list[int]) -> None:
    rows = shuffled(order)
    line = clock.timeline(LOG[rows], LOG[rows] + 3 * MS)
    assert np.array_equal(line.times, LOG)
    assert np.array_equal(rows[line.rows], np.arange(COUNT))
    assert line.notes == ("stretches of the file stand in another order than they were logged in, sorted",)
    assert line.restarts == ()


def test_late_messages_in_stretches_in_another_order_are_sorted_too() -> None:
    stamps = LOG.copy()
    stamps[[40, 41]] = stamps[[41, 40]]
    rows = shuffled([1, 0, *range(2, 10)])
    line = clock.timeline(stamps[rows], LOG[rows])
    assert np.array_equal(line.times, LOG)
    assert line.notes[1] == "1 message out of order, sorted by stamp"


@pytest.mark.parametrize("back", [6_000, 3_600_000])
def test_a_clock_that_was_set_back_is_still_one(back: int) -> None:
    """Over times that were there already, or to before the recording: the log times go back as well."""
    set_back = np.concatenate((LOG[:1500], LOG[1500:] - back * MS))
    line = clock.timeline(set_back, set_back)
    assert line.restarts == (1500,)
    assert len(line.times) == COUNT
    assert np.all(np.diff(line.times) > 0)
