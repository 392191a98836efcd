"""Several axes in one graph: names and arguments, one simulated time, coupling, one commissioned while the other moves."""

from __future__ import annotations

import itertools
import random
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import short_runs
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from tcs_friction_msgs.action import Commission as CommissionAction

from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.nodes.axes import arguments_by_axis
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.graph import GRAPH, LOOP
from tcs_friction.nodes.loop.beside import Beside
from tcs_friction.physics.simulate import Simulator
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.signals import SignalSource

CONFIG = Path(__file__).resolve().parents[2] / "config"
BOTH = ("azimuth_1p2m.yaml", "altitude_1p2m.yaml")
SECOND = 1_000_000_000


# Arguments


def renamed(folder: Path, name: str, file: str) -> str:
    text = (CONFIG / "azimuth_1p2m.yaml").read_text().replace("name: azimuth", f"name: {name}")
    (folder / file).write_text(text)
    return str(folder / file)


def test_each_axis_has_its_own_namespace_reference_and_companions() -> None:
    found = arguments_by_axis(BOTH, (), ["--ros-args", "-p", "seed:=3"])
    assert list(found) == ["/azimuth", "/altitude"]
    words = found["/altitude"]
    assert words[-2:] == ["-p", "seed:=3"], "what the user says comes last and wins"
    assert "__ns:=/altitude" in words
    assert "beside:=['/azimuth']" in words
    assert f"reference_file:={CONFIG / 'altitude_1p2m_run.yaml'}" in words
    assert f"measure_file:={CONFIG / 'altitude_1p2m_measure.yaml'}" in words
    assert "start_position:=0.7" in words, "where its own reference begins"
    assert "start_position:=0.0" in found["/azimuth"]


def test_references_are_given_in_the_order_of_the_axes_or_once_for_all() -> None:
    given = ("azimuth_geared_run.yaml", "altitude_1p2m_run.yaml")
    by_axis = arguments_by_axis(BOTH, given)
    for space, name in zip(("/azimuth", "/altitude"), given, strict=True):
        assert any(word.startswith("reference_file:=") and word.endswith(name) for word in by_axis[space])
    for words in arguments_by_axis(BOTH, given[1:]).values():
        assert f"reference_file:={CONFIG / given[1]}" in words
    with pytest.raises(InputError, match="--reference: 3 for 2 axes, expected one for each axis, in their order, or one for all"):
        arguments_by_axis(BOTH, [*given, *given[:1]])


