"""A watch over single ticks: what it learns from, what gaps do, and that a change is told once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from monitor_cases import blocks

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError, JobError
from tcs_friction.monitor.residual import RESIDUAL, SPEED
from tcs_friction.monitor.watch import MOST_FILLED, Watch, WatchConfig

AXIS = load_axis(shipped("azimuth_1p2m.yaml")).axis
PERIOD = 1e-3


def watch_that_learned(seconds: float = 300.0) -> Watch:
    watch = Watch(AXIS, PERIOD, WatchConfig(learning_time=200.0))
    for row in blocks(seconds):
        watch.block(row)
    watch.adopt(watch.learned())
    return watch


def test_a_watch_learns_then_judges_and_tells_a_change_once() -> None:
    watch = Watch(AXIS, PERIOD, WatchConfig(learning_time=200.0))
    assert watch.is_learning
    assert watch.strongest is None
    assert watch.log_evidence == 0.0
    rows = blocks(300.0)
    for row in rows[:5000]:
        watch.block(row)
    assert 0.4 < watch.learned_share < 0.6
    assert not watch.has_seen_enough
    for row in rows[5000:]:
        watch.block(row)
    assert watch.has_seen_enough
    watch.adopt(watch.learned())
    assert watch.learned_share == 1.0
    later = blocks(80.0, seed=4, begin=300.0)
    for row in later[:2000]:
        watch.block(row)
    assert watch.told is None
    assert watch.over_alarm < -1.0
    later[:, RESIDUAL] += np.sign(later[:, SPEED])
    for row in later[2000:]:
        watch.block(row)
    told = watch.told
    assert told is not None
    assert watch.over_alarm > 0.0
    assert math.isfinite(watch.left) or watch.judged_share < 1.0
    for row in later[2000:]:
        watch.block(row)
    assert watch.told is told
    assert watch.strongest is not None
    assert watch.strongest.evidence > told.evidence


def test_a_change_can_be_forgotten_and_the_axis_learned_anew() -> None:
    watch = watch_that_learned()
    rows = blocks(60.0, seed=4, begin=300.0)
    rows[:, RESIDUAL] += 2.0
    for row in rows:
        watch.block(row)
    assert watch.told is not None
    watch.forget_change()
    assert watch.told is None
    assert not watch.is_learning
    assert watch.log_evidence == pytest.approx(0.0)
    watch.learn_anew()
    assert watch.is_learning
    assert watch.learned_time == 0.0
    with pytest.raises(JobError, match="learning period: 0 s of motion"):
        watch.learned(np.zeros((0, rows.shape[1])))


def test_missing_ticks_are_filled_and_gaps_interrupt() -> None:
    watch = Watch(AXIS, PERIOD)
    blocks_of = sum(watch.tick(PERIOD, 1e-3 * k, 1.0) for k in range(40))
    assert blocks_of == 2
    assert watch.tick((MOST_FILLED + 1) * PERIOD, 0.05, 1.0) is False
    assert watch.clock == pytest.approx((41 + MOST_FILLED) * PERIOD, abs=PERIOD * 20)
    assert watch.stretches == 0
    before = watch.clock
    watch.tick(1.0, 0.05, 1.0)
    assert watch.stretches == 1
    assert watch.clock == pytest.approx(before + 1.0, abs=0.02)
    watch.tick(-5.0, 0.05, 1.0)
    assert watch.stretches == 2
    assert watch.clock >= before + 1.0 - 1e-9


def test_filled_ticks_lie_on_a_line() -> None:
    whole, gappy = Watch(AXIS, PERIOD), Watch(AXIS, PERIOD)
    for k in range(197):
        whole.tick(PERIOD, 1e-5 * k, 10.0)
        if k % 7 not in (3, 4):
            gappy.tick(PERIOD * (3 if k % 7 == 5 else 1), 1e-5 * k, 10.0)
    assert gappy.residual == pytest.approx(whole.residual, rel=1e-9)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"learning_time": 1.0}, "learning_time is 1, expected a number from 30 to 100000 s"),
        ({"alarm_interval": math.nan}, "alarm_interval is nan, expected a number from 0.01 to 100000 d"),
    ],
)
def test_bad_settings_are_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Watch(AXIS, PERIOD, WatchConfig(**values))
