"""Compiled loops over raw bytes: find message records, compare structure bytes, gather numbers.

All offsets count from the start of the uint8 buffer given. No kernel reads past the `stop` it is given.
"""

from __future__ import annotations

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

Buffer = NDArray[np.uint8]
Longs = NDArray[np.int64]

BYTES = types.Array(types.uint8, 1, "C", readonly=True)
LONGS = types.Array(types.int64, 1, "C", readonly=True)
WORDS = types.int64[::1]

MESSAGE = 5
"""Opcode of an mcap message record: u8 opcode, u64 length, u16 channel, u32 sequence, u64 log time, u64 publish time."""

HEAD = 9
MESSAGE_HEAD = HEAD + 22


@numba.njit(types.int64(BYTES, types.int64), cache=True, inline="always")
def read_u64(buffer: Buffer, at: int) -> int:
    """Little-endian 64-bit number; above 2^63 it comes out negative and counts as damage."""
    value = np.int64(0)
    for index in range(8):
        value |= np.int64(buffer[at + index]) << np.int64(8 * index)
    return value  # type: ignore[return-value]


@numba.njit(types.int64(BYTES, types.int64), cache=True, inline="always")
def read_u32(buffer: Buffer, at: int) -> int:
    """Little-endian 32-bit number."""
    value = np.int64(0)
    for index in range(4):
        value |= np.int64(buffer[at + index]) << np.int64(8 * index)
    return value  # type: ignore[return-value]


@numba.njit(types.UniTuple(types.int64, 2)(BYTES, types.int64, types.int64), cache=True)
def count_mcap_messages(buffer: Buffer, start: int, stop: int) -> tuple[int, int]:
    """How many whole message records follow one another from `start`, and where the run of them ends."""
    count = 0
    at = start
    while at + MESSAGE_HEAD <= stop and buffer[at] == MESSAGE:
        length = read_u64(buffer, at + 1)
        if length < 22 or length > stop - at - HEAD:
            break
        count += 1
        at += HEAD + length
    return count, at


@numba.njit(types.void(BYTES, types.int64, WORDS, WORDS, WORDS, WORDS), cache=True)
def list_mcap_messages(
    buffer: Buffer, start: int, channels: Longs, log_times: Longs, starts: Longs, lengths: Longs
) -> None:
    """Fill in channel, log time (ns), payload offset and length of the messages that the count has found."""
    at = start
    for index in range(len(channels)):
        length = read_u64(buffer, at + 1)
        channels[index] = np.int64(buffer[at + 9]) | (np.int64(buffer[at + 10]) << 8)
        log_times[index] = read_u64(buffer, at + 15)
        starts[index] = at + MESSAGE_HEAD
        lengths[index] = length - 22
        at += HEAD + length


@numba.njit(
    types.int64(BYTES, LONGS, LONGS, types.int64[::1], types.int64, LONGS, BYTES, types.int64), cache=True
)
def match_layout(
    buffer: Buffer, starts: Longs, lengths: Longs, assigned: Longs, number: int, offsets: Longs, content: Buffer, size: int
) -> int:
    """Give layout `number` to the messages without one (-1) whose structure bytes are its; how many stay without."""
    left = 0
    for index in range(len(starts)):
        if assigned[index] != -1:
            continue
        fits = lengths[index] >= size
        if fits:
            start = starts[index]
            for place in range(len(offsets)):
                if buffer[start + offsets[place]] != content[place]:
                    fits = False
                    break
        if fits:
            assigned[index] = number
        else:
            left += 1
    return left


@numba.njit(types.void(BYTES, LONGS, LONGS, types.int64, types.int64, types.uint8[:, ::1]), cache=True)
def gather(buffer: Buffer, starts: Longs, assigned: Longs, number: int, offset: int, out: Buffer) -> None:
    """Copy out.shape[1] bytes at `offset` of each message with layout `number` into its row of `out`."""
    size = out.shape[1]
    for index in range(len(starts)):
        if assigned[index] == number:
            start = starts[index] + offset
            for place in range(size):
                out[index, place] = buffer[start + place]


