"""Two publishers of one joint: named, the one with motion and torque taken, or refused. Damage is no publisher."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

START = 1_790_000_000_000_000_000
FIELDS = ("position", "velocity", "effort")
SOURCES = tuple(SignalSource("/joint_states", field, "axle") for field in FIELDS)
TORQUE = SignalSource("/drive", "data")
T = np.arange(5000) * 0.004
RANDOM = np.random.default_rng(0)
MOTION = np.array([
    0.4 * np.sin(T), 0.4 * np.cos(T), 6.0 * np.sign(np.cos(T)) - 1.7 * np.sin(T) + 0.1 * RANDOM.standard_normal(len(T)),
])  # fmt: skip
Stream = tuple[np.ndarray, np.ndarray]


def stream(every: int, offset: float, values: Callable[[np.ndarray], np.ndarray]) -> Stream:
    """Times in s and position, velocity, effort of a publisher that says something every so many samples."""
    times = T[::every] + offset
    return times, values(times)


def still(times: np.ndarray) -> np.ndarray:
    return np.zeros((3, len(times)))


def read(*streams: Stream, clocks: tuple[float, ...] = (0.0, 0.0)) -> Recording:
    """What becomes of them on one topic. clocks: of each, s before the log time."""
    times = np.concatenate([one[0] for one in streams])
    stamps = np.concatenate([one[0] - clock for one, clock in zip(streams, clocks, strict=False)])
    order = np.argsort(times, kind="stable")
    values = np.concatenate([one[1] for one in streams], axis=1)[:, order]
    log_times, stamps = (START + np.rint(1e9 * column[order]).astype(np.int64) for column in (times, stamps))
    columns = TopicColumns("/joint_states", log_times, stamps, dict(zip(SOURCES, values, strict=True)))
    position, velocity, torque = SOURCES
    return align({"/joint_states": columns}, SignalMap(position, torque, velocity), "bag")


def matches(found: Recording, lost: int = 0) -> None:
    """The recording is the first publisher's, but for a few messages."""
    assert len(T) - lost <= len(found) <= len(T)
    rows = np.rint((found.t + (found.start - START) * 1e-9) / 0.004).astype(int)
    for column, values in zip((found.position, found.velocity, found.torque), MOTION, strict=True):
        assert column is not None
        assert np.array_equal(column, values[rows])


AXIS = (T, MOTION)


@pytest.mark.parametrize(
    ("every", "offset"), [(25, 0.0015), (1, 0.002), (1, 0.0), (2, 0.0001), (250, 0.001)],
    ids=["seldom", "alternating", "the same stamps", "half as often", "hardly ever"],
)
def test_a_publisher_that_says_zeros_is_left_out(every: int, offset: float) -> None:
    found = read(AXIS, stream(every, offset, still))
    matches(found, 3)
    assert any("of a second publisher, with no " in note and "left out" in note for note in found.notes)
    assert len(found.segments) == 1


def test_a_publisher_that_follows_and_says_no_torque_is_left_out() -> None:
    """A simulation beside the axis, 20 ms behind it."""

    def follower(times: np.ndarray) -> np.ndarray:
        return np.array([0.4 * np.sin(times - 0.02), 0.4 * np.cos(times - 0.02), 0.0 * times])

    found = read(AXIS, stream(4, 0.0015, follower))
    matches(found)
    assert "mended: /joint_states (joint axle): 1250 messages of a second publisher, with no torque, left out" in found.notes


@pytest.mark.parametrize("every", [1, 4, 25])
def test_a_publisher_without_effort_does_not_cut_the_recording_to_pieces(every: int) -> None:
    """As `joint_state_publisher` says positions alone."""

    def silent(times: np.ndarray) -> np.ndarray:
        return np.array([0.4 * np.sin(times), np.nan * times, np.nan * times])

    found = read(AXIS, stream(every, 0.0015, silent))
    matches(found)
    assert found.segments == (slice(0, len(T)),)


