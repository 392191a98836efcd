"""Runs of a mask are what a loop over its samples finds."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.numerics.runs import runs


def test_first_and_past_last_index_of_each_run() -> None:
    mask = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], bool)
    assert runs(mask).tolist() == [[0, 2], [3, 4], [6, 9]]


def test_a_mask_without_runs_gives_none() -> None:
    assert runs(np.zeros(3, bool)).shape == runs(np.zeros(0, bool)).shape == (0, 2)


@given(st.lists(st.booleans(), max_size=40))
def test_runs_are_maximal_and_make_up_the_mask(values: list[bool]) -> None:
    mask = np.array(values, bool)
    found = runs(mask)
    again = np.zeros(len(mask), bool)
    for begin, end in found:
        assert begin < end
        again[begin:end] = True
    assert (again == mask).all()
    assert (found[1:, 0] > found[:-1, 1]).all()  # else they would be one
