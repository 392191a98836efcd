"""The guard keeps what measured tracking is better for, and puts back what it is not."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.control.guard import Chosen, choose, judged, windowed
from tcs_friction.errors import InputError

WORTH = {"cogging": 0.6, "bias": 0.9, "wrong": 1.5, "worst": 4.0, "nothing": 1.0}
"""What each effect does to the error."""


def measured(effects: tuple[str, ...], seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng([seed, len(effects), *(ord(name[0]) for name in effects)])
    return np.prod([WORTH[name] for name in effects]) * rng.lognormal(sigma=0.1, size=60)


def chosen(effects: list[str], seed: int = 0) -> Chosen:
    before = np.random.default_rng([seed, 99]).lognormal(sigma=0.1, size=60)
    return judged(choose(effects, before), lambda effects: measured(effects, seed))


@pytest.mark.parametrize(
    ("effects", "kept"),
    [
        (["cogging", "bias"], ("cogging", "bias")),
        (["cogging", "wrong"], ("cogging",)),
        (["wrong"], None),
        (["cogging", "bias", "wrong"], ("cogging", "bias")),
        (["worst", "cogging", "bias"], ("cogging", "bias")),
        (["worst", "wrong"], None),
    ],
)
def test_what_helps_is_kept_and_what_hurts_is_not(effects: list[str], kept: tuple[str, ...] | None) -> None:
    found = chosen(effects)
    assert found.effects == kept
    for name in kept or ():
        gain = found.gains[name]
        assert gain.proven
        assert gain.cancelled / gain.without == pytest.approx(WORTH[name], rel=0.1)
        assert gain.improvement.ratio == pytest.approx(WORTH[name], rel=0.1)
    for name in set(effects) - set(kept or ()):
        assert name not in found.gains or not found.gains[name].proven


def test_effects_that_undo_each_other_are_told_apart() -> None:
    """A spring and its rest, say: either alone makes it worse, both together make it better."""
    shares = {("a", "b"): 0.5, ("a",): 1.4, ("b",): 1.4}
    rng = np.random.default_rng(1)
    before = rng.lognormal(sigma=0.1, size=60)
    found = judged(choose(["a", "b"], before), lambda effects: shares[effects] * rng.lognormal(sigma=0.1, size=60))
    assert found.effects == ("a", "b")


def test_what_does_nothing_is_hardly_ever_kept() -> None:
    kept = sum(chosen(["nothing"], seed).effects is not None for seed in range(300))
    assert kept < 0.1 * 300, "one in twenty by chance"


def test_a_set_that_is_refused_is_not_chosen() -> None:
    def measure(effects: tuple[str, ...]) -> np.ndarray | None:
        return None if "wrong" in effects else measured(effects)

    before = np.random.default_rng(99).lognormal(sigma=0.1, size=60)
    found = judged(choose(["cogging", "wrong", "bias"], before), measure)
    assert found.effects == ("cogging", "bias")
    assert judged(choose(["wrong"], before), measure).effects is None


def test_windows_after_settling_hold_the_runs_power() -> None:
    t = 1e-3 * np.arange(5501)
    error = np.where(t < 2.0, 100.0, 3.0)
    assert windowed(t, error, 2.0) == pytest.approx([3.0, 3.0, 3.0])
    with pytest.raises(InputError, match="more than 6 s, to be judged"):
        windowed(t, error, 5.0)