def test_two_axes_of_one_name_are_refused() -> None:
    def other(times: np.ndarray) -> np.ndarray:
        return np.array([1.0 + 0.3 * np.sin(2.0 * times), 0.6 * np.cos(2.0 * times), 3.0 * np.cos(2.0 * times)])

    with pytest.raises(InputError, match=r"1250 messages of two publishers of /joint_states \(joint axle\)") as caught:
        read(AXIS, stream(4, 0.0015, other))
    assert "that contradict each other, both with motion and torque, expected one publisher of a joint" in str(caught.value)


def test_motion_in_one_and_torque_in_the_other_is_refused() -> None:
    with pytest.raises(InputError, match="no torque in one, no motion in the other"):
        read((T, MOTION * [[1.0], [1.0], [0.0]]), stream(4, 0.0015, lambda times: np.array([0 * times, 0 * times, times])))


def test_two_clocks_are_two_publishers() -> None:
    def same(times: np.ndarray) -> np.ndarray:
        return np.array([0.4 * np.sin(times), 0.4 * np.cos(times), 0.0 * times])

    matches(read(AXIS, stream(3, 0.0015, same), clocks=(0.0, 1e6)))


def test_three_publishers_are_told_apart() -> None:
    found = read(AXIS, stream(25, 0.0015, still), stream(10, 0.0007, lambda times: still(times) + 2.0), clocks=(0.0, 0.0, 0.0))
    matches(found, 3)
    assert sum("of a second publisher" in note for note in found.notes) == 2


def test_a_second_publisher_of_the_torque_alone_is_left_out() -> None:
    logged = START + np.rint(1e9 * T).astype(np.int64)
    columns = {"/joint_states": TopicColumns("/joint_states", logged, None, {SOURCES[0]: MOTION[0]})}
    times = np.concatenate((T, T[::10] + 0.0015))
    order = np.argsort(times)
    stamps = START + np.rint(1e9 * times[order]).astype(np.int64)
    torque = np.concatenate((MOTION[2], np.zeros(500)))[order]
    columns["/drive"] = TopicColumns("/drive", stamps, stamps, {TORQUE: torque})
    found = align(columns, SignalMap(SOURCES[0], TORQUE), "bag")
    assert np.array_equal(found.torque, MOTION[2])
    assert "mended: /drive: 500 messages of a second publisher, with no torque, left out" in found.notes


def test_wrong_readings_noise_wraps_and_reversals_are_no_publishers() -> None:
    wrong = MOTION.copy()
    wrong[0, ::300] += 0.2
    wrong[2, ::200] = 0.0
    rest = 2.0 * np.pi + 1e-3 * RANDOM.standard_normal(len(T))
    jitter = T + 0.0015 * RANDOM.uniform(size=len(T))
    flicker = np.array([0.01 * np.round(0.3 * np.sin(20 * T) / 0.01) + 0.01 * RANDOM.integers(0, 2, len(T)), *MOTION[1:]])
    for values, times in (
        (wrong, T), (np.array([np.mod(rest, 2.0 * np.pi), 0.0 * T, MOTION[2]]), T), (RANDOM.standard_normal((3, len(T))), T),
        (RANDOM.standard_normal((3, len(T))), jitter), (flicker, T), (flicker, jitter), (MOTION, jitter),
        (np.array([0.3 * np.sin(150.0 * T), 45.0 * np.cos(150.0 * T), MOTION[2]]), jitter),
    ):  # fmt: skip
        found = read((times, values))
        assert not any("publisher" in note for note in found.notes)
        assert len(found) >= 0.99 * len(T)


def test_late_messages_are_no_publisher() -> None:
    order = np.arange(len(T))
    late = np.arange(100, 4900, 25)
    order[late], order[late + 6] = order[late + 6].copy(), order[late].copy()
    stamps = START + np.rint(1e9 * T[order]).astype(np.int64)
    values = dict(zip(SOURCES, MOTION[:, order], strict=True))
    columns = TopicColumns("/joint_states", START + np.rint(1e9 * T).astype(np.int64), stamps, values)
    found = align({"/joint_states": columns}, SignalMap(SOURCES[0], SOURCES[2], SOURCES[1]), "bag")
    matches(found)