def test_a_single_axis_stays_in_the_namespace_that_it_always_had(tmp_path: Path) -> None:
    words = arguments_by_axis([renamed(tmp_path, "stage", "stage.yaml")])[""]
    assert not [word for word in words if "__ns" in word or "beside" in word or "measure_file" in word]
    assert any(word.endswith("azimuth_1p2m_run.yaml") for word in words), "no file of its own beside it"


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("azimuth", (), "b.yaml: axis: name: 'azimuth' is that of .*azimuth_1p2m.yaml, too, expected a name of its own"),
        ("my axis", (), "b.yaml: axis: name: 'my axis', expected letters, digits and underscores"),
        ("other", ("-r", "__ns:=/telescope"), "--ros-args: a namespace for several axes, expected none"),
    ],
)
def test_names_that_do_not_go_together_are_refused(tmp_path: Path, name: str, arguments: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        arguments_by_axis([BOTH[0], renamed(tmp_path, name, "b.yaml")], (), arguments)


@pytest.mark.parametrize("words", [("-p", "seed"), ("-p", "/altitude/plant:seed:=3"), ("-r", "x")])
def test_arguments_that_ros_cannot_read_cost_one_line(words: tuple[str, ...], capfd: pytest.CaptureFixture[str]) -> None:
    assert run(args=["graph", "--ros-args", *words]) == 2
    (said,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("tcs-friction")]
    assert said.startswith("tcs-friction: ROS arguments: ")
    assert words[1] in said
    assert said.endswith("expected -p NAME:=VALUE, -r OLD:=NEW; for a single node --params-file FILE")


# One simulated time


class Wires:
    """In place of ROS: messages come in order from each sender, otherwise in any order and as late as chance has it."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.under_way: dict[tuple[str, int], deque[Any]] = {}
        self.hearing: dict[str, list[tuple[int, Callable[[Any], None]]]] = {}
        self.last: dict[str, deque[Any]] = {}

    def deliver(self) -> bool:
        ways = [way for way, messages in self.under_way.items() if messages]
        if not ways:
            return False
        way = self.random.choice(ways)
        message = self.under_way[way].popleft()
        for number, heard in self.hearing.get(way[0], []):
            if number == way[1]:
                heard(message)
        return True


class Node:
    """As much of a node as `Beside` asks for."""

    count = 0

    def __init__(self, wires: Wires, space: str) -> None:
        Node.count += 1
        self.wires, self.space, self.number = wires, space, Node.count

    def create_publisher(self, _kind: Any, topic: str, _profile: Any) -> Any:
        self.topic = f"{self.space}/{topic}"
        self.wires.last[self.topic] = deque(maxlen=10)
        return self

    def publish(self, message: Any) -> None:
        self.wires.last[self.topic].append(message)
        for number, _ in self.wires.hearing.get(self.topic, []):
            self.wires.under_way[self.topic, number].append(message)

    def create_subscription(self, _kind: Any, topic: str, heard: Callable[[Any], None], _profile: Any) -> None:
        """One that comes late is told the last messages, as DDS does."""
        self.wires.hearing.setdefault(topic, []).append((self.number, heard))
        self.wires.under_way[topic, self.number] = deque(self.wires.last.get(topic, ()))


class Toy:
    """A plant whose position is its time, and which writes down what it took for the positions of the others."""

    def __init__(self, wires: Wires, space: str, others: list[str], period: int, end: int) -> None:
        self.space, self.period, self.end, self.stamp = space, period, end, 0
        self.sources = {other: SignalSource(f"{other}/joint_states", "position", other[1:]) for other in others}
        self.taken: dict[tuple[int, str], float] = {}
        self.dead = False
        self.beside = Beside(Node(wires, space), others, self.restart, self.go_on)  # type: ignore[arg-type]
        self.reset()

    def reset(self) -> None:
        self.beside.begin()
        self.restart()

    def restart(self) -> None:
        self.stamp = 0
        self.taken.clear()
        self.say()

    def say(self) -> None:
        self.beside.say(self.space[1:], self.stamp, float(self.stamp), 0.0, 0.0)

    def go_on(self) -> None:
        while not self.dead and self.stamp < self.end and not self.beside.behind(self.stamp):
            for other, source in self.sources.items():
                self.taken[self.stamp, other] = self.beside.value(source, self.stamp)
            self.stamp += self.period
            self.say()


@pytest.mark.parametrize("seed", range(40))
def test_plants_share_one_time_whatever_comes_when_and_none_waits_for_ever(seed: int) -> None:
    """Periods differ between the axes; at random one is set back, or killed and started again."""
    wires, periods = Wires(seed), {"/a": 2, "/b": 3, "/c": 2}
    draw = wires.random

    def made(space: str) -> Toy:
        return Toy(wires, space, [other for other in periods if other != space], periods[space], 60)

    toys = {space: made(space) for space in periods}
    for _ in range(draw.choice((0, 1, 3))):
        for _ in range(draw.randrange(200)):
            wires.deliver()
        victim = draw.choice(list(toys))
        if draw.random() < 0.5:
            toys[victim].reset()
        else:
            toys[victim].dead = True
            wires.hearing = {topic: [one for one in ears if one[0] != toys[victim].beside._node.number]  # type: ignore[attr-defined]
                             for topic, ears in wires.hearing.items()}
            toys[victim] = made(victim)
    while wires.deliver():
        pass
    for space, toy in toys.items():
        assert toy.stamp == 60, f"{space} stands at {toy.stamp}"
        for (stamp, other), value in toy.taken.items():
            assert value == stamp // periods[other] * periods[other], "the newest that is not later"


class Pair:
    """The loops of both axes, with all that their plants did, by stamp."""

    def __init__(self, together: Callable[..., Any], duration: float, late: bool = False) -> None:
        words = ("-p", f"run_until:={duration}", "-p", "switch3:=true")
        self.graph, self.end = together(*words, nodes=LOOP, axes=BOTH), round(duration * SECOND)
        self.states: dict[str, dict[int, tuple[float, ...]]] = {}
        self.true_velocity: dict[str, dict[int, float]] = {}
        for space in ("/azimuth", "/altitude"):
            self._watch(space, self.graph[f"{space}/plant"])
            if late:
                self._delay(self.graph[f"{space}/plant"])

    def _watch(self, space: str, plant: Any) -> None:
        states = self.states[space] = {}
        velocities = self.true_velocity[space] = {}
        say = plant._surroundings.say

        def hear(stamp: int, position: float, velocity: float, torque: float) -> None:
            simulator = plant._simulator
            states[stamp] = (simulator.measured_position, simulator.measured_velocity, torque)
            velocities[stamp] = velocity
            say(stamp, position, velocity, torque)

        plant._surroundings.say = hear
        hear(0, plant._simulator.position, plant._simulator.velocity, 0.0)

    def _delay(self, plant: Any) -> None:
        """Every other message of the axis beside comes some milliseconds late, in its order."""
        beside, waiting = plant._surroundings._beside, deque[Any]()
        take = beside._take
        count = 0

        def later(*message: Any) -> None:
            waiting.append(message)

        def hand_on() -> None:
            nonlocal count
            count += 1
            if count % 3:
                while waiting:
                    take(*waiting.popleft())

        beside._take = later
        self.graph.driver.create_timer(0.002, hand_on)

    def run(self) -> None:
        plants = [self.graph[f"{space}/plant"] for space in self.states]
        done = lambda: all(plant._stamp >= self.end and plant._command is not None for plant in plants)  # noqa: E731
        assert self.graph.until(done, 60.0), [plant.missing() or plant.waits() for plant in plants]

    def expected_altitude(self, coupled: bool = True) -> list[tuple[float, ...]]:
        """Its motion under the torques that it was given, with what the azimuth did at the same stamps."""
        axis = load_axis(CONFIG / BOTH[1]).axis
        simulator = Simulator(axis, 1e-3, 0, 0.7, ("azimuth_velocity",))
        found = []
        stamps = sorted(self.states["/altitude"])
        for before, stamp in itertools.pairwise(stamps):
            other = self.true_velocity["/azimuth"][before] if coupled else 0.0
            applied = simulator.step(self.states["/altitude"][stamp][2], 20.0, (other,))
            found.append((simulator.measured_position, simulator.measured_velocity, applied))
        return found


@pytest.mark.parametrize("late", [False, True])
def test_coupled_axes_do_the_same_bit_for_bit_whenever_messages_come(together: Callable[..., Any], late: bool) -> None:
    from test_nodes_lockstep import offline

    pair = Pair(together, 0.4, late)
    pair.run()
    states = {space: [values for _, values in sorted(some.items())] for space, some in pair.states.items()}
    assert len(states["/azimuth"]) == len(states["/altitude"]) == 401
    assert states["/altitude"][1:] == pair.expected_altitude()
    assert states["/altitude"][1:] != pair.expected_altitude(coupled=False), "the azimuth acts on it"
    alone = offline("lugre", duration=0.4)
    wanted = list(zip(alone.position, alone.velocity, alone.torque, strict=True))
    assert states["/azimuth"] == wanted, "nothing acts on the azimuth: it does what it does alone"


def test_an_axis_that_is_set_back_begins_anew_with_the_other(together: Callable[..., Any]) -> None:
    pair = Pair(together, 0.2)
    pair.run()
    first = {space: dict(some) for space, some in pair.states.items()}
    for some in pair.states.values():
        some.clear()
    client = pair.graph.driver.create_client(Trigger, "/azimuth/plant/reset")
    answer = pair.graph.result(Waiter(pair.graph.driver).call(client, Trigger.Request(), 20.0))
    assert answer.success
    pair.run()
    assert pair.states == first


def test_an_axis_that_stands_still_is_waited_for_and_one_that_is_not_there_is_missing(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.2", "-p", "time_limit:=0.5", nodes=LOOP, axes=BOTH)
    azimuth, altitude = graph["/azimuth/plant"], graph["/altitude/plant"]
    assert graph.until(lambda: azimuth._stamp == altitude._stamp == altitude._until)
    altitude.set_parameters([Parameter("run_until", value=0.4)])
    assert graph.until(lambda: "/azimuth is at 0.200000 s" in altitude.waits(), 20.0)
    assert altitude.missing() == ""
    assert altitude._stamp == altitude._surroundings._beside._motions["/azimuth"][-1][0] + 1_000_000
    azimuth.destroy_publisher(azimuth._surroundings._beside._publisher)
    azimuth._surroundings._beside._publisher = None
    assert graph.until(lambda: "no /azimuth/simulated_motion within 0.5 s" in altitude.health.problem, 30.0), altitude.health


def test_an_axis_alone_takes_what_nobody_tells_for_0_and_says_so(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.1", "-r", "__ns:=/altitude", axes=BOTH[1:])
    plant = graph["plant"]
    assert graph.until(lambda: plant._stamp >= plant._until and bool(plant.health.warning), 30.0)
    assert plant.health.warning.startswith("taken as 0, since nobody tells it: azimuth_velocity (/azimuth/joint_states velocity")


def test_a_signal_that_its_message_does_not_have_is_refused_and_0(together: Callable[..., Any], tmp_path: Path) -> None:
    text = (CONFIG / BOTH[1]).read_text().replace("field: velocity, joint: azimuth", "field: velocity, joint: dome")
    (tmp_path / "altitude.yaml").write_text(text)
    axes = (BOTH[0], str(tmp_path / "altitude.yaml"))
    graph = together("-p", "run_until:=0.05", nodes=LOOP, axes=axes)
    plant = graph["/altitude/plant"]
    assert graph.until(lambda: plant._stamp >= plant._until, 30.0)
    assert plant.health.refused == 50, "each time"
    assert "/azimuth/joint_states has no number velocity of dome" in plant.health.warning


# Real processes


def positions(caller: Any) -> dict[str, list[float]]:
    """What the axes will have said, by namespace."""
    from sensor_msgs.msg import JointState

    heard: dict[str, list[float]] = {"/azimuth": [], "/altitude": []}
    for space, said in heard.items():

        def listen(message: Any, said: list[float] = said) -> None:
            said.append(message.position[0])

        caller.driver.create_subscription(JointState, f"{space}/joint_states", listen, 100)
    return heard


def test_the_command_runs_two_axes_in_real_time_and_one_begins_by_itself(processes: Any, caller: Any) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    heard, levels = positions(caller), dict[str, bytes]()
    caller.driver.create_subscription(
        DiagnosticArray, "/diagnostics", lambda message: levels.update((s.name, s.level) for s in message.status), 100
    )
    real_time = ("-p", "period:=0.01", "-p", "age_limit:=1.0", "-p", "watchdog:=1.0")
    processes.start_graph(*real_time, options=(*BOTH, "--realtime"), one=True)
    assert caller.until(lambda: min(map(len, heard.values())) > 20, 90.0), processes.log("graph")
    assert caller.call(Trigger, "/altitude/reference/start", Trigger.Request()).success
    assert caller.until(lambda: np.ptp(heard["/altitude"][-50:]) > 3e-4, 30.0), processes.log("graph")
    assert np.ptp(heard["/azimuth"]) < 1e-4, "rests where it is"
    said = processes.log("graph")
    assert "tcs-friction: real time granted: SCHED_FIFO" in said or "real time refused: SCHED_FIFO" in said
    everybody = {f"{space}/{name}" for space in heard for name in GRAPH}
    assert caller.until(lambda: everybody <= set(levels)), sorted(everybody - set(levels))
    assert processes.interrupt("graph") == 0


def test_a_process_that_ends_is_named_with_its_axis() -> None:
    """The second axis' node has an argument that it does not know."""
    axes = {"/azimuth": ["--ros-args"], "/altitude": ["--ros-args", "-p", "no_such:=1"]}
    code = f"from tcs_friction.nodes.graph import run_processes; run_processes({axes!r}, ('dynamometer',))"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60.0, check=False)
    assert "JobError: node /altitude/dynamometer: ended with status 2" in ended.stderr, ended.stderr
    assert "no parameter no_such" in ended.stderr


