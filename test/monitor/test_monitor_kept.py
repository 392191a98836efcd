"""What was learned comes back as it was, and nothing else is taken for it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from monitor_cases import blocks

from tcs_friction.errors import InputError
from tcs_friction.monitor.baseline import Baseline, learned
from tcs_friction.monitor.evidence import fresh, judge
from tcs_friction.monitor.kept import packed, unpacked


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    return learned(blocks(300.0), 1.0)


def evidence(baseline: Baseline) -> np.ndarray:
    state = fresh(baseline)
    for row in blocks(60.0, seed=3, begin=300.0):
        judge(baseline, state, row)
    return state.logs


def test_what_was_learned_judges_as_before(baseline: Baseline) -> None:
    found = unpacked(packed(baseline, "a"), "a", "file")
    np.testing.assert_array_equal(evidence(found), evidence(baseline))


def test_what_was_learned_of_something_else_is_refused(baseline: Baseline) -> None:
    with pytest.raises(InputError, match="file: was learned with another axis file or period"):
        unpacked(packed(baseline, "a"), "b", "file")


@pytest.mark.parametrize("content", [b"", b"PK\3\4 and no more", b"text", b"\x93NUMPY"])
def test_content_of_another_kind_is_refused(content: bytes) -> None:
    with pytest.raises(InputError, match="file: is not what a monitor has learned"):
        unpacked(content, "a", "file")


@pytest.mark.parametrize(
    ("name", "value"),
    [("format", "tcs_friction/learned/0"), ("mean", np.zeros(3)), ("ends", np.arange(5)), ("active", np.zeros(3)),
     ("waves", np.zeros((7, 3))), ("waves", np.zeros(3)), ("noise", np.array(np.nan)), ("scatter", np.array(["x"]))],
)  # fmt: skip
def test_arrays_that_no_watch_learns_are_refused(name: str, value: Any, baseline: Baseline) -> None:
    """Compiled code takes them without looking."""
    content = io.BytesIO()
    np.savez(content, **{**np.load(io.BytesIO(packed(baseline, "a"))), name: value})
    with pytest.raises(InputError, match="is not what this version learns"):
        unpacked(content.getvalue(), "a", "file")
