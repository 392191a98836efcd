"""The loop's messages between bytes and numbers, without message objects.

Making a message object of every message received costs more than everything else in a tick, the axis included. The messages
of the loop have fixed layouts in CDR, the encoding of ROS 2 on the wire, so they are packed and unpacked here; a
message laid out otherwise (a frame name, big-endian) goes the long way, with the same result. One that cannot be read at all has
the stamp UNREADABLE, which no rule accepts, and numbers that are NaN.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisEvidence, AxisReference, AxisTorque, FrictionEstimate

from tcs_friction.nodes.core.convert import SECOND, nanoseconds

Numbers = tuple[float, ...]

UNREADABLE = -1
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # CDR encapsulation header
_NO_FRAME = 1  # length of an empty string with its terminator


class Wire:
    """A message of a header, numbers, and perhaps a truth value at the end. Stamps are in ns."""

    def __init__(self, kind: Any, numbers: tuple[str, ...], flag: str = "") -> None:
        self.kind = kind
        self._numbers = numbers
        self._names = (*numbers, flag) if flag else numbers
        self._layout = struct.Struct(f"<4siII4x{len(numbers)}d{'?' if flag else ''}")

    def read(self, data: bytes) -> tuple[int, Numbers]:
        """Stamp and numbers of a serialised message."""
        if len(data) >= self._layout.size:
            order, seconds, rest, frame, *numbers = self._layout.unpack_from(data)
            if order == _LITTLE_ENDIAN and frame == _NO_FRAME:
                return seconds * SECOND + rest, tuple(numbers)
        message = message_of(data, self.kind)
        if message is None:
            return UNREADABLE, (math.nan,) * len(self._numbers) + (False,) * (len(self._names) - len(self._numbers))
        return nanoseconds(message.header.stamp), tuple(getattr(message, name) for name in self._names)

    def write(self, stamp: int, *numbers: float) -> bytes:
        """A serialised message with an empty frame name."""
        return self._layout.pack(_LITTLE_ENDIAN, *divmod(stamp, SECOND), _NO_FRAME, *numbers)


REFERENCE = Wire(AxisReference, ("position", "velocity", "acceleration"))
TORQUE = Wire(AxisTorque, ("torque",))
EVIDENCE = Wire(
    AxisEvidence,
    (
        "residual",
        "unexplained",
        "evidence",
        "time",
        "direction",
        "speed",
        "position",
        "order",
        "frequency",
        "learned",
    ),
    "changed",
)
ESTIMATE = Wire(FrictionEstimate, ("torque", "velocity", "residual"), "valid")


class JointWire:
    """JointState for one joint. What a message lacks is NaN; a single joint without a name is taken.

    others: joints that are written beside it.
    """

    def __init__(self, joint: str, others: Sequence[str] = ()) -> None:
        self.kind = JointState
        self.joint = joint
        self._size = 1 + len(others)
        names = struct.pack("<I4xI", _NO_FRAME, self._size)
        for name in (joint, *others):
            text = name.encode() + b"\x00"
            names += bytes(-len(names) % 4) + struct.pack("<I", len(text)) + text
        names += bytes(-len(names) % 4)
        self._own, self._own_prefix = _joints_layout(names, self._size), names
        self._no_efforts = (math.nan,) * len(others)
        self._layout, self._prefix = _joint_layout(names, (self._size,) * 3, 0), names
        self._counts: tuple[int, ...] = (self._size,) * 3

    def write(
        self, stamp: int, position: float, velocity: float, effort: float, positions: Numbers = (), velocities: Numbers = ()
    ) -> bytes:
        """A serialised message: of this joint, and positions and velocities of the others, whose effort is not known."""
        seconds, rest = divmod(stamp, SECOND)
        head, size = (_LITTLE_ENDIAN, seconds, rest, self._own_prefix), self._size
        values = (size, position, *positions, size, velocity, *velocities, size, effort, *self._no_efforts)
        return self._own.pack(*head, *values)

    def read(self, data: bytes) -> tuple[int, float, float, float]:
        """Stamp, position, velocity and effort of the joint."""
        if len(data) == self._layout.size:
            order, seconds, rest, prefix, n, position, m, velocity, k, effort = self._layout.unpack(data)
            if order == _LITTLE_ENDIAN and prefix == self._prefix and (n, m, k) == self._counts:
                return seconds * SECOND + rest, position, velocity, effort
        return self._read_other(data)

    def is_about(self, data: bytes) -> bool:
        """Whether a message speaks of this joint; one that cannot be read may."""
        message = message_of(data, JointState)
        return message is None or not message.name or self.joint in message.name

    def _read_other(self, data: bytes) -> tuple[int, float, float, float]:
        """The long way; remembers the layout if the next message can go the short one."""
        message = message_of(data, JointState)
        if message is None:
            return UNREADABLE, math.nan, math.nan, math.nan
        names = list(message.name)
        index = names.index(self.joint) if self.joint in names else (-1 if names else 0)
        arrays = (message.position, message.velocity, message.effort)
        counts = tuple(map(len, arrays))
        if data[:4] == _LITTLE_ENDIAN and index >= 0 and all(count > index for count in counts):
            prefix = data[12 : 12 + _prefix_length(data[12:])]
            layout = _joint_layout(prefix, counts, index)
            if layout.size == len(data):
                self._layout, self._prefix, self._counts = layout, prefix, counts
        values = [array[index] if 0 <= index < len(array) else math.nan for array in arrays]
        return nanoseconds(message.header.stamp), values[0], values[1], values[2]


def message_of(data: bytes, kind: Any) -> Any:
    """The message object of some bytes, None when they are none."""
    try:
        return deserialize_message(data, kind)
    except rclpy_implementation.RMWError:
        return None


def _prefix_length(data: bytes) -> int:
    """Bytes of the frame name and the joint names; `data` starts 8 bytes into the message's CDR body."""
    frame: int = struct.unpack_from("<I", data)[0]
    at = 4 + frame + (-frame) % 4
    (count,) = struct.unpack_from("<I", data, at)
    at += 4
    for _ in range(count):
        (size,) = struct.unpack_from("<I", data, at)
        at += 4 + size + (-size) % 4
    return at


def _joint_layout(prefix: bytes, counts: tuple[int, ...], index: int) -> struct.Struct:
    """The layout of a JointState whose frame and names take `prefix`: three counts, each followed by one number of interest."""
    layout = f"<4siI{len(prefix)}s"
    at = 8 + len(prefix)
    for count in counts:
        pad = -(at + 4) % 8
        layout += f"I{pad + 8 * index}xd{8 * (count - index - 1)}x"
        at += 4 + pad + 8 * count
    return struct.Struct(layout)


def _joints_layout(prefix: bytes, size: int) -> struct.Struct:
    """The layout of a JointState with three numbers of each of `size` joints: three counts, each followed by its numbers."""
    layout = f"<4siI{len(prefix)}s"
    at = 8 + len(prefix)
    for _ in range(3):
        pad = -(at + 4) % 8
        layout += f"I{pad}x{size}d"
        at += 4 + pad + 8 * size
    return struct.Struct(layout)
