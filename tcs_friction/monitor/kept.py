"""What a watch has learned as the content of a file, so that a restart does not cost another learning period."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.monitor.bank import ENDS, LINES, ORDERS, SPEED_BANDS, Layout
from tcs_friction.monitor.baseline import MOST_WAVES, PRIOR, Baseline

FORMAT = "tcs_friction/learned/1"
TESTS = int(ENDS[-1])
SHAPES: dict[str, tuple[int, ...]] = {
    "travel": (2,), "speeds": (SPEED_BANDS + 1,), "orders": (ORDERS,), "ends": ENDS.shape,
    "shares": (len(PRIOR),), "covariance": (len(PRIOR), len(PRIOR)), "noise": (), "mean": (TESTS,), "variance": (TESTS,),
    "scatter": (TESTS,), "active": (TESTS,), "level": (LINES,),
}  # fmt: skip
"""Of the arrays in a file. `waves` has up to MOST_WAVES rows of 3."""


def packed(baseline: Baseline, watched: str) -> bytes:
    """The content of a file. `watched`: what it was learned of."""
    content = io.BytesIO()
    arrays = {**baseline.known._asdict(), **{name: value for name, value in baseline._asdict().items() if name != "known"}}
    np.savez(content, format=FORMAT, watched=watched, **arrays)
    return content.getvalue()


def unpacked(content: bytes, watched: str, where: str) -> Baseline:
    """What was learned of the same `watched`. Raises InputError, which names `where`, for any other content."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            found: dict[str, Any] = {name: file[name] for name in ("format", "watched", "waves", *SHAPES)}
    except (ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile):
        raise InputError(where, "is not what a monitor has learned", f"a file {FORMAT}") from None
    if str(found.pop("format")) != FORMAT or not _is_whole(found):
        raise InputError(where, "is not what this version learns", f"a file {FORMAT}")
    if str(found.pop("watched")) != watched:
        raise InputError(where, "was learned with another axis file or period", "the same model as now")
    known = Layout(**{name: found.pop(name) for name in Layout._fields})
    return Baseline(known, **{**found, "noise": float(found["noise"])})


def _is_whole(found: dict[str, Any]) -> bool:
    """Whether the arrays are those of a baseline: compiled code takes them without looking."""
    kinds = {"active": np.bool_, "ends": np.int64}
    waves = found["waves"]
    return (
        all(found[name].shape == shape and found[name].dtype == kinds.get(name, np.float64) for name, shape in SHAPES.items())
        and bool(np.all(found["ends"] == ENDS))
        and waves.dtype == np.float64
        and waves.ndim == 2
        and waves.shape[1] == 3
        and len(waves) <= MOST_WAVES
        and not any(np.isnan(found[name]).any() for name in SHAPES)
    )
