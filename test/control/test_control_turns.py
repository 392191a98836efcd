"""Angles that begin anew after a turn: which turn is meant, where a travel leaves an axis, and where it leaves a programme."""

from __future__ import annotations

import math

import numpy as np
import pytest
from encoder_cases import as_it_is, from_zero, symmetric
from hypothesis import given, settings
from hypothesis import strategies as st

from tcs_friction.control.config_field import validate
from tcs_friction.control.stamps import SECOND, FollowRule, Step
from tcs_friction.control.turns import TURN, Travel, Turns, beside
from tcs_friction.errors import InputError

CABLE = Travel(-1.5 * math.pi, 1.5 * math.pi)
"""One and a half turns: between half a turn and a turn an angle has two places."""


ENCODERS = (from_zero, symmetric, as_it_is)


@settings(max_examples=50, deadline=None)
@given(position=st.floats(-1e4, 1e4), expected=st.floats(-1e4, 1e4))
def test_an_angle_is_put_into_the_nearest_turn(position: float, expected: float) -> None:
    found = beside(position, expected)
    assert abs(found - expected) <= 0.5 * TURN * (1.0 + 1e-9)
    assert math.cos(found - position) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("position", [math.nan, math.inf, 1e300])
def test_what_is_no_angle_stays_as_it_is(position: float) -> None:
    assert beside(position, 1.0) == position or math.isnan(position)
    assert beside(1.0, position) == 1.0


@settings(max_examples=30, deadline=None)
@given(
    encoder=st.sampled_from(ENCODERS), start=st.floats(-4.0, 4.0), speed=st.floats(0.1, 2.0), turns=st.floats(1.0, 3.0)
)
def test_a_driver_follows_an_axis_over_north_both_ways(
    encoder: type[float], start: float, speed: float, turns: float
) -> None:
    times = np.arange(0.0, TURN * turns / speed, 0.05)
    way = start + speed * np.minimum(times, times[-1] - times)
    speeds = np.gradient(way, times)
    follower = Turns()
    follower.configure(Travel(), 4.0, near=start)
    found = [follower.follow(t, encoder(q), v) for t, q, v in zip(times, way, speeds, strict=True)]
    assert np.allclose(found, way, atol=1e-9)
    assert not follower.unknown


@pytest.mark.parametrize(
    ("angle", "near", "found", "unknown"),
    [
        (0.5, None, 0.5, ""),
        (6.0, None, 6.0 - TURN, ""),
        (4.0, None, 4.0, "at the start the axis may be at -2.283 or 4 rad, within its travel: set start_near"),
        (4.0, -2.0, 4.0 - TURN, ""),
        (4.0, 4.5, 4.0, ""),
    ],
)
def test_where_an_axis_begins_the_travel_tells_the_turn_or_somebody_has_to(
    angle: float, near: float | None, found: float, unknown: str
) -> None:
    follower = Turns()
    follower.configure(CABLE, 1.0, near)
    assert follower.follow(0.0, angle, 0.0) == pytest.approx(found)
    assert follower.unknown[: len(unknown) or None] == unknown


def test_beyond_a_travel_of_less_than_a_turn_the_turn_is_not_known() -> None:
    follower = Turns()
    follower.configure(Travel(-2.0, 2.0), 1.0)
    follower.follow(0.0, 3.3, 0.0)
    assert follower.unknown.startswith("at the start the axis may be at -2.983 or 3.3 rad, beyond its travel")
    follower.configure(Travel(-2.0, 2.0), 1.0, near=3.0)
    assert follower.follow(0.1, 3.3, 0.0) == 3.3
    assert not follower.unknown


def test_after_a_silence_in_which_it_may_have_turned_the_turn_is_not_known_until_somebody_says_it() -> None:
    follower = Turns()
    follower.configure(CABLE, 1.0, near=4.0)
    assert follower.follow(0.0, 4.0, 0.0) == 4.0
    assert follower.follow(3.0, 4.1, 0.0) == 4.1  # 3 rad at most, less than half a turn
    assert not follower.unknown
    follower.follow(6.2, 4.2, 0.0)
    assert follower.unknown.startswith("after 3.2 s without a position the axis may be at")
    follower.configure(CABLE, 1.0, near=4.0)  # what was said before the silence says nothing about now
    follower.follow(6.3, 4.2, 0.0)
    assert follower.unknown
    follower.configure(CABLE, 1.0, near=-2.0)
    assert follower.follow(6.4, 4.2, 0.0) == pytest.approx(4.2 - TURN)
    assert not follower.unknown


