"""What the position does to the torque, as far as a recording tells."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.motion import Motion, prepare
from tcs_friction.identify.gravity import position_torque
from tcs_friction.recording.recording import Recording

RATE = 200.0
T = np.arange(int(60.0 * RATE)) / RATE
COULOMB, INERTIA = 2.0, 0.5


def swung(travel: float, seed: int = 0) -> np.ndarray:
    """(n,) rad, over several speeds, about 0.3."""
    return 0.3 + 0.5 * travel * (0.7 * np.sin(0.5 * T + seed) + 0.3 * np.sin(1.7 * T))


def driven(position: np.ndarray, more: np.ndarray, noise: float = 0.1) -> Motion:
    random = np.random.default_rng(5)
    v = np.gradient(position, 1.0 / RATE)
    torque = INERTIA * np.gradient(v, 1.0 / RATE) + COULOMB * np.sign(v) + more + noise * random.standard_normal(len(T))
    return prepare([Recording(T, position + 1e-6 * random.standard_normal(len(T)), torque)])


@pytest.mark.parametrize("travel", [2.0, 6.0])
@pytest.mark.parametrize("bias", [0.0, 1.5])
def test_gravity_over_a_wide_travel_is_known(travel: float, bias: float) -> None:
    position = swung(travel)
    motion = driven(position, 5.0 * np.sin(position + 0.4) + bias)
    found = position_torque(motion, "rotary", 12.0)
    assert found.gravity is not None
    sine, cosine = found.gravity
    assert np.hypot(sine, cosine) == pytest.approx(5.0, rel=0.1)
    assert np.arctan2(cosine, sine) == pytest.approx(0.4, abs=0.1)
    assert found.spring is None


def test_over_a_short_travel_it_is_a_straight_line_and_nothing_cancels() -> None:
    position = swung(0.2)
    found = position_torque(driven(position, 5.0 * np.sin(position)), "rotary", 8.0)
    assert found.gravity is None
    assert found.spring == pytest.approx(5.0 * np.cos(0.3), rel=0.1)
    assert np.abs(found.balance.values[3:]).max() < 8.0


@pytest.mark.parametrize("kind", ["rotary", "linear"])
def test_a_spring_is_a_straight_line_over_any_travel(kind: str) -> None:
    position = swung(3.0)
    found = position_torque(driven(position, 4.0 * (position - 0.3)), kind, 10.0)
    assert found.gravity is None
    assert found.spring == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("more", [0.0, 3.0])
def test_friction_and_a_constant_alone_have_neither(more: float) -> None:
    found = position_torque(driven(swung(3.0), np.full(len(T), more)), "rotary", 6.0)
    assert (found.gravity, found.spring) == (None, None)


def test_what_grows_with_time_is_no_spring_of_an_axis_that_never_comes_back() -> None:
    position = 0.05 * T + 0.001 * np.sin(3.0 * T)
    found = position_torque(driven(position, 0.1 * T), "linear", 10.0)
    assert found.spring is None


def test_nothing_is_larger_than_what_the_recording_has_seen() -> None:
    """The same gravity and spring, of which somebody claims that no such torque was ever there."""
    position = swung(2.0)
    assert position_torque(driven(position, 5.0 * np.sin(position)), "rotary", 0.2).gravity is None
    assert position_torque(driven(position, 5.0 * position), "linear", 0.2).spring is None
