"""The file of what the monitor has learned: of what it holds, and what a disk may refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.analysis import learned
from tcs_friction.nodes.analysis.learned import identity, load_learned, save_learned

AXIS = load_axis(shipped("azimuth_1p2m.yaml")).axis


def test_what_was_learned_is_of_one_model_one_period_and_its_signals() -> None:
    other = AXIS.with_friction({"coulomb": 1.01 * AXIS.friction.values["coulomb"]})
    assert identity(load_axis(shipped("azimuth_1p2m.yaml")).axis, 1e-3, ()) == identity(AXIS, 1e-3, ())
    known = {identity(axis, period, ()) for axis in (AXIS, other) for period in (1e-3, 2e-3)} | {identity(AXIS, 1e-3, ("wind",))}
    assert len(known) == 5


def test_what_the_disk_refuses_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    anything: Any = None
    monkeypatch.setattr(learned, "packed", lambda *_: b"content")
    save_learned(tmp_path / "new" / "learned.npz", anything, "a")
    assert [path.read_bytes() for path in (tmp_path / "new").iterdir()] == [b"content"]
    assert load_learned(tmp_path / "none.npz", "a") is None
    with pytest.raises(InputError, match="Is a directory"):
        load_learned(tmp_path, "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(JobError, match="file"):
        save_learned(tmp_path / "file" / "learned.npz", anything, "a")