@numba.njit(types.int64(BYTES, types.int64, types.int64, WORDS), cache=True)
def list_ros1_records(buffer: Buffer, start: int, stop: int, table: Longs) -> int:
    """Walk ROS 1 bag records: u32 header length, header fields, u32 data length, data.

    table: flat rows of six: opcode, connection (-1 if none), time in ns (-1 if none), header offset, data offset,
    data length; as many as fit are filled. Returns how many rows; the walk ends at the first record that is not whole.
    """
    rows = 0
    at = start
    while rows * 6 + 6 <= len(table) and at + 8 <= stop:
        header_length = read_u32(buffer, at)
        data_at = at + 4 + header_length
        if data_at + 4 > stop:
            break
        data_length = read_u32(buffer, data_at)
        if data_at + 4 + data_length > stop:
            break
        operation, connection, time = np.int64(-1), np.int64(-1), np.int64(-1)
        field = at + 4
        while field + 4 <= data_at:
            length = read_u32(buffer, field)
            name = field + 4
            field = name + length
            if field > data_at:
                break
            if length == 4 and buffer[name] == 111 and buffer[name + 1] == 112 and buffer[name + 2] == 61:  # op=
                operation = np.int64(buffer[name + 3])
            elif length == 9 and buffer[name] == 99 and buffer[name + 3] == 110 and buffer[name + 4] == 61:  # conn=
                connection = read_u32(buffer, name + 5)
            elif length == 13 and buffer[name] == 116 and buffer[name + 3] == 101 and buffer[name + 4] == 61:  # time=
                time = read_u32(buffer, name + 5) * 1_000_000_000 + read_u32(buffer, name + 9)
        row = rows * 6
        table[row], table[row + 1], table[row + 2] = operation, connection, time
        table[row + 3], table[row + 4], table[row + 5] = at + 4, data_at + 4, data_length
        rows += 1
        at = data_at + 4 + data_length
    return rows


@numba.njit(types.void(types.uint8[:, ::1], LONGS, types.uint8[::1]), cache=True)
def scatter(records: Buffer, offsets: Longs, out: Buffer) -> None:
    """Copy each row of `records` to its offset in `out`."""
    for index in range(len(records)):
        at = offsets[index]
        for place in range(records.shape[1]):
            out[at + place] = records[index, place]


@numba.njit(types.void(types.float64[:, ::1], types.float64[::1], types.int64, types.boolean[::1]), cache=True)
def trace_two(signals: NDArray[np.float64], seconds: NDArray[np.float64], seed: int, labels: NDArray[np.bool_]) -> None:
    """Mark the messages that follow message `seed` rather than the one before it; from there to the end, then to the start.

    signals: (k, n) in units of their usual differences. The first is expected along its speed, the others as they were.
    """
    count, number = signals.shape[1], signals.shape[0]
    last = np.empty(2, dtype=np.int64)
    speed = np.zeros(2)
    for direction in (1, -1):
        last[0], last[1] = seed - 1, seed
        speed[0] = speed[1] = 0.0
        labels[seed] = True
        index = seed + 1 if direction == 1 else seed - 2
        while 0 <= index < count:
            nearest, chosen = np.inf, 0
            for one in range(2):
                expected = signals[0, last[one]] + speed[one] * (seconds[index] - seconds[last[one]])
                away = abs(signals[0, index] - expected)
                for row in range(1, number):
                    away += abs(signals[row, index] - signals[row, last[one]])
                if away < nearest:
                    nearest, chosen = away, one
            passed = seconds[index] - seconds[last[chosen]]
            if passed * direction > 0.0:
                speed[chosen] = (signals[0, index] - signals[0, last[chosen]]) / passed
            last[chosen] = index
            labels[index] = chosen == 1
            index += direction
