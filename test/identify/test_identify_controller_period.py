"""The controller's period, from when the torque is new."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.identify.controller_period import controller_period, rounded
from tcs_friction.recording.recording import Recording


def logged(rate: float, fresh: float, seconds: float = 20.0, jitter: float = 0.0) -> Recording:
    """A log at `rate` of a torque that is new `fresh` times a second."""
    random = np.random.default_rng(0)
    t = np.arange(int(seconds * rate)) / rate
    t = t + jitter * random.uniform(-0.5, 0.5, len(t)) / rate
    values = random.standard_normal(int(seconds * fresh) + 2)
    return Recording(t, t, values[np.maximum((t * fresh + 1e-6).astype(int), 0)])


@pytest.mark.parametrize(
    ("rate", "fresh", "expected"), [(250.0, 50.0, 0.02), (1000.0, 125.0, 0.008), (250.0, 48.0, 1.0 / 48.0), (500.0, 100.0, 0.01)]
)
def test_a_held_torque_tells_the_period(rate: float, fresh: float, expected: float) -> None:
    period, why = controller_period([logged(rate, fresh, jitter=0.1)])
    assert period == pytest.approx(expected, rel=2e-3)
    assert why == "every so long the recorded torque is new"


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_a_torque_that_is_always_new_tells_no_other_than_the_logs(rate: float) -> None:
    period, why = controller_period([logged(rate, rate, jitter=0.2)])
    assert period == pytest.approx(1.0 / rate, rel=1e-6)
    assert why == "between the samples of the log"


def test_a_torque_that_hardly_changes_is_not_held() -> None:
    """Constant but for a few steps of the reference."""
    assert controller_period([logged(100.0, 0.5)])[0] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("found", "round_one"),
    [(0.0039998, 0.004), (1.0 / 119.97, 1.0 / 120.0), (1.0 / 128.0, 1.0 / 128.0), (0.0010003, 0.001), (0.02003, 0.02003)],
)
def test_a_period_is_as_round_as_clocks_allow(found: float, round_one: float) -> None:
    assert rounded(found) == pytest.approx(round_one, rel=1e-4)
