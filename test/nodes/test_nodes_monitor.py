"""The node monitor: an alarm on a change and none without, the bag around it, a diagnosis on request, and inputs that fail."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisEvidence, AxisReference
from tcs_friction_msgs.srv import Diagnose

from benchmarks.listening import Listening, Report, wait_until
from tcs_friction.config import load_axis, shipped
from tcs_friction.control.loop import LoopConfig, simulate_loop
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.errors import InputError
from tcs_friction.nodes.bags import event_ring
from tcs_friction.nodes.bags.event_ring import EventRing, new_name, write_bag
from tcs_friction.nodes.core import joint_input
from tcs_friction.nodes.core.convert import nanoseconds
from tcs_friction.nodes.core.qos import COLLECT, PUBLISH
from tcs_friction.nodes.core.wire import REFERENCE, JointWire
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.definitions import Channel

FILE = load_axis(shipped("azimuth_1p2m.yaml"))
BEGIN = 1_700_000_000 * 10**9
EVERY, PERIOD = 5, 5e-3  # ticks of the simulation for one of the monitor
WIRE = JointWire("azimuth")
States = list[tuple[float, float]]


def states(duration: float, coulomb: float = 1.0, seed: int = 0) -> States:
    """Position and torque every PERIOD of a run that begins and ends at rest in one place, with so many times the friction."""
    names = ("coulomb", "static")
    axis = FILE.axis.with_friction({name: coulomb * FILE.axis.friction.values[name] for name in names})
    words = {"kind": "sinusoid", "amplitude": 0.05, "period": 10.0, "duration": duration}
    assert FILE.control is not None
    run = simulate_loop(axis, reference_from_mapping(words, "run"), FILE.control.controller, LoopConfig(), seed=seed)
    whole = len(run.t) // EVERY * EVERY
    torque = run.torque[:whole].reshape(-1, EVERY).mean(axis=1)
    return list(zip(run.position[EVERY - 1 : whole : EVERY].tolist(), torque.tolist(), strict=True))


class Axis(Listening):
    """Plays an axis and a diagnoser, and hears what the monitor says."""

    def __init__(self) -> None:
        self.evidence: list[AxisEvidence] = []
        self.report = Report(0.0, 0, "", {})
        self.asked: list[Diagnose.Request] = []
        self.stamps = itertools.count(BEGIN, round(PERIOD * 1e9))
        super().__init__("axis")
        self.publisher = self.node.create_publisher(JointState, "joint_states", PUBLISH)
        self.reference = self.node.create_publisher(AxisReference, "reference", PUBLISH)
        self.node.create_subscription(AxisEvidence, "axis_evidence", self.evidence.append, COLLECT)
        self.node.create_service(Diagnose, "diagnoser/diagnose", self._diagnose)
        self.hear_reports(lambda name, report: setattr(self, "report", report) if name == "monitor" else None)
        self.clients = {name: self.node.create_client(Trigger, f"monitor/{name}") for name in ("diagnose", "learn", "forget")}
        self.parameters = self.node.create_client(SetParameters, "monitor/set_parameters")
        self.begin()

    def _diagnose(self, request: Diagnose.Request, answer: Diagnose.Response) -> Diagnose.Response:
        self.asked.append(request)
        answer.success, answer.statement = True, "The model lacks what the test says."
        return answer

    def move(self, course: States) -> None:
        """States as fast as the monitor hears them."""
        for k, (position, torque) in enumerate(course):
            stamp = next(self.stamps)
            self.publisher.publish(WIRE.write(stamp, position, 0.0, torque))
            if k % 10 == 0:
                self.reference.publish(REFERENCE.write(stamp, position, 0.0, 0.0))
            if k % 400 == 399:
                heard = stamp - 1_000_000_000
                assert wait_until(lambda heard=heard: bool(self.evidence) and self.stamp >= heard, 20.0), "it hears no more"  # type: ignore[misc]

    def set(self, name: str, value: bool) -> None:
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        future = self.parameters.call_async(request)
        assert wait_until(future.done)
        assert future.result().results[0].successful

    @property
    def stamp(self) -> int:
        """Of the newest evidence, ns."""
        return nanoseconds(self.evidence[-1].header.stamp)

    def call(self, name: str) -> Trigger.Response:
        future = self.clients[name].call_async(Trigger.Request())
        assert wait_until(future.done)
        return future.result()

    def says(self, words: str, limit: float = 15.0) -> bool:
        """Whether the next reports have these words."""
        return wait_until(lambda: words in f"{self.report.message} {self.report.values}", limit)


@pytest.fixture
def axis() -> Iterator[Axis]:
    made = Axis()
    yield made
    made.close()


def started(processes: Any, axis: Axis, folder: Path, *more: str, label: str = "", phase: str = "learning") -> None:
    """A monitor in a process of its own that hears the axis."""
    values = {"period": PERIOD, "learning_time": 40.0, "before": 15.0, "after": 4.0, "results": folder}
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    processes.start("monitor", *words, *more, label=label)
    assert wait_until(lambda: axis.publisher.get_subscription_count() > 0 and axis.clients["learn"].service_is_ready())
    assert axis.says(f"'phase': '{phase}'")


def test_a_change_is_told_recorded_and_diagnosed_and_learning_outlives_a_restart(
    processes: Any, axis: Axis, tmp_path: Path
) -> None:
    kept = tmp_path / "kept" / "learned.npz"
    started(processes, axis, tmp_path, "-p", f"learned:={kept}")
    assert "no bag around a change" in axis.call("diagnose").message
    axis.move(states(60.0))
    assert axis.says("'phase': 'watching'", 120.0), "where nothing is compiled yet, this takes a while"
    for wild in (WIRE.write(next(axis.stamps), math.nan, 0.0, 1.0), WIRE.write(axis.stamp + 10**9, 1e300, 0.0, 1.0), b"\0\1\0\0"):
        axis.publisher.publish(wild)
    axis.move(states(40.0, seed=1))
    quiet = [message for message in axis.evidence if not math.isnan(message.unexplained)]
    assert len(quiet) > 500
    assert not axis.evidence[-1].changed
    assert max(message.evidence for message in quiet) < -2.0
    assert axis.says("watching")
    assert int(axis.report.values["inputs refused"]) >= 2
    changed_at = axis.stamp
    axis.move(states(20.0, coulomb=1.1, seed=2))
    assert axis.says("physics changed: friction in ")
    assert axis.report.level == 1
    assert "grew by" in axis.report.message
    assert "since 2023-11-14" in axis.report.message
    assert "by chance with a probability of" in axis.report.message
    told = next(message for message in axis.evidence if message.changed)
    assert 0 < nanoseconds(told.header.stamp) - changed_at < 10**10
    assert axis.says("'bag': ")
    bag = Path(axis.report.values["bag"])
    assert bag.parent == tmp_path
    assert bag.name.startswith("change_azimuth_")
    assert not list(tmp_path.glob(".*"))
    (recording,) = read_recordings([bag], FILE.mapped("test"))
    first, last = (BEGIN / 1e9 + recording.t[k] - recording.t[0] for k in (0, -1))
    assert last - first == pytest.approx(19.0, abs=2.0)
    answer = axis.call("diagnose")
    assert answer.success
    assert answer.message == "The model lacks what the test says."
    assert list(axis.asked[0].bags) == [str(bag)]
    assert axis.asked[0].directory == f"{bag.name}_diagnosis"
    assert axis.call("forget").success
    assert not axis.call("forget").success
    axis.set("diagnose", True)
    axis.move(states(20.0, coulomb=0.9, seed=3))
    assert wait_until(lambda: len(axis.asked) == 2, 20.0), "with this parameter a change is diagnosed at once"
    assert len(list(tmp_path.glob("change_*"))) == 2, "the first bag is kept, and a second one written"
    assert axis.says("The model lacks what the test says.")
    assert "fell by" in axis.report.message
    learned = kept.read_bytes()
    assert axis.call("learn").success
    assert not kept.exists(), "a restart would judge by what is to be forgotten"
    axis.move(states(1.0))
    assert wait_until(lambda: axis.evidence[-1].learned < 0.1 and not axis.evidence[-1].changed)
    assert processes.interrupt("monitor") == 0
    axis.report = Report(0.0, 0, "", {})
    started(processes, axis, tmp_path, label="again")
    axis.move(states(3.0))
    assert wait_until(lambda: 0.0 < axis.evidence[-1].learned < 0.2), "without a file what was learned is not kept"
    assert processes.interrupt("again") == 0
    axis.report = Report(0.0, 0, "", {})
    kept.write_bytes(learned)
    started(processes, axis, tmp_path, "-p", f"learned:={kept}", label="recalls", phase="watching")
    axis.move(states(3.0))
    assert wait_until(lambda: axis.evidence[-1].learned == 1.0 and not math.isnan(axis.evidence[-1].unexplained))


def test_a_file_of_another_model_is_said_and_learning_begins_anew(together: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "learned.npz").write_text("nonsense")
    node = together("-p", f"period:={PERIOD}", "-p", f"learned:={tmp_path / 'learned.npz'}", nodes=["monitor"])["monitor"]
    assert node._watch_over.is_learning
    assert "learning anew: " in node.health.warning
    assert "is not what a monitor has learned" in node.health.warning


THERMAL = "{effect: temperature_dependent_friction, parameters: {dry: -0.01, viscous: 0.0}}"


def test_without_the_temperature_that_the_model_needs_nothing_is_judged(together: Callable[..., Any], tmp_path: Path) -> None:
    text = shipped("azimuth_1p2m.yaml").read_text().replace("effects:\n", f"effects:\n    - {THERMAL}\n")
    (tmp_path / "axis.yaml").write_text(text)
    graph = together("-p", f"axis:={tmp_path / 'axis.yaml'}", "-p", f"period:={PERIOD}", nodes=["monitor"])
    node = graph["monitor"]
    hear(node, states(2.0))
    node._watch(time.monotonic())
    assert "nothing is judged: no temperature" in node.health.warning
    hear(node, states(2.0), BEGIN + 10**10)
    assert node._watch_over.clock < 1.0
    sender = graph.driver.create_publisher(Temperature, "temperature", 10)
    for value in (1e9, 15.0):
        assert graph.until(lambda: sender.get_subscription_count() > 0)
        sender.publish(Temperature(temperature=value))
        graph.for_seconds(0.2)
    assert graph.until(lambda: node.health.refused == 1 and node._around.temperature == 15.0)
    node._watch(time.monotonic())
    hear(node, states(2.0), BEGIN + 2 * 10**10)
    assert node._watch_over.residual != 0.0
    assert node._watch_over.clock > 1.5


def hear(node: Any, course: States, begin: int = BEGIN, torque: bool = True) -> None:
    for k, (position, effort) in enumerate(course):
        stamp = begin + k * round(PERIOD * 1e9)
        node._on_state(WIRE.write(stamp, position, 0.0, effort if torque else math.nan))


def test_gaps_new_runs_and_missing_torques_are_not_taken_for_changes(together: Callable[..., Any]) -> None:
    node = together("-p", f"period:={PERIOD}", nodes=["monitor"])["monitor"]
    course = states(4.0)
    hear(node, course[:200])
    hear(node, course[400:], BEGIN + 2 * 10**9)
    assert node._watch_over.stretches == 2, "the beginning, and a gap of a second"
    hear(node, course[:200], BEGIN - 10**10)
    assert node._watch_over.stretches == 3, "a new run"
    before = node._watch_over.clock
    hear(node, course, BEGIN, torque=False)
    assert node._watch_over.clock == before, "without a torque there is no residual"
    assert node.health.ticks > 1000


class Steady:
    """A steady clock that the test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


