"""The state machine of CiA 402 (IEC 61800-7-201): what a statusword says and which controlword leads on. Pure functions.

                                      not ready to switch on
                                                | 1
           +----------------------->  switch on disabled  <------ 15 ------ fault
           |     7, 10, 9, 12                 2 |                             ^ 14
           |                          ready to switch on             fault reaction active
    quick stop active                         3 | ^ 6                         ^ 13, from any state
           ^                             switched on
           | 11                               4 | ^ 5
           +--------------------------  operation enabled

A drive has torque in `operation enabled` only, and for braking in `quick stop active` and `fault reaction active`.
"""

from __future__ import annotations

from enum import Enum, IntEnum

CYCLIC_SYNCHRONOUS_TORQUE = 10
"""Mode of operation, objects 0x6060 and 0x6061; bit 9 of the supported modes, 0x6502."""


class State(Enum):
    """States of a drive, in the profile's words. UNKNOWN is a statusword that no state has."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


class Command(IntEnum):
    """Controlwords. FAULT_RESET acts when bit 7 rises, so another word has to be between two of them."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE = 0x0F
    FAULT_RESET = 0x80


_STATUS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.ENABLED),
    (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.REACTION),
    (0x4F, 0x08, State.FAULT),
)
"""Mask, value, state: bits 0 to 3 and 6 of the statusword, and bit 5 where it tells states apart."""

_FORWARD = {
    State.DISABLED: Command.SHUTDOWN,  # 2
    State.READY: Command.SWITCH_ON,  # 3
    State.SWITCHED_ON: Command.ENABLE,  # 4
    State.ENABLED: Command.ENABLE,
    State.FAULT: Command.FAULT_RESET,  # 15
}
TRANSITIONS: dict[int, tuple[State, tuple[Command, ...], State]] = {
    2: (State.DISABLED, (Command.SHUTDOWN,), State.READY),
    3: (State.READY, (Command.SWITCH_ON, Command.ENABLE), State.SWITCHED_ON),
    4: (State.SWITCHED_ON, (Command.ENABLE,), State.ENABLED),
    5: (State.ENABLED, (Command.SWITCH_ON,), State.SWITCHED_ON),
    6: (State.SWITCHED_ON, (Command.SHUTDOWN,), State.READY),
    7: (State.READY, (Command.DISABLE_VOLTAGE, Command.QUICK_STOP), State.DISABLED),
    8: (State.ENABLED, (Command.SHUTDOWN,), State.READY),
    9: (State.ENABLED, (Command.DISABLE_VOLTAGE,), State.DISABLED),
    10: (State.SWITCHED_ON, (Command.DISABLE_VOLTAGE, Command.QUICK_STOP), State.DISABLED),
    11: (State.ENABLED, (Command.QUICK_STOP,), State.QUICK_STOP),
    12: (State.QUICK_STOP, (Command.DISABLE_VOLTAGE,), State.DISABLED),
    15: (State.FAULT, (Command.FAULT_RESET,), State.DISABLED),
    16: (State.QUICK_STOP, (Command.ENABLE,), State.ENABLED),
}
"""Transitions that a controlword causes, by the profile's numbers. 0, 1, 13 and 14 are the drive's own, 12 may be as well."""


def state_of(statusword: int) -> State:
    """The state that a statusword (object 0x6041) says."""
    for mask, value, state in _STATUS:
        if statusword & mask == value:
            return state
    return State.UNKNOWN


def controlword(state: State, enabled: bool, before: int = 0) -> Command:
    """The controlword (object 0x6040) that leads on from a state: to `operation enabled`, or to a stop and no voltage.

    before: the controlword that was sent last. A fault is reset on the way to `operation enabled` only.
    """
    if not enabled:
        return Command.QUICK_STOP
    word = _FORWARD.get(state, Command.DISABLE_VOLTAGE)
    return Command.DISABLE_VOLTAGE if word == before == Command.FAULT_RESET else word


def after(state: State, word: int, before: int = 0) -> State:
    """The state in which a drive is after a controlword, as the profile says; the same where it changes nothing."""
    if word & Command.FAULT_RESET:
        word = Command.FAULT_RESET if not before & Command.FAULT_RESET else Command.DISABLE_VOLTAGE
    for begin, words, end in TRANSITIONS.values():
        if state is begin and word in words:
            return end
    return state
