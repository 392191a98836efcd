"""What became of the tracking error from one run to the next, and whether that is more than chance."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.control.tracking import errors_by_reversal, improvement
from tcs_friction.errors import InputError


def run(scale: float, seed: int, reversals: int = 6, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, reference speed and an error that is large at each reversal, `scale` times as large as in the first run."""
    t = np.arange(0.0, 2.0 * reversals + 1.0, 0.01)
    speed = np.sin(0.5 * np.pi * t)
    random = np.random.default_rng(seed)
    peak = np.exp(-20.0 * speed**2)
    return t, speed, scale * peak + noise * random.standard_normal(len(t))


def errors(*arguments: float, **options: float) -> np.ndarray:
    return errors_by_reversal(*run(*arguments, **options), 0.5)  # type: ignore[arg-type]


def test_errors_are_taken_around_each_reversal() -> None:
    t, speed, _ = run(1.0, 0)
    error = np.where(t < 3.0, 2.0, 5.0)  # of reversals at 2 s, 4 s, ...
    found = errors_by_reversal(t, speed, error, 0.5)
    assert found[0] == pytest.approx(2.0, rel=0.02)  # the reversal at 2 s lasts to 3 s, half-way to the next
    assert found[1:] == pytest.approx(5.0)
    assert len(found) == 6


def test_a_tenth_of_the_error_is_an_improvement() -> None:
    gain = improvement(errors(1.0, 1, noise=0.02), errors(0.1, 2, noise=0.02))
    assert gain.proven
    assert gain.lowest < gain.ratio < gain.highest < 0.2


def test_the_same_error_is_none_by_more_than_chance() -> None:
    """Of two runs that differ by noise alone, 5 % may seem to improve."""
    seeming = sum(improvement(errors(1.0, 2 * k), errors(1.0, 2 * k + 1)).proven for k in range(200))
    assert seeming <= 20


def test_a_larger_error_is_none() -> None:
    gain = improvement(errors(1.0, 1), errors(2.4, 2))
    assert not gain.proven
    assert gain.ratio > 1.5


def test_one_reversal_proves_nothing() -> None:
    gain = improvement(np.array([1.0]), np.array([0.01]))
    assert not gain.proven
    assert gain.highest == np.inf


def test_static_friction_below_coulomb_friction_is_refused() -> None:
    with pytest.raises(InputError, match=r"negative.static is 50, expected coulomb \(78.1 N m\) or more"):
        CompensatorConfig(negative=LugreParameters(static=50.0)).validate()
    CompensatorConfig(negative=LugreParameters(static=78.1)).validate()
