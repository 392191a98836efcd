"""The torque gate: every reason for no torque, how fast it goes and comes, and that no sequence of events gets past a limit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tcs_friction.control.config_field import validate
from tcs_friction.control.torque_gate import Situation, TorqueGate, TorqueLimits
from tcs_friction.errors import InputError

PERIOD, RAMP = 0.01, 0.5
LIMITS = TorqueLimits(-1.0, 2.0, 10.0, 1.0, 0.5, 0.1, 0.05, 0.05)
STILL = Situation(0.0, 0.0, 0.0, 0.0)


def still(now: float, **changes: object) -> Situation:
    """A healthy axis at rest, with a fresh position."""
    return STILL._replace(now=now, measured=now)._replace(**changes)  # type: ignore[arg-type]


def opened(torque: float = 8.0) -> TorqueGate:
    """A gate through which a command of time 0 acts whole."""
    gate = TorqueGate(LIMITS, RAMP)
    gate.command(torque, 0.0)
    for _ in range(51):
        verdict = gate.at(still(0.0), PERIOD)
    assert verdict [:3] == (torque, "", "")
    return gate


def test_torque_comes_over_the_ramp_time() -> None:
    gate = TorqueGate(LIMITS, RAMP)
    gate.command(8.0, 0.0)
    torques = [gate.at(still(0.0), PERIOD).torque for _ in range(60)]
    assert torques[0] == pytest.approx(8.0 * PERIOD / RAMP)
    assert torques[24] == pytest.approx(4.0)
    assert torques[50:] == [8.0] * 10


@pytest.mark.parametrize(
    ("situation", "words"),
    [
        (still(0.0, doubt="two publishers of torque_command"), "two publishers of torque_command"),
        (still(0.06, measured=0.0), "no position for 0.05 s"),
        (still(0.0, measured=math.nan), "no position for 0.05 s"),
        (still(0.0, position=2.6), "position 2.6 rad is more than 0.5 rad beyond the travel"),
        (still(0.0, position=-1.6), "position -1.6 rad is more than 0.5 rad beyond the travel"),
        (still(0.0, position=math.nan), "position nan rad is more than 0.5 rad beyond the travel"),
        (still(0.11), "no torque_command for 0.1 s"),
    ],
)
@pytest.mark.parametrize("torque", [8.0, -8.0])
def test_every_doubt_takes_the_torque_away_within_the_stop_time(situation: Situation, words: str, torque: float) -> None:
    gate = opened(torque)
    verdicts = [gate.at(situation, PERIOD) for _ in range(6)]
    assert {verdict.doubt for verdict in verdicts} == {words}
    sizes = [abs(verdict.torque) for verdict in verdicts]
    assert sizes[-2] < 1e-12
    assert sizes[-1] == 0.0
    assert all(after <= before for before, after in zip([8.0, *sizes], sizes, strict=False))
    gate.command(torque, 1.0)
    assert abs(gate.at(still(1.0), PERIOD).torque) == pytest.approx(8.0 * PERIOD / RAMP), "it comes back as slowly as ever"


def test_a_doubt_that_may_be_dangerous_can_cut_at_once() -> None:
    gate = opened()
    gate.configure(replace(LIMITS, stop_time=0.0), RAMP)
    assert gate.at(still(0.2), PERIOD).torque == 0.0


def test_a_deactivated_axis_lets_go_over_the_ramp_time() -> None:
    gate = opened()
    torques = [gate.at(still(0.0, active=False), PERIOD).torque for _ in range(51)]
    assert torques[24] == pytest.approx(4.0)
    assert torques[50] == 0.0
    assert gate.at(still(0.0, active=False), PERIOD)[:3] == (0.0, "not active", "")


def test_the_ramp_waits_for_a_drive_that_is_not_ready() -> None:
    gate = TorqueGate(LIMITS, RAMP)
    gate.command(8.0, 0.0)
    for _ in range(100):
        assert gate.at(still(0.0, ready=False), PERIOD)[:3] == (0.0, "", "")
    assert gate.at(still(0.0), PERIOD).torque == pytest.approx(8.0 * PERIOD / RAMP)


@pytest.mark.parametrize(
    ("changes", "torque", "words"),
    [
        ({"speed": 1.1}, 8.0, "faster than 1 rad/s: no torque that way"),
        ({"speed": -1.1}, -8.0, "faster than 1 rad/s: no torque that way"),
        ({"speed": math.nan}, 8.0, "faster than 1 rad/s: no torque that way"),
        ({"speed": math.nan}, -8.0, "faster than 1 rad/s: no torque that way"),
        ({"position": 2.1}, 8.0, "beyond the travel to 2 rad: no torque that way"),
        ({"position": -1.1}, -8.0, "beyond the travel to -1 rad: no torque that way"),
    ],
)
def test_no_torque_farther_out_or_faster_and_all_of_it_back(changes: dict[str, float], torque: float, words: str) -> None:
    gate = opened(torque)
    assert gate.at(still(0.0, **changes), PERIOD) == (0.0, "", words, True)
    if not math.isnan(changes.get("speed", 0.0)):
        gate.command(-torque, 0.0)
        assert gate.at(still(0.0, **changes), PERIOD) == (-torque, "", "", True)
        gate.command(torque, 0.0)
    assert abs(gate.at(still(0.0), PERIOD).torque) == pytest.approx(8.0 * PERIOD / RAMP), "it comes back slowly"


@pytest.mark.parametrize("torque", [10.1, -10.1, math.inf, -math.inf, math.nan])
def test_a_command_beyond_the_limit_is_refused(torque: float) -> None:
    gate = TorqueGate(LIMITS, RAMP)
    assert gate.objection(torque) == f"{torque:g} N m was refused, the limit is 10"
    assert not gate.objection(math.copysign(10.0, torque))


def test_a_limit_that_is_lowered_holds_for_the_command_that_acts() -> None:
    gate = opened(8.0)
    gate.configure(replace(LIMITS, torque_limit=3.0), RAMP)
    assert gate.at(still(0.0), PERIOD).torque == 3.0


def test_a_command_from_before_does_not_act_after_forget_and_restart() -> None:
    gate = opened()
    gate.forget()
    assert gate.at(still(0.0), PERIOD).doubt == "no torque_command for 0.1 s"
    gate = opened()
    gate.restart()
    assert gate.share == 0.0
    assert gate.at(still(0.0), PERIOD)[:3] == (0.0, "no torque_command for 0.1 s", "")


def test_a_travel_without_room_is_refused() -> None:
    with pytest.raises(InputError, match=r"travel_from is 1, expected at most travel_to \(0\)"):
        validate(TorqueLimits(travel_from=1.0, travel_to=0.0), "driver")


numbers = st.floats(-20.0, 20.0) | st.just(math.nan)
events = st.lists(
    st.tuples(numbers, numbers, st.sampled_from([0.0, 0.04, 0.2]), st.booleans(), st.booleans(), st.sampled_from(["", "fault"])),
    max_size=60,
)


@settings(max_examples=60, deadline=None)
@given(events, st.floats(-10.0, 10.0))
def test_no_sequence_of_events_gets_past_a_limit(sequence: list[tuple[Any, ...]], torque: float) -> None:
    """Within the limit, never outward, never faster, and from one period to the next never up by more than the ramp allows."""
    gate, before = TorqueGate(LIMITS, RAMP), 0.0
    gate.command(torque, 0.0)
    now = 0.0
    for position, speed, age, active, ready, doubt in sequence:
        now += PERIOD
        applied = gate.at(Situation(now, position, speed, now - age, active, doubt, ready), PERIOD).torque
        assert abs(applied) <= abs(torque)
        assert abs(applied) <= before + abs(torque) * PERIOD / RAMP + 1e-12
        if applied:
            assert not (position > 2.0 and applied > 0.0)
            assert not (position < -1.0 and applied < 0.0)
            assert math.copysign(1.0, applied) * speed <= 1.0
        before = abs(applied)
