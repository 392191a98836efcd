"""What was learned comes back from a file as it was, and nothing else is taken for it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from monitor_cases import blocks

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError, JobError
from tcs_friction.monitor.baseline import Baseline, learned
from tcs_friction.monitor.evidence import fresh, judge
from tcs_friction.monitor.kept import identity, load_learned, save_learned

AXIS = load_axis(shipped("azimuth_1p2m.yaml")).axis


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    return learned(blocks(300.0), AXIS.cycle)


def evidence(baseline: Baseline) -> np.ndarray:
    state = fresh(baseline)
    for row in blocks(60.0, seed=3, begin=300.0):
        judge(baseline, state, row)
    return state.logs


def test_what_was_learned_judges_as_before(baseline: Baseline, tmp_path: Path) -> None:
    path = tmp_path / "new" / "learned.npz"
    assert load_learned(path, "a") is None
    save_learned(path, baseline, "a")
    found = load_learned(path, "a")
    assert found is not None
    np.testing.assert_array_equal(evidence(found), evidence(baseline))
    assert [file.name for file in path.parent.iterdir()] == ["learned.npz"]


def test_what_was_learned_of_something_else_is_refused(baseline: Baseline, tmp_path: Path) -> None:
    own = identity(AXIS, 1e-3, ())
    save_learned(tmp_path / "learned.npz", baseline, own)
    other = AXIS.with_friction({"coulomb": 1.01 * AXIS.friction.values["coulomb"]})
    for watched in (identity(other, 1e-3, ()), identity(AXIS, 2e-3, ()), identity(AXIS, 1e-3, ("wind",))):
        assert watched != own
        with pytest.raises(InputError, match="learned with another axis file or period"):
            load_learned(tmp_path / "learned.npz", watched)


@pytest.mark.parametrize("content", [b"", b"PK\3\4 and no more", b"text", b"\x93NUMPY"])
def test_a_file_of_another_kind_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "learned.npz").write_bytes(content)
    with pytest.raises(InputError, match="is not what a monitor has learned"):
        load_learned(tmp_path / "learned.npz", "a")
    with pytest.raises(InputError, match="Is a directory"):
        load_learned(tmp_path, "a")


@pytest.mark.parametrize(
    ("name", "value"),
    [("format", "tcs_friction/learned/0"), ("mean", np.zeros(3)), ("ends", np.arange(5)), ("active", np.zeros(3)),
     ("waves", np.zeros((7, 3))), ("waves", np.zeros(3)), ("noise", np.array(np.nan)), ("scatter", np.array(["x"]))],
)  # fmt: skip
def test_arrays_that_no_watch_learns_are_refused(name: str, value: Any, baseline: Baseline, tmp_path: Path) -> None:
    """Compiled code takes them without looking."""
    path = tmp_path / "learned.npz"
    save_learned(path, baseline, "a")
    arrays = dict(np.load(io.BytesIO(path.read_bytes())))
    np.savez(path, **{**arrays, name: value})
    with pytest.raises(InputError, match="is not what this version learns"):
        load_learned(path, "a")


def test_a_place_that_cannot_be_written_is_named(baseline: Baseline, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JobError, match="file"):
        save_learned(tmp_path / "file" / "learned.npz", baseline, "a")
