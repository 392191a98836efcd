"""What may follow what: stamps and positions of states, stamps of answers, and inputs that come and go."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tcs_friction.control.fading import FadingInput, Ramp
from tcs_friction.control.stamps import SECOND, STAMP_END, AnswerRule, FollowRule, RecentStates, Step

TICK = 1_000_000  # ns
START = 1_700_000_000 * SECOND


class Driver:
    """Feeds a real-time rule with states every millisecond of steady time."""

    def __init__(self) -> None:
        self.rule = FollowRule(lock_step=False)
        self.rule.configure(slack=0.1, patience=0.5, reach=1.0, period=1e-3)
        self.now = 100.0

    def run(self, ticks: int, stamp: int, position: float = 0.0, speed: float = 0.0) -> list[Step]:
        """`ticks` states from a stamp and position on."""
        steps = []
        for k in range(ticks):
            self.now += 1e-3
            steps.append(self.rule.judge(stamp + k * TICK, position + k * 1e-3 * speed, self.now, speed))
        return steps

    def started(self) -> Driver:
        assert self.run(1000, START)[-1] is Step.NEXT
        return self


def test_lock_step_repeats_and_starts_anew() -> None:
    rule = FollowRule(lock_step=True)
    assert [rule.judge(stamp) for stamp in (0, 0, 5, 9, 9, 2, 3)] == [
        Step.NEXT,
        Step.REPEATED,
        Step.NEXT,
        Step.NEXT,
        Step.REPEATED,
        Step.NEW_RUN,
        Step.NEXT,
    ]


@pytest.mark.parametrize("lock_step", [True, False])
@pytest.mark.parametrize("stamp", [-1, STAMP_END, 2**40 * SECOND])
def test_a_stamp_that_no_message_can_hold_is_refused(lock_step: bool, stamp: int) -> None:
    rule = FollowRule(lock_step)
    assert rule.judge(stamp, 0.0, 1.0) is Step.REFUSED
    assert "is no time" in rule.reason
    assert rule.last == -1


def test_the_first_states_are_made_sure_of() -> None:
    steps = Driver().run(1000, START)
    assert steps.count(Step.NEW_RUN) == 1
    assert 490 <= steps.index(Step.NEW_RUN) <= 510
    assert set(steps[: steps.index(Step.NEW_RUN)]) == {Step.REFUSED}


@pytest.mark.parametrize("stray", [0, 1, START, START + 900 * TICK, START + 3600 * SECOND, 2**31 * SECOND - 1])
def test_one_stray_stamp_restarts_nothing(stray: int) -> None:
    driver = Driver().started()
    assert driver.rule.judge(stray, 0.0, driver.now) is Step.REFUSED
    assert driver.rule.reason
    assert set(driver.run(1000, START + 1000 * TICK)) == {Step.NEXT}


def distorted(random: np.random.Generator, count: int, doubled: float, swapped: float, stray: float) -> list[int]:
    """Numbers of ticks: some come twice, some change places, and some are of half a minute ago."""
    ticks = [k for k in range(count) for _ in range(2 if random.random() < doubled else 1)]
    for k in range(1, count):
        if random.random() < swapped:
            ticks[k - 1], ticks[k] = ticks[k], ticks[k - 1]
    return [k if random.random() >= stray else k - 30_000 for k in ticks]


@pytest.mark.parametrize("faults", [(0.05, 0.0, 0.0), (0.0, 0.05, 0.0), (0.0, 0.0, 0.05), (0.2, 0.2, 0.1)])
@pytest.mark.parametrize("jump", [0, 3600 * SECOND])
def test_messages_that_come_twice_late_or_astray_keep_nobody_deaf(faults: tuple[float, float, float], jump: int) -> None:
    """At the start and after a jump of the clock: believed as soon as without them, and only what follows is."""
    driver = Driver().started() if jump else Driver()
    before = driver.rule.last
    steps, stamps = [], []
    for number, k in enumerate(distorted(np.random.default_rng(3), 1000, *faults)):
        steps.append(driver.rule.judge(START + 2 * SECOND + jump + k * TICK, 0.0, driver.now + 1e-3 * number, 0.0))
        stamps.append(driver.rule.last)
    believed = steps.index(Step.NEW_RUN)
    assert believed < 800
    after = stamps[believed:]
    assert set(stamps[:believed]) == {before}
    assert all(a <= b for a, b in itertools.pairwise(after)), "never back"
    assert steps[believed:].count(Step.NEXT) > (1000 - 520) * 0.6


def test_a_stray_from_the_future_is_given_up_for_what_comes_after_it() -> None:
    driver = Driver()
    assert driver.rule.judge(START + 3600 * SECOND, 0.0, driver.now, 0.0) is Step.REFUSED
    steps = driver.run(1500, START)
    assert 990 <= steps.index(Step.NEW_RUN) <= 1010, "the patience with the stray, and with these"


def test_a_second_clock_beside_the_first_is_never_believed() -> None:
    driver = Driver().started()
    for k in range(1000, 4000):
        assert driver.run(1, START + k * TICK) == [Step.NEXT]
        assert driver.rule.judge(START + (k - 20) * TICK, 0.0, driver.now) is Step.REFUSED


@pytest.mark.parametrize("shift", [-3600 * SECOND, 3600 * SECOND])
def test_a_clock_that_was_set_is_believed_after_a_while(shift: int) -> None:
    driver = Driver().started()
    steps = driver.run(1000, START + 1000 * TICK + shift)
    believed = steps.index(Step.NEW_RUN)
    assert 490 <= believed <= 510
    assert set(steps[:believed]) == {Step.REFUSED}
    assert set(steps[believed + 1 :]) == {Step.NEXT}


def test_a_clock_that_was_set_back_a_little_is_waited_for() -> None:
    steps = Driver().started().run(100, START + 980 * TICK)
    assert steps == [Step.REFUSED] * 19 + [Step.REPEATED] + [Step.NEXT] * 80


def test_a_pause_is_no_jump() -> None:
    driver = Driver().started()
    driver.now += 3.0
    assert driver.run(1, START + 4000 * TICK) == [Step.NEXT]


def test_a_step_that_no_axis_makes_is_refused_until_it_stays() -> None:
    driver = Driver().started()
    assert driver.run(1, START + 1000 * TICK, position=0.5) == [Step.REFUSED]
    assert "step of 0.5" in driver.rule.reason
    assert driver.run(1, START + 1001 * TICK, position=0.0) == [Step.NEXT]
    assert driver.run(100, START + 1002 * TICK, speed=0.9)[-1] is Step.NEXT
    steps = driver.run(1000, START + 1102 * TICK, position=7.0)
    assert steps.count(Step.NEW_RUN) == 1


def test_a_step_is_bounded_by_the_reported_speed_and_the_acceleration() -> None:
    """3 mrad in a millisecond is below the largest speed, but not of an axis that says it moves at 10 mrad/s."""
    for speed, step, wanted in ((0.01, 3e-3, Step.REFUSED), (0.01, 2.5e-5, Step.NEXT), (0.9, 1.5e-3, Step.NEXT)):
        driver = Driver()
        driver.rule.configure(slack=0.1, patience=0.5, reach=1.0, period=1e-3, acceleration=2.0, noise=1e-6)
        assert driver.run(1000, START, speed=speed)[-1] is Step.NEXT
        assert driver.run(1, START + 1000 * TICK, position=999e-3 * speed + step, speed=speed) == [wanted]


def test_a_driver_without_speeds_is_bounded_by_the_speed_that_it_had() -> None:
    driver = Driver()
    driver.rule.configure(slack=0.1, patience=0.5, reach=1.0, period=1e-3, acceleration=2.0, noise=1e-6)
    for k in range(1000):
        driver.now += 1e-3
        step = driver.rule.judge(START + k * TICK, 1e-5 * k, driver.now)
    assert step is Step.NEXT
    assert driver.rule.judge(START + 1000 * TICK, 1e-2 + 1e-3, driver.now + 1e-3) is Step.REFUSED
    assert driver.rule.judge(START + 1000 * TICK, 1e-2, driver.now + 1e-3) is Step.NEXT


def states(*stamps: int) -> RecentStates:
    made = RecentStates(0.1)
    for stamp in stamps:
        made.add(stamp)
    return made


def test_states_are_recent_for_a_while_and_until_a_new_run() -> None:
    recent = states(START, START + 50 * TICK, START + 150 * TICK)
    assert [START + k * TICK in recent for k in (0, 50, 100, 150)] == [False, True, False, True]
    recent.add(START + 150 * TICK)
    recent.add(START)
    assert [START + k * TICK in recent for k in (0, 50, 150)] == [True, False, False]
    assert recent.newest == START


def test_an_answer_is_about_a_recent_state() -> None:
    rule = AnswerRule(states(START - TICK, START))
    assert rule.objection(START, (1.0,), 1.0) == ""
    assert rule.objection(START, (1.0,), 1.0) == ""
    assert "older than the newest state" in rule.objection(0, (500.0,), 2.0)
    assert "newer than the newest state" in rule.objection(START + SECOND, (500.0,), 2.0)
    assert "older than the one before" in rule.objection(START - TICK, (1.0,), 2.0)
    rule = AnswerRule(states(START))
    assert rule.objection(START + TICK, (2.0,), 3.0) == "stamp 0.001 s newer than the newest state, and of none of the last 0.1 s"
    assert rule.contradicted == -math.inf, "one may be late"


def test_answers_to_no_state_contradict_when_there_are_more_of_them() -> None:
    recent = states(START)
    rule = AnswerRule(recent)
    for k in range(10):
        recent.add(START + 10 * k * TICK)
        assert rule.objection(START + 10 * k * TICK, (1.0,), 0.01 * k) == ""
        assert rule.objection(START + (10 * k + 2) * TICK, (500.0,), 0.01 * k)
        assert (rule.contradicted > 0.0) == (k >= 2)
    rare = AnswerRule(recent)
    for k in range(10):
        assert rare.objection(0, (500.0,), 0.06 * k)
    assert rare.contradicted == -math.inf


def test_an_answer_that_overtakes_its_state_waits_for_it() -> None:
    recent = states(START)
    rule = AnswerRule(recent)
    assert not rule.wait(START, b"known")
    assert not rule.wait(START + SECOND, b"far")
    assert rule.wait(START + 10 * TICK, b"early")
    assert rule.wait(START + 12 * TICK, b"strange")
    assert rule.due() == []
    recent.add(START + 10 * TICK)
    assert rule.due() == [b"early"]
    recent.add(START + 20 * TICK)
    assert rule.due() == [b"strange"], "to be judged, and refused"
    assert [rule.wait(START + (30 + k) * TICK, b"") for k in range(11)] == [True] * 10 + [False]
    recent.add(START - SECOND)
    assert len(rule.due()) == 10, "a new run"


def test_two_answers_to_one_state_contradict_each_other() -> None:
    recent = states(START)
    rule = AnswerRule(recent)
    assert rule.objection(START, (1.0,), 1.0) == ""
    assert rule.contradicted == -math.inf
    assert "contradicts" in rule.objection(START, (2.0,), 7.0)
    assert rule.contradicted == 7.0
    recent.add(START - SECOND)
    assert rule.objection(START - SECOND, (1.0,), 8.0) == "", "a new run"


def test_a_ramp_takes_its_time() -> None:
    ramp = Ramp(0.5)
    up = [ramp.toward(True, 0.1) for _ in range(7)]
    assert up == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0])
    assert [ramp.toward(False, 0.25) for _ in range(3)] == pytest.approx([0.5, 0.0, 0.0])
    assert Ramp(0.0).toward(True, 1e-3) == 1.0


def test_an_input_that_stops_fades_out_and_comes_back_slowly() -> None:
    faded = FadingInput(age_limit=0.1, fade_time=0.5)
    used = []
    for k in range(3000):
        stamp = START + k * TICK
        if not 1000 <= k < 2000:
            faded.put(80.0, stamp)
        used.append(faded.at(stamp))
    steps = [abs(b - a) for a, b in itertools.pairwise(used)]
    assert max(steps) <= 80.0 / 500.0 * 1.001
    assert used[999] == 80.0
    assert used[1090] == 80.0
    assert used[1700] == 0.0
    assert used[-1] == 80.0


def test_what_is_switched_off_fades_and_comes_back_slowly() -> None:
    faded = FadingInput(age_limit=0.1, fade_time=0.5)

    def after(begin: float, wanted: bool) -> float:
        """What is used a quarter of a second later, asked every 10 ms."""
        for tick in range(25):
            stamp = round((begin + 0.01 * tick) * 1e9)
            faded.put(200.0, stamp)
            used = faded.at(stamp, wanted)
        return used

    assert after(0.0, True) == pytest.approx(96.0)
    assert after(0.25, True) == pytest.approx(196.0)
    assert after(0.5, False) == pytest.approx(96.0)
    assert after(0.75, False) == 0.0
    assert after(1.0, True) == pytest.approx(100.0)