def test_a_silence_costs_nothing_where_the_travel_tells_the_turn_or_there_is_none() -> None:
    for travel in (Travel(0.0, 6.0), Travel()):
        follower = Turns()
        follower.configure(travel, 1.0)
        assert follower.follow(0.0, 1.0, 0.0) == 1.0
        assert follower.follow(60.0, 5.9, 0.0) == (5.9 if travel.bounded else 5.9 - TURN)
        assert not follower.unknown


def test_a_travel_that_becomes_known_later_places_the_axis_anew() -> None:
    follower = Turns()
    follower.configure(Travel(), 1.0)
    assert follower.follow(0.0, 6.0, 0.0) == 6.0
    follower.configure(CABLE, 1.0)
    assert follower.follow(0.1, 6.0, 0.0) == pytest.approx(6.0 - TURN)


@pytest.mark.parametrize(
    ("low", "high", "here", "turns"),
    [
        (0.0, 1.0, 0.2, 0),
        (0.0, 1.0, 6.5, 0),  # in the next turn the travel ends
        (5.5, 6.5, -0.5, -1),
        (3.0, 4.0, -3.0, -1),  # the way round through north
        (3.0, 4.0, 3.0, 0),
    ],
)
def test_a_programme_is_put_into_the_nearest_turn_that_the_cables_allow(
    low: float, high: float, here: float, turns: int
) -> None:
    assert CABLE.shift(low, high, low, here, True) == TURN * turns


def test_without_a_travel_a_programme_begins_in_the_turn_of_the_axis() -> None:
    assert Travel().shift(0.0, 0.5, 0.0, 100.0, True) == TURN * 16
    assert Travel().shift(0.0, 0.5, 0.0, 100.0, False) == 0.0


@pytest.mark.parametrize("continuous", [True, False])
def test_a_programme_that_leaves_the_travel_is_refused(continuous: bool) -> None:
    with pytest.raises(InputError, match=r"programme from -4 to 5\.5 rad, expected within the travel, -4\.712 to 4\.712 rad"):
        CABLE.shift(-4.0, 5.5, -4.0, 0.0, continuous)
    if not continuous:
        with pytest.raises(InputError, match="within the travel"):
            CABLE.shift(5.5, 6.5, 5.5, 0.0, continuous)


def test_a_travel_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(InputError, match="travel_from is 1, expected at most travel_to"):
        validate(Travel(1.0, 0.0), "axis")


def rule(lock_step: bool, acceleration: float = 1.0) -> FollowRule:
    made = FollowRule(lock_step)
    made.configure(slack=10.0, reach=10.0, period=0.01, acceleration=acceleration, noise=1e-6, continuous=True)
    return made


@pytest.mark.parametrize("encoder", ENCODERS)
@pytest.mark.parametrize("reports", [True, False])
@pytest.mark.parametrize("lock_step", [True, False])
def test_angles_that_begin_anew_follow_each_other(encoder: type[float], reports: bool, lock_step: bool) -> None:
    judged = rule(lock_step)
    speed = 0.5 if reports else math.nan
    steps = [
        judged.judge((k + 1) * SECOND // 100, encoder(6.0 + 0.005 * k), 0.01 * k, speed) for k in range(1500)
    ]
    begun = 1 if lock_step else steps.index(Step.NEW_RUN) + 1
    assert begun < 60
    assert set(steps[begun:]) == {Step.NEXT}


@pytest.mark.parametrize("lock_step", [True, False])
@pytest.mark.parametrize(
    ("span", "speed", "step", "known"),
    [
        (0.5, 6.0, 3.0, True),  # nearly half a turn, and the speed tells it
        (0.5, 9.0, 4.5, True),
        (3.0, 0.0, 1.0, False),  # it could have turned meanwhile
        (0.5, math.nan, 3.0, False),  # no speed: half a turn either way
        (0.1, math.nan, 0.005, True),
    ],
)
def test_a_step_over_which_the_turn_is_not_known_is_refused(
    lock_step: bool, span: float, speed: float, step: float, known: bool
) -> None:
    judged = rule(lock_step)
    slow = 0.0 if math.isnan(speed) else speed
    for k in range(100):
        judged.judge(SECOND + k * SECOND // 100, from_zero(slow * 0.01 * k), 0.01 * k, speed)
    now = 0.99 + span
    found = judged.judge(round((1.0 + now) * SECOND), from_zero(slow * 0.99 + step), now, speed)
    assert (found is Step.NEXT) == known, judged.reason
    if not known:
        derived = math.isnan(speed) and not lock_step  # from the positions before, which tell that it rested
        assert judged.reason.endswith("can be" if derived else "which turn is not known")
        assert f"within {span:.3g} s" in judged.reason
