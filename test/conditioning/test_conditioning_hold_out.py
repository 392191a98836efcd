"""Train and held-out data never touch, and together they leave out no more than edges, gaps and an unknown beginning."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from open_loop_cases import axis, recorded
from scipy import ndimage

from tcs_friction.conditioning.hold_out import (
    MOST_BLOCKS,
    MOST_UNKNOWN,
    SHARE,
    blocks,
    divided,
    held_out,
    unknown,
    untouched,
)
from tcs_friction.conditioning.preprocessing import prepare

SIZES = st.lists(st.integers(100, 5000), min_size=1, max_size=5)


@given(SIZES, st.integers(1, 20))
def test_blocks_go_on_through_stretches(sizes: list[int], edge: int) -> None:
    found = blocks(sizes, edge)
    assert [len(block) for block in found] == sizes
    numbers = np.concatenate(found)
    assert numbers[0] == 0
    assert set(np.diff(numbers)) <= {0, 1}
    assert round(1.0 / SHARE) <= numbers[-1] + 1 <= MOST_BLOCKS


@given(SIZES, st.integers(1, 20))
def test_one_block_of_a_lone_recording_is_untouched_unless_blocks_are_few(sizes: list[int], edge: int) -> None:
    numbers = blocks(sizes, edge)
    apart, held = (np.concatenate(of([0] * len(sizes), numbers)) for of in (untouched, held_out))
    number = np.concatenate(numbers)
    assert len(set(number[apart])) == (1 if number.max() == MOST_BLOCKS - 1 else 0)
    assert not (apart & held).any()


def test_of_several_recordings_the_untouched_block_is_the_end_of_what_is_held_out() -> None:
    sources, numbers = [0, 1], blocks([800, 800], 1)
    apart, held = untouched(sources, numbers), held_out(sources, numbers)
    assert not apart[0].any()
    assert np.flatnonzero(apart[1]).tolist() == list(range(700, 800))
    assert held[1].all()


def test_a_last_recording_of_one_block_is_held_out_and_nothing_untouched() -> None:
    assert not np.concatenate(untouched([0, 1], blocks([1500, 100], 1))).any()


@given(SIZES, st.integers(1, 20))
def test_of_a_lone_recording_some_blocks_are_held_out(sizes: list[int], edge: int) -> None:
    numbers = blocks(sizes, edge)
    masks = held_out([0] * len(sizes), numbers)
    held = np.concatenate(masks)
    assert 0.1 < held.mean() < 0.4
    for number in range(int(numbers[-1][-1]) + 1):
        assert len(set(held[np.concatenate(numbers) == number])) == 1


def test_held_out_blocks_do_not_fall_into_step_with_a_motion_that_repeats() -> None:
    held = np.flatnonzero(held_out([0], [np.arange(MOST_BLOCKS)])[0])
    assert len(set(np.diff(held))) > 1


@given(st.integers(2, 12))
def test_of_several_recordings_the_last_are_held_out_whole(count: int) -> None:
    sources = sorted([*range(count), 0])  # the first has two stretches
    masks = held_out(sources, [np.zeros(10, int)] * len(sources))
    whole = [mask.all() for mask in masks]
    assert all(mask.all() or not mask.any() for mask in masks)
    assert whole == sorted(whole)
    assert sum(whole) == max(1, round(SHARE * count))


@given(st.lists(st.integers(0, 2), min_size=30, max_size=80), st.integers(1, 5), st.integers(0, 10))
def test_parts_of_the_data_never_touch(values: list[int], edge: int, start: int) -> None:
    kind = np.array(values)
    parts = divided(kind == 1, kind == 2, edge, start)
    for number, some in enumerate(parts):
        assert (kind[some] == number).all()
        assert not some[: max(edge, start)].any()
        assert not some[-edge:].any()
    for one, other in itertools.combinations(parts, 2):
        if one.any() and other.any():
            assert np.abs(np.flatnonzero(one)[:, None] - np.flatnonzero(other)).min() > edge
    inside = np.zeros(len(kind), bool)
    inside[max(edge, start) : -edge] = True

    def far_from(mask: np.ndarray) -> np.ndarray:
        return ~ndimage.maximum_filter1d(mask.astype(np.uint8), 2 * edge + 1, mode="constant").astype(bool)

    assert (parts[0] == (inside & far_from(kind > 0))).all()
    assert (parts[1] == (inside & (kind == 1) & far_from(kind == 2))).all()
    assert (parts[2] == (inside & (kind == 2))).all()


def test_a_start_is_unknown_until_the_axis_has_moved_over_the_memory() -> None:
    position = np.linspace(0.0, 1.0, 101)
    assert unknown([position], 0.0) == [0]
    assert unknown([position, -position], 0.055) == [6, 6]
    assert unknown([position], 0.295) == [15], "half as far, where the whole is too much of the data"
    assert unknown([0.0 * position], 0.1) == [0], "what never moves"


def test_a_short_stretch_that_never_moves_so_far_is_unknown_as_a_whole() -> None:
    position = np.linspace(0.0, 1.0, 101)
    assert unknown([position, 0.05 * position[:20]], 0.1) == [10, 20]


def test_a_start_that_lasts_too_long_is_compared_sooner() -> None:
    recording = recorded(axis())
    span = float(np.ptp(recording.position))
    masks = [prepare([recording], held_out=False, memory=m).train for m in (0.0, 0.01 * span, 0.99 * span)]
    kept = [int(train.argmax()) for train in masks]
    assert kept[0] < kept[1]
    assert kept[0] < kept[2] < kept[0] + MOST_UNKNOWN * len(masks[0])


def test_a_lone_recording_and_several_leave_data_to_fit_and_to_compare() -> None:
    one, two = recorded(axis(), duration=20.0), recorded(axis(), duration=10.0, seed=1)
    for recordings in ([one], [one, two], [one, two.part(slice(0, 400))]):
        data = prepare(recordings)
        assert not (data.train & data.held_out).any()
        assert data.train.sum() > 0.3 * len(data.train)
        assert 0.15 < data.held_out.mean() < (0.3 if len(recordings) == 1 else 0.4)
    whole = prepare([one, two])
    assert [bool(s.held_out.any()) for s in whole.stretches] == [False, True]
    assert not prepare([one], held_out=False).held_out.any()


@pytest.mark.parametrize("some", [True, False])
def test_edges_are_in_neither(some: bool) -> None:
    (stretch,) = prepare([recorded(axis(), duration=20.0)], held_out=some).stretches
    used = stretch.train | stretch.held_out
    assert not used[:10].any()
    assert not used[-10:].any()
