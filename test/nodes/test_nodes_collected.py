"""What identifier, diagnoser, commission and calibration keep: acceptable messages alone; what is refused is reported."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped

from tcs_friction.errors import JobError
from tcs_friction.nodes.core import joint_input, topic_input
from tcs_friction.nodes.core.convert import set_stamp
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, JointWire

PERIOD = 0.01
BEGIN = 1_700_000_000 * 10**9
REAL_TIME = ("-p", "clock:=real_time", "-p", f"period:={PERIOD}")
WIRE = JointWire("azimuth")
TOPICS = ("joint_states", "reference", "friction_estimate")


class Steady:
    """A steady clock that the test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> Steady:
    clock = Steady()
    for module in (joint_input, topic_input):
        monkeypatch.setattr(module, "time", clock)
    return clock


def wild(stamp: int) -> list[bytes]:
    """States that must not be kept, after one of this stamp."""
    return [
        WIRE.write(0, 0.0, 0.0, 1.0),
        WIRE.write(stamp - 10**8, 0.0, 0.0, 1.0),
        WIRE.write(stamp + 1, 1e308, 0.0, 1.0),
        WIRE.write(stamp + 1, 0.0, 1e308, 1.0),
        WIRE.write(stamp + 1, 0.5, 0.0, 1.0),
    ]


def run(steady: Steady, hear: Callable[[bytes], None], ticks: int = 200) -> None:
    """States of an axis at rest, wild ones in the middle of them."""
    for k in range(ticks):
        steady.now += PERIOD
        stamp = BEGIN + k * 10_000_000
        hear(WIRE.write(stamp, 0.0, 0.0, 1.0))
        if k == ticks // 2:
            for data in wild(stamp):
                hear(data)


@pytest.mark.parametrize("name", ["identifier", "diagnoser"])
def test_a_live_recording_keeps_no_wild_states(together: Callable[..., Any], steady: Steady, name: str) -> None:
    node = together(*REAL_TIME, nodes=[name])[name]
    run(steady, node._on_state)
    node._on_state(WIRE.write(BEGIN + 200 * 10_000_000, 0.0, 0.0, 1e300))
    recording = node._live.recording()
    assert 140 <= len(recording.position) <= 151, "all of them once they are believed"
    assert not recording.position.any()
    assert node.health.refused >= 6
    assert any("joint_states refused: no stamp" in text for text in node.health.report(time.monotonic()).values())


def test_a_new_run_in_lock_step_is_told(together: Callable[..., Any]) -> None:
    node = together(nodes=["identifier"])["identifier"]
    for k in range(100):
        node._on_state(WIRE.write(k * 10**7, 0.0, 0.0, 1.0))
    node._on_state(WIRE.write(0, 0.0, 0.0, 1.0))
    assert node.health.values["live recording"] == "begun anew at 0.000 s, after 100 states of the run before"


def test_an_identifier_is_not_idle_while_states_flow_and_counts_each_once(together: Callable[..., Any]) -> None:
    """Also where an observer gives estimates."""
    node = together("-p", "switch2:=true", "-p", "time_limit:=0.5", nodes=["identifier"])["identifier"]
    for k in range(50):
        node._on_estimate(ESTIMATE.write(k * 10**6, 80.0, 1e-3, 0.0, True))
        node._on_state(WIRE.write(k * 10**6, 0.0, 0.0, 1.0))
    assert node.health.ticks == 50
    node._watch(100.0)
    for k in range(50, 60):
        node._on_state(WIRE.write(k * 10**6, 0.0, 0.0, 1.0))
    node._watch(101.0)
    assert "idle" not in node.health.warning
    node._watch(102.0)
    assert "idle: no new joint_states" in node.health.warning


def answer(collector: Any, stamp: int) -> None:
    collector._on_reference(REFERENCE.write(stamp, 0.0, 0.0, 0.0))
    collector._listener("friction_estimate")(ESTIMATE.write(stamp, 0.0, 0.0, 0.0, True))


def test_a_run_is_collected_without_wild_messages(together: Callable[..., Any], steady: Steady) -> None:
    node = together(*REAL_TIME, nodes=["commission"])["commission"]
    collector = node._runs

    def hear(data: bytes) -> None:
        collector._on_state(data)
        answer(collector, WIRE.read(data)[0])
        collector._on_reference(REFERENCE.write(WIRE.read(data)[0] + 1, 1e308, math.nan, 0.0))

    run(steady, hear)
    collector.begin("azimuth", 1.0, TOPICS)
    for k in range(200, 310):
        steady.now += PERIOD
        stamp = BEGIN + k * 10_000_000
        hear(WIRE.write(stamp, 0.0, 0.0, 1.0))
        if k == 250:
            for data in wild(stamp):
                collector._on_state(data)
            answer(collector, 0)
    assert collector._complete()
    series = {name: kept.arrays() for name, kept in collector._series.items()}
    assert [len(series[name][0]) for name in TOPICS] == [101] * 3
    assert not any(column.any() for column in series["reference"][1:])
    assert any("reference refused" in text for text in node.health.report(time.monotonic()).values())


def test_a_run_whose_clock_is_set_in_the_middle_is_given_up(together: Callable[..., Any], steady: Steady) -> None:
    graph = together(*REAL_TIME, nodes=["commission"])
    collector = graph["commission"]._runs
    run(steady, collector._on_state)
    collector.begin("azimuth", 10.0, TOPICS)
    for k in range(200, 400):
        steady.now += PERIOD
        jump = 3600 * 10**9 if k > 250 else 0
        collector._on_state(WIRE.write(BEGIN + k * 10_000_000 + jump, 0.0, 0.0, 1.0))
    with pytest.raises(JobError, match=r"clock or position of the axis was set anew after 0.50"):
        graph.result(collector.finished(5.0, lambda _: None))


@pytest.mark.parametrize(
    ("torque", "age", "words"),
    [
        (1e300, 0, "torque 1e+300"),
        (math.nan, 0, "torque nan"),
        (1.0, -BEGIN, "than the newest state, the limit is 2 s"),
        (1.0, 10**10, "stamp 10 s newer than the newest state"),
        (1.0, -(10**9), "stamp older than that of the one before"),
    ],
)
def test_readings_of_a_dynamometer_that_cannot_be_are_refused(
    together: Callable[..., Any], steady: Steady, torque: float, age: int, words: str
) -> None:
    node = together(*REAL_TIME, nodes=["dob"])["dob"]
    run(steady, node._on_state, 100)
    stamp = BEGIN + 99 * 10_000_000

    def read(torque: float, stamp: int) -> None:
        message = WrenchStamped()
        message.wrench.torque.z = torque
        set_stamp(message, stamp)
        node._on_dynamometer(message)

    read(80.0, stamp)
    refused = node.health.refused
    read(torque, stamp + age)
    assert node.health.refused == refused + 1
    assert any(words in text for text in node.health.report(time.monotonic()).values())
    read(80.0, stamp + 1)
    assert node._calibration._readings.arrays()[1].tolist() == [80.0, 80.0]