def test_in_real_time_stray_states_are_refused_and_a_pause_is_not_bridged(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    steady = Steady()
    monkeypatch.setattr(joint_input, "time", steady)
    node = together("-p", f"period:={PERIOD}", "-p", "clock:=real_time", nodes=["monitor"])["monitor"]
    course, watch = states(6.0), node._watch_over

    def pass_by(part: States, begin: float) -> None:
        for k, (position, effort) in enumerate(part):
            steady.now = 100.0 + begin + k * PERIOD
            stamp = BEGIN + round((begin + k * PERIOD) * 1e9)
            node._on_state(WIRE.write(stamp, position, 0.0, effort))
            if k == len(part) // 2:
                for wild in (WIRE.write(BEGIN, position, 0.0, 1.0), WIRE.write(stamp + 1, position + 0.5, 0.0, 1.0)):
                    node._on_state(wild)

    pass_by(course[:400], 0.0)
    assert node.health.refused >= 2
    assert watch.stretches == 1
    pass_by(course[600:1000], 3.0)
    assert watch.stretches == 2
    assert 4.0 < watch.clock < 5.1


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("learning_time:=1.0", "learning_time out of range Min: 30.0, Max: 100000.0, value: 1.0"),
        ("befor:=3.0", "no parameter befor, expected before"),
    ],
)
def test_bad_parameters_are_refused_in_one_line(together: Callable[..., Any], word: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as refused:
        together("-p", word, nodes=["monitor"])
    assert "\n" not in str(refused.value)


def test_a_changed_limit_keeps_what_was_learned_and_another_axis_does_not(together: Callable[..., Any]) -> None:
    node = together("-p", f"period:={PERIOD}", nodes=["monitor"])["monitor"]
    hear(node, states(2.0))
    watch = node._watch_over
    assert watch.learned_time > 0.0
    node.set_parameters([Parameter("alarm_interval", value=3.0)])
    assert node._watch_over is watch
    assert watch.config.alarm_interval == 3.0
    node.set_parameters([Parameter("axis", value="altitude_1p2m.yaml")])
    assert node._watch_over is not watch
    assert node._watch_over.learned_time == 0.0


def test_the_ring_forgets_what_is_old_and_writes_what_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = EventRing(10)
    number = ring.add_topic(Channel("/t", "std_msgs/msg/Empty", "cdr", "", "ros2msg", ""), "")
    for now in range(30):
        ring.now = now
        ring.keep(number, bytes([now]))
    channels, kept = ring.copy()
    assert [payload[0] for *_, payload in kept] == list(range(19, 30))
    path = new_name(tmp_path, "change")
    write_bag(path, channels, kept)
    assert new_name(tmp_path, "change") == tmp_path / "change_2"
    assert [file.name for file in sorted(path.iterdir())] == ["change_0.mcap", "metadata.yaml"]

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(event_ring.os, "rename", full)
    with pytest.raises(Exception, match="cannot be written"):
        write_bag(tmp_path / "other", channels, kept)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["change"], "nothing half-written is left"
    ring.restart()
    assert len(ring) == 0
    assert np.isfinite(len(ring.copy()[1]))
