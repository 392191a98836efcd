"""Between ROS messages and numbers. Stamps are whole nanoseconds, so that equal stamps compare equal."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from builtin_interfaces.msg import Time
from tcs_friction_msgs.msg import LugreDirection, LugreParameters

from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.compensator import LugreParameters as Direction
from tcs_friction.control.stamps import SECOND

__all__ = ["SECOND", "direction", "fill_direction", "lugre_message", "nanoseconds", "set_stamp"]

NAMES = {"static": "static_friction"}
"""Parameters whose name in the axis file is no legal field name, and the field's name."""


def nanoseconds(stamp: Time) -> int:
    """A stamp as one number."""
    return int(stamp.sec * SECOND + stamp.nanosec)


def set_stamp(message: Any, stamp: int) -> None:
    """Write a stamp (ns) into a message's header."""
    time = message.header.stamp
    time.sec, time.nanosec = divmod(stamp, SECOND)


def lugre_message(config: CompensatorConfig, stamp: int, source: str) -> LugreParameters:
    """Both directions' parameters; standard deviations unknown."""
    message = LugreParameters(source=source)
    set_stamp(message, stamp)
    for target, values in ((message.positive, config.positive), (message.negative, config.negative)):
        fill_direction(target, values.__dict__, {})
    return message


def fill_direction(target: LugreDirection, values: dict[str, float], deviations: dict[str, float | None]) -> None:
    """Write one direction's six parameters and, where they are known, their standard deviations."""
    nan = float("nan")
    for name in Direction.__dataclass_fields__:
        setattr(target, NAMES.get(name, name), float(values[name]))
    known = [deviations.get(name) for name in Direction.__dataclass_fields__]
    target.standard_deviation = [nan if value is None else float(value) for value in known]
    target.determined = [not (name in deviations and deviations[name] is None) for name in Direction.__dataclass_fields__]


def direction(message: LugreDirection) -> Direction:
    """One direction's parameters from a message."""
    return Direction(**{name: getattr(message, NAMES.get(name, name)) for name in Direction.__dataclass_fields__})


def friction_of(message: LugreParameters) -> dict[str, float]:
    """Both directions' parameters by the names that the compensator's node gives them."""
    return {
        f"{side}.{name}": value
        for side in ("positive", "negative")
        for name, value in asdict(direction(getattr(message, side))).items()
    }
