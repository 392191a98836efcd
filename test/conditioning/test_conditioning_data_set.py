"""The data set joins its stretches, knows what moves, and narrows torques to what is compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.conditioning.data_set import MOVING, RESOLVED, DataSet, Stretch

DT, STRIDE = 2e-3, 2


def stretch(count: int, speed: float) -> Stretch:
    t = DT * np.arange(count)
    compared = -(-count // STRIDE)
    held = np.arange(compared) < compared // 4
    return Stretch(
        t=t,
        position=speed * t,
        velocity=np.full(count, speed),
        acceleration=np.zeros(count),
        torque=np.sin(t),
        signals=np.stack([np.full(count, 20.0), t]),
        train=~held,
        held_out=held,
        untouched=np.zeros(compared, bool),
        piece=np.arange(compared) // 10,
        resting=np.zeros(count, bool),
    )


@pytest.fixture
def data() -> DataSet:
    return DataSet(
        stretches=(stretch(401, 0.5), stretch(300, -2e-3)),
        period=DT,
        dt=STRIDE * DT,
        stride=STRIDE,
        cutoff=40.0,
        velocity_noise=1e-3,
        position_noise=1e-6,
        position_step=0.0,
        names=("wind",),
        temperature=True,
        notes=(),
    )


def test_stretches_are_joined_at_compared_samples(data: DataSet) -> None:
    assert data.ends.tolist() == [0, 201, 351]
    for name in ("t", "velocity", "train", "held_out", "piece"):
        assert data.joined(name).shape == (351,)
    assert data.joined("signals").shape == (2, 351)
    assert data.joined("t")[201] == 0.0
    assert (data.train == ~data.held_out).all()
    assert data.piece[[0, 200, 201]].tolist() == [0, 20, 0]


def test_what_is_kept_cannot_be_changed(data: DataSet) -> None:
    for values in (data.train, data.held_out, data.piece, data.ends):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1


def test_what_moves_stands_out_of_the_noise(data: DataSet) -> None:
    assert data.speed_threshold == MOVING * 1e-3
    assert data.speed_resolution == RESOLVED * 1e-3
    assert data.moving().tolist() == [True] * 201 + [False] * 150
    assert data.moving(0.5).all()
    assert not data.moving(1000.0).any()
    assert replace(data, velocity_noise=0.0).speed_resolution > 0.0


def test_a_torque_is_narrowed_to_the_cutoff(data: DataSet) -> None:
    t = DT * np.arange(4000)
    inside = slice(100, -100)
    slow, fast = (np.sin(2.0 * np.pi * f * t) for f in (0.5 * data.cutoff, 1.5 * data.cutoff))
    narrow = data.narrowed(slow + fast)
    assert len(narrow) == 2000
    assert narrow[inside] == pytest.approx(slow[::STRIDE][inside], abs=0.02)


@pytest.mark.parametrize("count", [400, 401, 37])
def test_narrowing_keeps_a_constant_and_one_value_for_each_compared_sample(data: DataSet, count: int) -> None:
    assert data.narrowed(np.full(count, 2.5)) == pytest.approx(np.full(-(-count // STRIDE), 2.5))
