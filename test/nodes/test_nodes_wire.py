"""The loop's messages, packed and unpacked without message objects: against ROS' own serialisation."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from tcs_friction.nodes.core.convert import SECOND, nanoseconds, set_stamp
from tcs_friction.nodes.core.wire import ESTIMATE, EVIDENCE, REFERENCE, TORQUE, JointWire, Wire

finite = st.floats(allow_nan=False, allow_infinity=False)
stamps = st.integers(0, 2**31 * SECOND - 1)
WIRES = {
    "reference": (REFERENCE, 3, ()),
    "torque": (TORQUE, 1, ()),
    "estimate": (ESTIMATE, 3, (True,)),
    "evidence": (EVIDENCE, 10, (True,)),
}


@pytest.mark.parametrize("name", WIRES)
@given(stamp=stamps, values=st.lists(finite, min_size=3, max_size=3))
def test_ros_reads_what_is_written_and_the_other_way_round(name: str, stamp: int, values: list[float]) -> None:
    wire, count, flag = WIRES[name]
    numbers = (*(4 * values)[:count], *flag)
    message = deserialize_message(wire.write(stamp, *numbers), wire.kind)
    assert nanoseconds(message.header.stamp) == stamp
    fields = [name for name in message.get_fields_and_field_types() if name != "header"]
    assert tuple(getattr(message, field) for field in fields) == numbers
    assert wire.read(serialize_message(message)) == (stamp, numbers)


@pytest.mark.parametrize("name", WIRES)
@pytest.mark.parametrize("frame", ["", "b", "base_link", "base_links"])
def test_a_frame_name_moves_the_numbers(name: str, frame: str) -> None:
    wire, count, flag = WIRES[name]
    numbers = (*(4 * (1.5, -2.5, 3.5))[:count], *flag)
    message = deserialize_message(wire.write(5, *numbers), wire.kind)
    message.header.frame_id = frame
    assert wire.read(serialize_message(message)) == (5, numbers)


def big_endian(wire: Wire, stamp: int, number: float) -> bytes:
    import struct

    assert wire is TORQUE
    return struct.pack(">4siII4xd", b"\x00\x00\x00\x00", *divmod(stamp, SECOND), 1, number)


def test_big_endian_messages_go_the_long_way() -> None:
    assert TORQUE.read(big_endian(TORQUE, 7 * SECOND + 3, 2.5)) == (7 * SECOND + 3, (2.5,))


def states(names: list[str], counts: tuple[int, int, int], frame: str = "") -> JointState:
    message = JointState(name=names)
    message.header.frame_id = frame
    set_stamp(message, 3 * SECOND + 1)
    message.position = [1.0 + i for i in range(counts[0])]
    message.velocity = [10.0 + i for i in range(counts[1])]
    message.effort = [100.0 + i for i in range(counts[2])]
    return message


@given(stamp=stamps, values=st.tuples(finite, finite, finite), joint=st.text("abcdefg_", min_size=1, max_size=12))
def test_ros_reads_joint_states_that_are_written(stamp: int, values: tuple[float, float, float], joint: str) -> None:
    wire = JointWire(joint)
    data = wire.write(stamp, *values)
    message = deserialize_message(data, JointState)
    assert list(message.name) == [joint]
    assert (message.position[0], message.velocity[0], message.effort[0]) == values
    assert wire.read(data) == (stamp, *values)
    assert wire.read(serialize_message(message)) == (stamp, *values)


@given(
    others=st.lists(st.text("xyz", min_size=1, max_size=9), max_size=4),
    place=st.integers(0, 4),
    frame=st.text("f", max_size=9),
)
def test_the_joint_is_found_among_others_each_time(others: list[str], place: int, frame: str) -> None:
    place = min(place, len(others))
    names = [*others[:place], "azimuth", *others[place:]]
    wire = JointWire("azimuth")
    data = serialize_message(states(names, (len(names),) * 3, frame))
    expected = (3 * SECOND + 1, 1.0 + place, 10.0 + place, 100.0 + place)
    assert wire.read(data) == expected
    assert wire.read(data) == expected  # by the layout remembered from the first
    moved = serialize_message(states([*names[1:], names[0]], (len(names),) * 3, frame))
    assert wire.read(moved)[1] == 1.0 + [*names[1:], names[0]].index("azimuth")


@pytest.mark.parametrize("counts", [(1, 0, 1), (1, 1, 0), (0, 0, 0)])
def test_what_a_message_lacks_is_nan(counts: tuple[int, int, int]) -> None:
    wire = JointWire("azimuth")
    wire.read(wire.write(0, 1.0, 2.0, 3.0))
    _, *values = wire.read(serialize_message(states(["azimuth"], counts)))
    assert [math.isnan(value) for value in values] == [count == 0 for count in counts]


def test_another_joint_alone_is_not_taken_and_a_nameless_one_is() -> None:
    wire = JointWire("azimuth")
    assert math.isnan(wire.read(serialize_message(states(["elevation"], (1, 1, 1))))[1])
    assert wire.read(serialize_message(states([], (1, 1, 1))))[1:] == (1.0, 10.0, 100.0)