# One is commissioned while the other moves


def coupled_both_ways(folder: Path) -> tuple[str, str]:
    """The azimuth with a torque from the altitude's acceleration, and the shipped altitude."""
    text = (CONFIG / BOTH[0]).read_text()
    effect = "  effects:\n    - {effect: cross_axis_coupling, parameters: {inertia: 60.0}, signal: altitude_velocity}\n"
    source = "  exogenous: {altitude_velocity: {topic: /altitude/joint_states, field: velocity, joint: altitude}}\n"
    text = text.replace("  effects:\n", effect).replace("signals:\n", f"signals:\n{source}")
    (folder / "azimuth.yaml").write_text(text)
    return str(folder / "azimuth.yaml"), BOTH[1]


def test_one_axis_is_commissioned_while_the_other_moves(together: Callable[..., Any], tmp_path: Path) -> None:
    from tcs_friction_msgs.srv import SetMode

    from tcs_friction.nodes.bags.recorder import RecorderNode
    from tcs_friction.nodes.core.arguments import made_with

    axes = coupled_both_ways(tmp_path)
    run, measure = short_runs(tmp_path)
    (tmp_path / "parameters.yaml").write_text(
        f"/azimuth/commission: {{ros__parameters: {{reference_file: {run}, measure_file: {measure}}}}}\n"
    )
    words = {"results": tmp_path, "diagnoses": 0, "settle": 0.5, "run_until": 0.0, "period": 0.004}
    given = [word for name, value in words.items() for word in ("-p", f"{name}:={value}")]
    graph = together(*given, "--params-file", f"{tmp_path}/parameters.yaml", nodes=GRAPH, axes=axes)
    graph["/altitude/plant"].set_parameters([Parameter("run_until", value=1e6)])
    recorder = made_with(
        RecorderNode, ["--ros-args", "-p", f"bag:={tmp_path}/bag", "-p", f"axis:={axes[0]}"]
    )
    graph.nodes["recorder"] = recorder
    graph.executor.add_node(recorder)
    waiter, client = Waiter(graph.driver), ActionClient(graph.driver, CommissionAction, "commission/commission")
    modes = graph.driver.create_client(SetMode, "/altitude/set_mode")

    async def commission() -> Any:
        assert await waiter.until(client.server_is_ready, 20.0)
        sent = client.send_goal_async(CommissionAction.Goal(directory="out"))
        await waiter.until(sent.done, 20.0)
        finished = sent.result().get_result_async()
        compensating = await waiter.call(modes, SetMode.Request(mode=SetMode.Request.COMPENSATE), 20.0)
        assert compensating.success, "only the azimuth is being commissioned"
        await waiter.until(finished.done, 150.0)
        return finished.result().result

    moved: list[float] = []
    say = graph["/altitude/plant"]._surroundings.say

    def hear(stamp: int, position: float, velocity: float, torque: float) -> None:
        moved.append(position)
        say(stamp, position, velocity, torque)

    graph["/altitude/plant"]._surroundings.say = hear
    result = graph.result(commission(), 200.0)
    assert result.success, result.message
    assert np.ptp(moved) > 1e-3, "the altitude follows its own reference meanwhile"
    assert graph["/altitude/lugre_compensator"].config.switch3
    assert not graph["/altitude/identifier"].config.switch2
    for name in ("before", "measure", "after"):
        topics = {topic.topic for topic in bag_info(tmp_path / "out" / name).topics}
        assert topics == {f"/azimuth/{own}" for own in ("joint_states", "reference", "friction_estimate", "true_friction")}
    recorded = set(recorder.bag.counts)
    assert {"/azimuth/joint_states", "/azimuth/reference", "/altitude/joint_states"} <= recorded
    assert [topic for topic in recorded if not topic.startswith("/azimuth/")] == ["/altitude/joint_states"]
