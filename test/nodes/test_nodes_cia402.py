"""The state machine of CiA 402: every state is told from its statusword, and every transition is the profile's."""

from __future__ import annotations

import pytest

from tcs_friction.nodes.drivers.cia402 import TRANSITIONS, Command, State, after, controlword, state_of

STATUSWORDS = {
    State.NOT_READY: "xxxx xxxx x0xx 0000",
    State.DISABLED: "xxxx xxxx x1xx 0000",
    State.READY: "xxxx xxxx x01x 0001",
    State.SWITCHED_ON: "xxxx xxxx x01x 0011",
    State.ENABLED: "xxxx xxxx x01x 0111",
    State.QUICK_STOP: "xxxx xxxx x00x 0111",
    State.REACTION: "xxxx xxxx x0xx 1111",
    State.FAULT: "xxxx xxxx x0xx 1000",
}
"""As the profile prints them."""


def matches(word: int, pattern: str) -> bool:
    bits = f"{word:016b}"
    return all(wanted in ("x", bit) for wanted, bit in zip(pattern.replace(" ", ""), bits, strict=True))


def test_every_statusword_is_in_the_state_that_the_profile_prints() -> None:
    for word in range(0x80):
        for above in (0x0000, 0x1200, 0xFF80):
            states = [state for state, pattern in STATUSWORDS.items() if matches(word | above, pattern)]
            assert state_of(word | above) is (states[0] if states else State.UNKNOWN)
            assert len(states) <= 1


PROFILE = {
    2: ("switch on disabled", 0b0110, "ready to switch on"),
    3: ("ready to switch on", 0b0111, "switched on"),
    4: ("switched on", 0b1111, "operation enabled"),
    5: ("operation enabled", 0b0111, "switched on"),
    6: ("switched on", 0b0110, "ready to switch on"),
    7: ("ready to switch on", 0b0000, "switch on disabled"),
    8: ("operation enabled", 0b0110, "ready to switch on"),
    9: ("operation enabled", 0b0000, "switch on disabled"),
    10: ("switched on", 0b0000, "switch on disabled"),
    11: ("operation enabled", 0b0010, "quick stop active"),
    12: ("quick stop active", 0b0000, "switch on disabled"),
    15: ("fault", 0b1000_0000, "switch on disabled"),
    16: ("quick stop active", 0b1111, "operation enabled"),
}


@pytest.mark.parametrize("number", TRANSITIONS)
def test_every_transition_is_that_of_the_profile(number: int) -> None:
    begin, word, end = PROFILE[number]
    assert after(State(begin), word) is State(end)


def test_nothing_else_is_a_transition() -> None:
    assert set(TRANSITIONS) == set(PROFILE)
    known = {(begin, word) for begin, words, _ in TRANSITIONS.values() for word in words}
    for state in State:
        for word in Command:
            assert (after(state, word) is not state) == ((state, word) in known), (state, word)


def walk(state: State, enabled: bool) -> list[State]:
    """The states through which a drive is led, each answer heard before the next word."""
    way, word, before = [state], 0, 0
    for _ in range(10):
        word = controlword(way[-1], enabled, before)
        way.append(after(way[-1], word, before))
        before = word
    return way


@pytest.mark.parametrize("begin", [State.DISABLED, State.READY, State.SWITCHED_ON, State.ENABLED, State.QUICK_STOP, State.FAULT])
def test_from_every_state_a_drive_is_led_to_torque(begin: State) -> None:
    way = walk(begin, True)
    assert way[-1] is State.ENABLED
    assert way.count(State.ENABLED) >= 5, "and stays there"


@pytest.mark.parametrize("begin", list(State))
def test_from_every_state_a_drive_is_led_away_from_torque(begin: State) -> None:
    way = walk(begin, False)
    assert State.ENABLED not in way[1:]
    if begin is State.ENABLED:
        assert way[1] is State.QUICK_STOP
    if begin in (State.READY, State.SWITCHED_ON):
        assert way[1] is State.DISABLED
    assert Command.FAULT_RESET not in [controlword(state, False) for state in State], "nobody asked for it"


def test_a_fault_is_reset_by_a_rising_bit_again_and_again() -> None:
    words, before = [], 0
    for _ in range(6):
        before = controlword(State.FAULT, True, before)
        words.append(before)
    assert words == [Command.FAULT_RESET, Command.DISABLE_VOLTAGE] * 3
    assert after(State.FAULT, Command.FAULT_RESET, Command.FAULT_RESET) is State.FAULT


@pytest.mark.parametrize("state", [State.NOT_READY, State.REACTION, State.UNKNOWN])
def test_a_state_that_has_to_pass_is_waited_for_without_voltage(state: State) -> None:
    assert controlword(state, True) == Command.DISABLE_VOLTAGE
