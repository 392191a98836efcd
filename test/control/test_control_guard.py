"""The guard keeps what measured tracking is better for, and puts back what it is not."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.control.guard import subsets, verified, windowed
from tcs_friction.errors import InputError

WORTH = {"cogging": 0.6, "bias": 0.9, "wrong": 1.5, "nothing": 1.0}
"""What each effect does to the error."""


def measured(chosen: tuple[str, ...], seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng([seed, len(chosen), *(ord(name[0]) for name in chosen)])
    return np.prod([WORTH[name] for name in chosen]) * rng.lognormal(sigma=0.1, size=60)


@pytest.mark.parametrize(
    ("effects", "kept"),
    [
        (["cogging", "bias"], {"cogging", "bias"}),
        (["cogging", "wrong"], {"cogging"}),
        (["wrong"], set()),
        (["cogging", "bias", "wrong"], {"cogging", "bias"}),
    ],
)
def test_what_helps_is_kept_and_what_hurts_is_not(effects: list[str], kept: set[str]) -> None:
    best, gains = verified((), subsets(effects), measured)
    assert set(best) == kept
    assert set(gains) <= set(subsets(effects))
    if kept:
        assert gains[best].highest < 1.0


def test_what_does_nothing_is_hardly_ever_kept() -> None:
    tried = [verified((), subsets(["nothing"]), lambda chosen, seed=seed: measured(chosen, seed)) for seed in range(300)]
    assert sum(bool(best) for best, _ in tried) < 0.1 * 300, "one in twenty by chance"


def test_windows_after_settling_hold_the_runs_power() -> None:
    t = 1e-3 * np.arange(5501)
    error = np.where(t < 2.0, 100.0, 3.0)
    assert windowed(t, error, 2.0) == pytest.approx([3.0, 3.0, 3.0])
    with pytest.raises(InputError, match="more than 6 s, to be judged"):
        windowed(t, error, 5.0)


def test_every_effect_is_tried_with_and_without_the_others() -> None:
    assert subsets(["a", "b", "c"]) == [("a", "b", "c"), ("a",), ("b",), ("c",), ("b", "c"), ("a", "c"), ("a", "b")]
    assert subsets(["a"]) == [("a",), ()]
