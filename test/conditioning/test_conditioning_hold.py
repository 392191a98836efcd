"""What a hold makes of a torque between the samples of a log."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator

from tcs_friction.conditioning.hold import Between, LoggedTorque, fresh, logged, stale_stride

RANDOM = np.random.default_rng(0)
T = np.cumsum(RANDOM.uniform(0.5e-3, 1.5e-3, 200))
VALUES = RANDOM.standard_normal(200)


@pytest.mark.parametrize("between", list(Between))
@pytest.mark.parametrize("acts", [-2.3e-3, 0.0, 7.1e-3])
def test_integrals_are_those_of_the_torque(between: Between, acts: float) -> None:
    """Against a fine sum over what the log says, for any stamps and any timing."""
    log = LoggedTorque(T, VALUES, 1e-3, between)
    fine = np.linspace(T[10], T[-10], 400_001)
    if between is Between.HELD:
        torque = VALUES[np.searchsorted(T, fine - acts, side="right") - 1]
    elif between is Between.HELD_UP_TO:
        torque = VALUES[np.searchsorted(T, fine - acts - 1e-3, side="right")]
    else:
        torque = Akima1DInterpolator(T, VALUES)(fine - acts - 0.5e-3)
    step = fine[1] - fine[0]
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1])) * step])
    lever = np.concatenate([[0.0], np.cumsum(0.5 * (impulse[1:] + impulse[:-1])) * step])
    first, second = log.integrals(fine[::1000], acts)
    assert first - first[0] == pytest.approx(impulse[::1000], abs=2e-5)  # a sum of steps
    apart = fine[::1000] - fine[0]
    assert second - second[0] - first[0] * apart == pytest.approx(lever[::1000], abs=2e-6)


def test_a_value_that_is_held_up_to_its_stamp_acts_from_the_one_before() -> None:
    mean, moves = LoggedTorque(T, VALUES, 1e-3, Between.HELD_UP_TO).pushes(T, -1e-3)
    assert mean == pytest.approx(VALUES[1:])
    assert moves == pytest.approx(VALUES[1:])
    even = np.arange(200) * 1e-3
    one, other = (LoggedTorque(even, VALUES, 1e-3, between).pushes(T[5:150], -0.7e-3)[0] for between in list(Between)[:2])
    assert one == pytest.approx(other), "even stamps do not tell the two apart"


def test_a_push_moves_a_mass_as_the_torque_does() -> None:
    """Velocity by the mean, position by the constant torque that moves as far: of a torque that changes within the span."""
    log = LoggedTorque(np.array([0.0, 1.0, 2.0]), np.array([0.0, 3.0, 0.0]), 1.0)
    mean, moves = log.pushes(np.array([0.5, 1.5]), 0.0)
    assert mean == pytest.approx([1.5])
    assert 0.5 * moves == pytest.approx([3.0 * 0.5 * 0.5**2])  # the position after the span, from rest


def test_before_and_after_the_log_its_ends_act() -> None:
    log = LoggedTorque(np.array([0.0, 1.0]), np.array([2.0, 5.0]), 1.0)
    mean, _ = log.pushes(np.array([-3.0, -2.0, 4.0, 5.0]), 0.0)
    assert mean[[0, 2]] == pytest.approx([2.0, 5.0])


@pytest.mark.parametrize("stride", [2, 5])
def test_stale_values_are_told_from_fresh_ones(stride: int) -> None:
    values = np.repeat(RANDOM.standard_normal(100), stride)
    t = np.arange(len(values)) * 1e-3
    assert stale_stride(t, values) == stride
    assert (fresh(t, values) % stride == 0).all()
    line = LoggedTorque(t, values, 1e-3).drawn(Between.LINE)
    assert line.period == pytest.approx(stride * 1e-3)
    assert len(line.t) == 100


def test_a_torque_that_rests_now_and_then_is_not_stale() -> None:
    values = RANDOM.standard_normal(400)
    values[100:180] = 0.0
    t = np.arange(400.0)
    assert stale_stride(t, values) == 1
    assert len(fresh(t, values)) == 400
    assert stale_stride(t, np.zeros(400)) == 1


@pytest.mark.parametrize("stride", [2, 5])
def test_what_was_lost_of_stale_values_is_what_is_repeated_beside_it(stride: int) -> None:
    values = np.repeat(RANDOM.standard_normal(400), stride)
    t = np.arange(len(values)) * 1e-3
    kept = RANDOM.uniform(size=len(t)) > 0.05
    kept[[0, -1]] = True
    assert stale_stride(t[kept], values[kept]) == stride
    log = logged(t[kept], values[kept])
    assert log.t == pytest.approx(t)
    known = log.lost == 0.0
    assert known.mean() > 0.99
    assert (log.values[known] == values[known]).all()
    line = log.drawn(Between.LINE)
    assert line.t == pytest.approx(t[::stride])
    assert (np.diff(fresh(t[kept], values[kept])) > 0).all()
    assert (np.searchsorted(t, t[kept][fresh(t[kept], values[kept])]) % stride == 0).all()


def test_stamps_a_day_apart_take_no_memory() -> None:
    values = np.repeat(RANDOM.standard_normal(60), 3)
    t = np.arange(len(values)) * 1e-4
    t[90:] += 86_400.0
    assert stale_stride(t, values) == 3


def test_lost_values_lie_on_a_line_and_pauses_stay() -> None:
    t = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 20.0, 21.0])
    log = logged(t, np.array([0.0, 0.0, 2.0, 4.0, 0.0, 0.0, 7.0, 7.0]))
    assert log.t.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 20.0, 21.0]
    assert log.values[3] == pytest.approx(3.0)


def test_only_what_was_lost_of_a_held_torque_is_rough() -> None:
    t = np.delete(np.arange(300) * 1e-3, [40, 200])
    log = logged(t, RANDOM.standard_normal(len(t)))
    assert np.flatnonzero(log.roughness).tolist() == [40, 200]
    assert (logged(T[:1] + 1e-3 * np.arange(50), VALUES[:50]).roughness == 0.0).all()
    line = LoggedTorque(t, 1e3 * t**2, 1e-3).drawn(Between.LINE)
    assert line.roughness[100] == pytest.approx(1e-3, rel=0.01)  # half the second difference of a parabola
