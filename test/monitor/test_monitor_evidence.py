"""What a watch learns and tells, on residuals made of numbers: changes in each coordinate are named, and nothing else is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from monitor_cases import INERTIA, LEVEL, NOISE, VISCOUS, Array, blocks

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import JobError
from tcs_friction.monitor import evidence as tests
from tcs_friction.monitor.bank import COORDINATES, judged
from tcs_friction.monitor.baseline import Baseline, learned
from tcs_friction.monitor.evidence import JUDGED, LOOKS, OTHER, combined, fresh, judge_all
from tcs_friction.monitor.finding import Finding, finding
from tcs_friction.monitor.residual import BLOCK, END, INERTIAL, PARTS, PLACE, RESIDUAL, SLOWEST, SPEED
from tcs_friction.monitor.watch import WatchConfig

AXIS = load_axis(shipped("azimuth_1p2m.yaml")).axis
LIMIT = WatchConfig().limit
LEARNED = 900.0


def off(rows: Array) -> Array:
    """The same blocks seen by a model that is 2 % off and lacks a cogging of 72 periods a turn and one of 31."""
    more = rows[:, PARTS] @ np.array([0.004, 0.02, 0.0, -0.02, 0.02, 0.0, 0.0])
    rows[:, RESIDUAL] += more + 0.5 * np.cos(72.0 * rows[:, PLACE] + 0.3) + 0.2 * np.cos(31.0 * rows[:, PLACE])
    return rows


@pytest.fixture(scope="module")
def exact() -> Baseline:
    return learned(blocks(LEARNED), 1.0)


@pytest.fixture(scope="module")
def wrong() -> Baseline:
    return learned(off(blocks(LEARNED)), 1.0)


def told(base: Baseline, rows: Array) -> tuple[float, Finding | None, float]:
    """Seconds until a change is told (inf: never), what is said, and the highest evidence over that of an alarm, log10."""
    state, highest = fresh(base, float(rows[0, END])), np.full(1, -math.inf)
    at = judge_all(base, state, rows, LIMIT, highest)
    found = finding(base, state, AXIS) if at >= 0 else None
    return (at + 1) * BLOCK if at >= 0 else math.inf, found, (float(highest[0]) - LIMIT) / math.log(10.0)


def test_what_a_model_has_wrong_is_learned(wrong: Baseline) -> None:
    assert wrong.shares[:2] == pytest.approx([0.004, 0.02], abs=5e-4)
    assert wrong.shares[3:5] == pytest.approx([-0.02, 0.02], abs=2e-3)
    assert sorted(np.round(wrong.waves[:, 0])) == [31.0, 72.0]
    assert wrong.noise == pytest.approx(NOISE, rel=0.02)


@pytest.mark.parametrize("model", ["exact", "wrong"])
def test_an_axis_that_does_not_change_is_no_alarm(model: str, request: pytest.FixtureRequest) -> None:
    base = request.getfixturevalue(model)
    rows = blocks(3600.0, seed=7, begin=LEARNED)
    seconds, _, highest = told(base, off(rows) if model == "wrong" else rows)
    assert seconds == math.inf
    assert highest < -2.0


def _friction(rows: Array) -> Array:
    return 0.2 * np.sign(rows[:, SPEED])


def _one_way(rows: Array) -> Array:
    return 0.3 * (rows[:, SPEED] < 0.0) * -1.0


def _viscous(rows: Array) -> Array:
    return 6.0 * rows[:, SPEED]


def _bump(rows: Array) -> Array:
    return 1.0 * np.sign(rows[:, SPEED]) * np.exp(-(((rows[:, PLACE] - 0.05) / 0.01) ** 2))


def _cogging(rows: Array) -> Array:
    return 0.2 * np.cos(150.0 * rows[:, PLACE] + 1.0)


def _vibration(rows: Array) -> Array:
    return 0.25 * np.cos(2.0 * np.pi * 6.1 * rows[:, END])


def _offset(rows: Array) -> Array:
    return np.full(len(rows), -0.15)


CHANGES: dict[str, tuple[Callable[[Array], Array], str, float]] = {
    "more friction": (_friction, "direction", 0.2),
    "friction in one direction": (_one_way, "direction", 0.3),
    "viscous friction": (_viscous, "speed", 6.0),
    "a bump": (_bump, "position", 1.0),
    "cogging": (_cogging, "order", 0.2),
    "a vibration": (_vibration, "frequency", 0.25),
    "a torque": (_offset, "time", -0.15),
}


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("model", ["exact", "wrong"])
def test_a_change_is_told_and_named(name: str, model: str, request: pytest.FixtureRequest) -> None:
    base = request.getfixturevalue(model)
    more, coordinate, size = CHANGES[name]
    rows = blocks(600.0, seed=3, begin=LEARNED)
    if model == "wrong":
        off(rows)
    changed = rows[:, END] > LEARNED + 100.0
    rows[:, RESIDUAL] += np.where(changed, more(rows), 0.0)
    seconds, found, _ = told(base, rows)
    assert 100.0 < seconds < 220.0
    state = fresh(base, LEARNED)
    judge_all(base, state, rows[: round((seconds + 60.0) / BLOCK)], math.inf, np.full(1, -math.inf))
    found = finding(base, state, AXIS)  # a minute later: what it is called need not be clear at once
    assert found.coordinate == coordinate
    assert found.size == pytest.approx(size, rel=0.4)
    assert found.since - LEARNED == pytest.approx(100.0, abs=40.0)
    assert found.chance < 1e-4


def test_what_is_said_names_place_size_and_unit(exact: Baseline) -> None:
    rows = blocks(120.0, seed=3, begin=LEARNED)
    rows[:, RESIDUAL] += _bump(rows)
    state = fresh(exact, LEARNED)
    judge_all(exact, state, rows, math.inf, np.zeros(1))
    found = finding(exact, state, AXIS)
    assert found.low <= 0.06
    assert found.high >= 0.04
    assert "friction" in found.sentence
    assert "rad" in found.sentence
    assert "N m" in found.sentence


def test_one_wild_block_is_no_alarm(exact: Baseline) -> None:
    rows = blocks(300.0, seed=5, begin=LEARNED)
    rows[5000, RESIDUAL] = 1e6
    assert told(exact, rows)[0] == math.inf


def test_a_motion_unlike_what_was_learned_is_not_judged(exact: Baseline) -> None:
    rows = blocks(100.0, seed=6, begin=LEARNED)
    rows[:, RESIDUAL] += 5.0
    for column, value in ((PLACE, 2.0), (SPEED, 1.0), (SLOWEST, 0.0)):
        elsewhere = rows.copy()
        elsewhere[:, column] = value
        state = fresh(exact)
        assert judge_all(exact, state, elsewhere, LIMIT, np.zeros(1)) == -1
        assert state.status[JUDGED] == 0
        assert state.status[OTHER] == len(rows)
    assert judged(rows[np.argmax(rows[:, SLOWEST])], exact.known)


def test_evidence_without_a_change_is_an_e_value() -> None:
    """The mean of exp(d z - d^2/2) over noise is at most 1, the margin and the scatter's surety making it smaller."""
    base = learned(blocks(LEARNED, seed=11), 1.0)
    rows = blocks(2000.0, seed=12, begin=LEARNED)
    state = fresh(base)
    before, gains = state.grown[0].copy(), []
    highest = np.zeros(1)
    for start in range(0, len(rows), 50):
        state.grown[:] = 20.0  # far from where evidence is held at 1
        judge_all(base, state, rows[start : start + 50], math.inf, highest)
        gains.append(np.exp(state.grown[0] - 20.0))
    mean = np.mean(gains, axis=0)
    assert before.shape == mean.shape
    assert (mean <= 1.05).all()
    assert (mean > 0.2).all(), "a test that gains nothing would never tell a change"


def test_more_looks_are_needed_for_rarer_alarms() -> None:
    assert WatchConfig(alarm_interval=1.0).limit == pytest.approx(math.log(86400.0))
    assert WatchConfig(alarm_interval=30.0).limit - WatchConfig(alarm_interval=3.0).limit == pytest.approx(math.log(10.0))


def test_evidence_of_all_is_the_mean_of_that_of_each(exact: Baseline) -> None:
    state = fresh(exact)
    assert combined(state.logs) == pytest.approx(0.0)
    state.logs[2] = 30.0
    assert combined(state.logs) == pytest.approx(30.0 - math.log(len(COORDINATES)))
    assert state.status[LOOKS] == 0
    assert tests.MARGIN >= 3.0


@pytest.mark.parametrize("rows", [blocks(10.0), blocks(100.0) * 0.0], ids=["short", "at rest"])
def test_too_little_motion_is_not_learned_from(rows: Array) -> None:
    with pytest.raises(JobError, match=r"learning period: \d+ s of motion, expected 20 s at least"):
        learned(rows, 1.0)


def test_inertia_is_learned_from_the_motion_and_not_from_noise() -> None:
    """Noise that accelerates the axis looks like a smaller inertia from block to block."""
    rows = blocks(LEARNED, seed=2)
    shaken = NOISE * np.random.default_rng(1).standard_normal(len(rows))
    rows[:, INERTIAL] -= shaken
    rows[:, RESIDUAL] += shaken
    assert abs(learned(rows, 1.0).shares[4]) < 5e-3
    assert INERTIA > VISCOUS > LEVEL
