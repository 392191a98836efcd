"""Real time: stray, wild, stale and contradicting messages move nothing, what is missing is said, torque comes and goes slowly.

The nodes run on one executor, at 100 Hz and with gains for that, so that a busy machine holds the rate.
"""

from __future__ import annotations

import itertools
import math
import signal
import struct
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import wait_until
from rclpy.parameter import Parameter

from tcs_friction.control.joining import Phase
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.health import Health, Judgement, Level
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, TORQUE, UNREADABLE, JointWire

PERIOD = 0.01
SETTINGS = {
    "clock": "real_time",
    "period": PERIOD,
    "position_proportional": 8.0,
    "velocity_proportional": 2.5e4,
    "velocity_integral": 2e5,
    "velocity_delay": 0.0,
    "age_limit": 0.3,  # a busy machine may stand still for a moment
    "watchdog": 0.3,
}
REAL_TIME = tuple(word for name, value in SETTINGS.items() for word in ("-p", f"{name}:={value}"))
LOOP = ("plant", "reference", "lugre_compensator", "dob", "controller")


def running(graph: Any) -> Any:
    """The graph once the reference rests where the axis is and the torque has come."""
    assert graph.until(lambda: graph["controller"]._ramp.value == 1.0 and graph["plant"]._gate.share == 1.0, 20.0), (
        graph["controller"].health.problem
    )
    return graph


class Watch:
    """What goes over the topics from now on."""

    def __init__(self, graph: Any) -> None:
        from sensor_msgs.msg import JointState
        from tcs_friction_msgs.msg import AxisReference, AxisTorque

        from tcs_friction.nodes.core.qos import COLLECT

        self.references: list[tuple[float, ...]] = []
        self.torques: list[float] = []
        self.speeds: list[float] = []
        self._plant = graph["plant"]

        def on_state(_: bytes) -> None:
            self.speeds.append(self._plant._simulator.velocity)

        def on_reference(data: bytes) -> None:
            stamp, numbers = REFERENCE.read(data)
            self.references.append((stamp * 1e-9, *numbers))

        graph.driver.create_subscription(JointState, "joint_states", on_state, COLLECT, raw=True)
        graph.driver.create_subscription(AxisReference, "reference", on_reference, COLLECT, raw=True)
        graph.driver.create_subscription(
            AxisTorque, "torque_command", lambda data: self.torques.append(TORQUE.read(data)[1][0]), COLLECT, raw=True
        )

    def expect_no_jump(self, graph: Any) -> None:
        """The reference has the motion that its limits allow."""
        t, position, speed, acceleration = np.array(self.references).T
        limits = graph["reference"].config
        assert np.abs(speed).max() <= limits.speed_limit
        assert np.abs(acceleration).max() <= limits.acceleration_limit * (1.0 + 1e-9)
        assert np.abs(np.diff(position)).max() <= limits.speed_limit * np.diff(t).max()


def call(graph: Any, kind: Any, name: str, request: Any) -> Any:
    """The answer of a service of the graph."""
    client = graph.driver.create_client(kind, name)
    assert graph.until(client.service_is_ready, 20.0)
    future = client.call_async(request)
    assert graph.until(future.done, 20.0)
    return future.result()


def trigger(graph: Any, name: str) -> Any:
    from std_srvs.srv import Trigger

    return call(graph, Trigger, name, Trigger.Request())


def test_a_programme_begins_on_command_and_from_where_the_axis_is(together: Callable[..., Any]) -> None:
    graph = running(together(*REAL_TIME, "-p", "start_position:=0.02"))
    watch = Watch(graph)
    graph.for_seconds(0.5)
    reference, plant = graph["reference"], graph["plant"]
    assert reference._joined.phase is Phase.REST
    assert plant._simulator.position == pytest.approx(0.02, abs=1e-4)
    answer = trigger(graph, "reference/start")
    assert answer.success
    assert "joins its programme" in answer.message
    assert graph.until(lambda: reference._joined.phase is Phase.RUNNING, 20.0)
    graph.for_seconds(0.5)
    watch.expect_no_jump(graph)
    programme = reference._reference.at(reference._seconds() - reference._joined.programme_time)
    assert reference._joined.at(reference._seconds()) == pytest.approx(programme, abs=1e-6)
    assert plant._simulator.position == pytest.approx(programme[0], abs=2e-3)
    assert trigger(graph, "reference/stop").success
    assert graph.until(lambda: reference._joined.phase is Phase.REST, 20.0)
    assert max(map(abs, watch.speeds)) < graph["controller"].config.velocity_limit


def test_another_reference_file_is_joined_while_the_axis_moves(together: Callable[..., Any]) -> None:
    graph = running(together(*REAL_TIME, "-p", "begin_at_once:=true"))
    reference = graph["reference"]
    assert graph.until(lambda: reference._joined.phase is Phase.RUNNING, 20.0)
    graph.for_seconds(0.5)
    watch = Watch(graph)
    changed = [Parameter("reference_file", value="azimuth_1p2m_measure.yaml")]
    assert reference.set_parameters_atomically(changed).successful
    assert reference._joined.phase is Phase.JOINING
    assert graph.until(lambda: reference._joined.phase is Phase.RUNNING, 20.0)
    watch.expect_no_jump(graph)
    too_fast = [Parameter("reference_file", value=""), Parameter("kind", value="constant_speed")]
    too_fast.append(Parameter("constant_speed.velocity", value=5.0))
    answer = reference.set_parameters_atomically(too_fast)
    assert not answer.successful
    assert "at most speed_limit" in answer.reason


def wild_states(stamp: int, position: float) -> list[bytes]:
    """Joint states that must not count; `stamp` and `position` are those of the newest good one."""
    own, other = JointWire("azimuth"), JointWire("elevation")
    good = own.write(stamp, position, 0.0, 0.0)
    return [
        own.write(0, position, 0.0, 0.0),
        own.write(stamp - 20_000_000, position, 0.0, 0.0),
        own.write((2**31 - 1) * 10**9, position, 0.0, 0.0),
        struct.pack("<4siI", good[:4], 2**31 - 1, 2**32 - 1) + good[12:],
        own.write(stamp + 1, 1e308, 0.0, 0.0),
        own.write(stamp + 2, position + 1.0, 0.0, 0.0),
        own.write(stamp + 3, math.nan, math.nan, math.nan),
        own.write(stamp + 4, position, 1e300, 0.0),
        good[:40],
        bytes(range(1, 80)),
        other.write(stamp - 10**9, 3.0, 1.0, 0.0),
        other.write(stamp + 10**9, 3.0, 1.0, 0.0),
    ]


def test_stray_and_wild_states_move_nothing_and_are_reported(together: Callable[..., Any]) -> None:
    graph = running(together(*REAL_TIME, "-p", "begin_at_once:=true"))
    plant = graph["plant"]
    assert graph.until(lambda: graph["reference"]._joined.phase is Phase.RUNNING, 20.0)
    graph.for_seconds(0.3)
    watch = Watch(graph)
    for k in range(len(wild_states(10**9, 0.0))):
        plant._states.publish(wild_states(plant._stamp, plant._simulator.position)[k])
        graph.for_seconds(0.1)
    for name in ("reference", "controller", "dob"):
        assert graph[name].health.refused >= 9, name
    assert graph["reference"]._joined.phase is Phase.RUNNING, graph["reference"].health.warning
    watch.expect_no_jump(graph)
    assert np.isfinite(watch.torques).all()
    assert max(map(abs, watch.torques)) < 400.0
    assert max(map(abs, watch.speeds)) < 0.01


def test_wild_inputs_of_the_controller_are_refused_and_a_lost_compensation_fades(together: Callable[..., Any]) -> None:
    graph = running(together(*REAL_TIME))
    controller, plant = graph["controller"], graph["plant"]
    for value in (1e300, -1e300, math.nan, 2000.0):
        controller._on_compensation(TORQUE.write(controller._state.stamp, value))
        controller._on_estimate(ESTIMATE.write(controller._state.stamp, 0.0, 0.0, 1e2 * value, True))
        controller._on_reference(REFERENCE.write(controller._state.stamp, 0.0, 0.0, value))
    controller._on_reference(REFERENCE.write(controller._state.stamp, 0.3, 0.0, 0.0))
    controller._on_compensation(b"\x00\x01\x00\x00")
    assert controller.health.refused == 14
    assert any("following_limit" in event for event in controller.health.report(time.monotonic()).values())
    watch = Watch(graph)
    steady = controller._compensation
    assert graph.until(lambda: steady._ramp.value == 1.0, 10.0)
    graph.executor.remove_node(graph["lugre_compensator"])
    graph.for_seconds(0.1)
    used = []
    steady.put(60.0, controller._state.stamp)
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        graph.for_seconds(0.02)
        used.append(steady._value * steady._ramp.value)
    assert used[0] > 50.0
    assert used[-1] == 0.0
    assert max(b - a for a, b in itertools.pairwise(used)) <= 0.0 + 1e-9
    assert any(10.0 < value < 50.0 for value in used), used
    assert max(map(abs, watch.speeds)) < 5e-3
    assert controller._state.stamp <= plant._stamp


def test_internal_state_that_left_the_range_of_numbers_is_reset_with_a_report(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = ("controller", "dob", "lugre_compensator")
    settings = ("switch1:=true", "switch3:=true", "compensator:=false", "observer:=false")
    graph = together(*(word for setting in settings for word in ("-p", setting)), nodes=nodes)
    controller, dob, compensator = (graph[name] for name in nodes)
    for node, core in ((controller, "_pid"), (dob, "_observer"), (compensator, "_lugre")):
        monkeypatch.setattr(getattr(node, core), "step", lambda *_: math.nan)
    state, reference = JointWire("azimuth").write(0, 0.0, 0.0, 0.0), REFERENCE.write(0, 0.0, 0.0, 0.0)
    for node in (controller, dob):
        node._on_state(state)
    for node in (controller, compensator):
        node._on_reference(reference)
    assert TORQUE.read(controller._message)[1] == TORQUE.read(compensator._message)[1] == (0.0,)
    assert ESTIMATE.read(dob._message)[1][0] == 0.0
    assert "left the range of numbers: reset" in controller.health.warning
    assert "observer reset" in dob.health.warning
    assert "compensation reset" in compensator.health.warning


def test_a_lost_compensation_fades_out_of_the_command(together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """The axis stays at its reference, so that the command is the compensation. It stops after three seconds."""
    from tcs_friction.nodes.core import joint_input
    from tcs_friction.nodes.loop import controller as module

    controller = together(*REAL_TIME, "-p", "observer:=false", nodes=["controller"])["controller"]
    commands: list[float] = []

    class Outlet:
        now = 100.0

        def publish(self, data: bytes) -> None:
            commands.append(TORQUE.read(data)[1][0])

        def monotonic(self) -> float:
            return self.now

    outlet = Outlet()
    monkeypatch.setattr(controller, "_publisher", outlet)
    for part in (module, joint_input):
        monkeypatch.setattr(part, "time", outlet)
    for k in range(500):
        outlet.now += PERIOD
        stamp = 10**18 + round(k * PERIOD * 1e9)
        if k % 2:  # answers that overtake their state are used as well
            controller._on_reference(REFERENCE.write(stamp, 0.0, 0.0, 0.0))
        controller._on_state(JointWire("azimuth").write(stamp, 0.0, 0.0, 0.0))
        if not k % 2:
            controller._on_reference(REFERENCE.write(stamp, 0.0, 0.0, 0.0))
        if k < 300:
            controller._on_compensation(TORQUE.write(stamp, 80.0))
    slowest = 80.0 * PERIOD / controller.config.ramp_time
    assert max(abs(b - a) for a, b in itertools.pairwise(commands)) <= slowest * 1.001
    stopped = len(commands) - 200
    assert commands[stopped] == 80.0
    assert commands[stopped + 55] == pytest.approx(40.0, abs=5.0), "age_limit, and half of ramp_time"
    assert commands[-1] == 0.0
    assert controller.health.refused == 0


def test_a_stale_command_is_not_obeyed(together: Callable[..., Any]) -> None:
    graph = together(*REAL_TIME, nodes=["plant"])
    plant = graph["plant"]
    graph.for_seconds(0.3)
    for stamp in (0, plant._stamp - 10**9, plant._stamp + 10**9, plant._stamp + 2 * 10**6, UNREADABLE):
        plant._on_command(TORQUE.write(max(stamp, 0), 500.0))
        graph.for_seconds(0.1)
    assert plant.health.refused == 5
    plant._on_command(TORQUE.write(plant._stamp, 1000.1))
    assert "torque_command (1000.1 N m was refused, the limit is 1000)" in plant.health.report(0.0).values()
    assert plant._simulator.velocity == pytest.approx(0.0, abs=1e-5)
    plant._on_command(TORQUE.write(plant._stamp, 500.0))
    assert graph.until(lambda: plant._simulator.velocity > 1e-4, 5.0)


def test_two_controllers_are_named_and_the_axis_holds_zero_torque(together: Callable[..., Any]) -> None:
    from tcs_friction_msgs.msg import AxisTorque

    graph = running(together(*REAL_TIME))
    plant = graph["plant"]
    publisher = graph.driver.create_publisher(AxisTorque, "torque_command", 10)
    rival = graph.driver.create_timer(0.01, lambda: publisher.publish(TORQUE.write(plant._stamp, 123.0)))
    assert graph.until(lambda: "/azimuth/controller" in plant.health.problem, 20.0)
    assert plant.rivals.topics == {"torque_command"}
    assert "/azimuth/driver" in plant.health.problem
    graph.for_seconds(0.1)
    assert plant._gate.share == 0.0
    applied = []
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        graph.for_seconds(0.02)
        applied.append(plant._torque_at(time.monotonic()))
    assert not any(applied)
    graph.driver.destroy_timer(rival)
    assert graph.until(lambda: not plant.rivals.topics, 20.0)
    assert graph.until(lambda: plant._gate.share == 1.0, 20.0)


def test_two_plants_are_named_and_the_controller_commands_zero_torque(together: Callable[..., Any]) -> None:
    from sensor_msgs.msg import JointState

    graph = running(together(*REAL_TIME))
    controller = graph["controller"]
    publisher = graph.driver.create_publisher(JointState, "joint_states", 10)
    wire = JointWire("azimuth")
    watch = Watch(graph)
    assert graph.until(lambda: controller.count_publishers("joint_states") == 2 and len(watch.torques) > 5, 20.0)
    before = max(map(abs, watch.torques))
    graph.driver.create_timer(0.01, lambda: publisher.publish(wire.write(graph["plant"]._stamp + 1_000_000, 3e-3, 0.0, 0.0)))
    assert graph.until(lambda: "joint_states" in controller.rivals.topics, 20.0)
    heard = len(watch.torques)
    graph.for_seconds(0.3)
    assert "2 publishers of joint_states contradict each other" in controller.health.problem
    assert max(map(abs, watch.torques)) < before + 50.0, "never on a position 3 mrad away"
    assert not any(watch.torques[heard + 2 :])


def test_a_silent_second_controller_is_a_rival_once_it_cannot_be_a_dead_one(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tcs_friction_msgs.msg import AxisTorque

    from tcs_friction.nodes.core import rivals

    monkeypatch.setattr(rivals, "LEASE", 1.0, raising=False)
    graph = running(together(*REAL_TIME))
    plant = graph["plant"]
    second = graph.driver.create_publisher(AxisTorque, "torque_command", 10)
    assert graph.until(lambda: "2 publishers of torque_command: " in plant.health.warning, 5.0)
    assert not plant.rivals.topics
    assert graph.until(lambda: "2 publishers of torque_command, expected one: /azimuth/controller" in plant.health.problem, 5.0)
    assert graph.until(lambda: "two publishers of torque_command" in plant.health.warning, 2.0)
    graph.driver.destroy_publisher(second)
    assert graph.until(lambda: plant._gate.share == 1.0, 20.0)


class Steady:
    """A steady clock that the test moves: what depends on time is then the same on any machine."""

    def __init__(self, plant: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        from tcs_friction.nodes.loop import plant as module

        self.now = plant._began
        self._plant = plant
        monkeypatch.setattr(module, "time", self)
        plant.destroy_timer(plant._timer)

    def monotonic(self) -> float:
        return self.now

    def run(self, periods: int, torque: float | None = None) -> list[float]:
        """The torque that acted in each of some periods, with a command in each or with none."""
        applied = []
        for _ in range(periods):
            self.now += PERIOD
            if torque is not None:
                self._plant._on_command(TORQUE.write(self._plant._stamp, torque))
            self._plant._on_timer()
            applied.append(self._plant._applied)
        return applied


NOISE = 1.0  # N m, four times the plant's torque noise


def test_torque_comes_and_goes_slowly_and_ends_when_commands_end(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = together(*REAL_TIME, nodes=["plant"])["plant"]
    clock = Steady(plant, monkeypatch)
    ramp = 100.0 * PERIOD / plant.config.ramp_time

    def expect_slow(torques: list[float]) -> None:
        assert max(abs(b - a) for a, b in itertools.pairwise(torques)) <= ramp + NOISE

    coming = clock.run(60, 100.0)
    expect_slow([0.0, *coming])
    assert coming[-1] == pytest.approx(100.0, abs=NOISE)
    plant.trigger_deactivate()
    going = clock.run(60, 100.0)
    expect_slow([coming[-1], *going])
    assert going[-1] == pytest.approx(0.0, abs=NOISE)
    plant.trigger_activate()
    expect_slow([going[-1], *clock.run(60, 100.0)])
    held = clock.run(40)
    assert held[28] == pytest.approx(100.0, abs=NOISE)
    assert held[-5:] == pytest.approx([0.0] * 5, abs=NOISE)
    assert "holding zero torque" in plant.health.warning


def test_a_plant_that_is_shut_down_lets_the_torque_go_slowly_and_is_finalized(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from lifecycle_msgs.srv import GetState

    graph = together(*REAL_TIME, nodes=["plant"])
    plant = graph["plant"]
    clock = Steady(plant, monkeypatch)
    ramp = 100.0 * PERIOD / plant.config.ramp_time
    before = clock.run(60, 100.0)[-1]
    plant.trigger_shutdown()
    going = clock.run(60, 100.0)
    assert max(abs(b - a) for a, b in itertools.pairwise([before, *going])) <= ramp + NOISE
    assert going[25] == pytest.approx(50.0, abs=10.0)
    assert going[-1] == pytest.approx(0.0, abs=NOISE)
    assert plant.health.values["life cycle"] == "finalized"
    assert "finalized: no torque until the node is started anew" in plant.health.warning
    assert call(graph, GetState, "plant/get_state", GetState.Request()).current_state.label == "finalized"


def test_no_torque_that_makes_a_fast_axis_faster(together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    plant = together(*REAL_TIME, nodes=["plant"])["plant"]
    clock = Steady(plant, monkeypatch)
    speeds = []
    for _ in range(400):
        clock.run(1, 1000.0)
        speeds.append(plant._simulator.velocity)
    assert 0.08 < max(speeds) <= 0.1
    assert "no torque that way" in plant.health.warning


def test_a_plant_that_was_late_catches_up_or_says_that_the_run_is_void(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = together(*REAL_TIME, nodes=["plant"])["plant"]
    clock = Steady(plant, monkeypatch)
    clock.run(60, 100.0)
    stamp, ticks = plant._stamp, plant._simulator.ticks
    clock.now += 1.5 - PERIOD
    clock.run(1)
    assert plant._stamp - stamp == 1_500_000_000
    assert plant._simulator.ticks - ticks == 150
    assert plant.health.overruns == 1
    assert "void" not in plant.health.warning
    clock.now += 9.0
    clock.run(1)
    assert any("this run is void" in text for text in plant.health.report(clock.now).values())


def test_torque_only_while_active(together: Callable[..., Any]) -> None:
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState, GetState

    graph = running(together(*REAL_TIME, "-p", "begin_at_once:=true"))
    controller, plant = graph["controller"], graph["plant"]

    def change(node: str, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(call(graph, ChangeState, f"{node}/change_state", request).success)

    assert call(graph, GetState, "controller/get_state", GetState.Request()).current_state.label == "active"
    watch = Watch(graph)
    assert change("controller", Transition.TRANSITION_DEACTIVATE)
    assert graph.until(lambda: controller._ramp.value == 0.0, 5.0)
    graph.for_seconds(0.2)
    assert watch.torques[-1] == 0.0 or abs(watch.torques[-1]) <= 1000.0 * PERIOD / 0.5 + 1e-9
    assert "inactive" in controller.health.warning
    silent = len(watch.torques)
    graph.for_seconds(0.3)
    assert len(watch.torques) == silent
    assert change("controller", Transition.TRANSITION_ACTIVATE)
    assert graph.until(lambda: controller._ramp.value == 1.0, 10.0)
    assert change("plant", Transition.TRANSITION_DEACTIVATE)
    graph.for_seconds(0.7)
    assert plant._torque_at(time.monotonic()) == 0.0
    assert change("plant", Transition.TRANSITION_ACTIVATE)
    assert graph.until(lambda: plant._gate.share == 1.0, 10.0)


def test_lock_step_waits_for_a_plant_that_is_activated_later(together: Callable[..., Any]) -> None:
    graph = together("-p", "auto_activate:=false", "-p", "run_until:=0.2")
    graph.for_seconds(0.5)
    assert graph["plant"].health.ticks == 0
    for name in ("controller", "plant"):
        graph[name].trigger_configure()
        graph[name].trigger_activate()
    assert graph.until(lambda: graph["plant"].health.ticks == 200, 20.0)


def test_a_misspelt_parameter_is_an_error(together: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=r"controller: no parameter torque_limmit, expected torque_limit or"):
        together("-p", "torque_limmit:=5.0", nodes=["controller"])


def test_the_clock_does_not_change_while_a_node_runs(together: Callable[..., Any]) -> None:
    node = together(nodes=["controller"])["controller"]
    answer = node.set_parameters([Parameter("clock", value="real_time")])[0]
    assert not answer.successful
    assert "read-only" in answer.reason


def test_another_axis_file_in_real_time_begins_nothing(together: Callable[..., Any]) -> None:
    """It brings limits of its own; a programme begins on command."""
    graph = running(together(*REAL_TIME))
    reference = graph["reference"]
    answer = reference.set_parameters([Parameter("axis", value="azimuth_1p2m.yaml")])[0]
    assert answer.successful, answer.reason
    assert reference.config.clock == "real_time"
    assert reference.config.reference_file.endswith("azimuth_1p2m_run.yaml"), "given at the start, and kept"
    assert reference._joined.phase is Phase.REST
    assert reference.set_parameters([Parameter("reference_file", value="")])[0].successful
    assert reference._joined.phase is Phase.JOINING


def test_a_reference_for_which_there_is_no_way_to_rest_does_not_end_its_node(together: Callable[..., Any]) -> None:
    """Limits of very different size: the planner of ways runs out of digits."""
    limits = ("-p", "acceleration_limit:=31078.270372493276", "-p", "jerk_limit:=483098851.268068")
    wide = ("-p", "largest_speed:=10.0", "-p", "speed_limit:=5.0", "-p", "following_limit:=10.0")
    reference = together(*REAL_TIME, *limits, *wide, nodes=["reference"])["reference"]
    wire, speed = JointWire("azimuth"), -2.766503634891139
    for k in range(80):
        reference._on_state(wire.write(10**9 + k * 10**7, 1188.5004304787155 + speed * 1e-2 * k, speed, 0.0))
        time.sleep(0.01)
    assert reference._state.stamp > 0
    reference._joined.begin_at(reference._seconds(), 1188.5004304787155, speed)
    reference._on_state(wire.write(reference._state.stamp + 10**7, reference._state.position, speed, 0.0))
    assert reference._joined.phase is Phase.REST


def test_without_a_clock_a_node_answers_and_ends(processes: Any, listener: Any) -> None:
    from rcl_interfaces.srv import GetParameters

    processes.start("controller", *REAL_TIME, "-p", "use_sim_time:=true")
    client = listener.node.create_client(GetParameters, "controller/get_parameters")
    assert wait_until(client.service_is_ready, 60.0), processes.log("controller")
    for _ in range(6):  # an answer is lost while the node has not found the client yet
        answer = client.call_async(GetParameters.Request(names=["period"]))
        if wait_until(answer.done, 10.0):
            break
    assert answer.done()
    assert wait_until(lambda: "no /clock" in listener.health.get("controller", (0, ""))[1], 10.0)
    processes._processes["controller"].send_signal(signal.SIGTERM)
    assert wait_until(lambda: not processes.alive("controller"), 10.0)


def test_health_judges_ages_rates_and_overruns() -> None:
    health, limits = Health(), Judgement(period=0.01, age_limit=0.1)
    health.expect("joint_states")
    health.expect("friction_compensation", Level.WARN)
    health.judge(1.0, limits)
    assert health.level() is Level.WARN
    assert "waiting for joint_states" in health.warning
    health.report(1.0)
    for k in range(100):
        if not 40 <= k < 60:
            health.heard("joint_states", 1.0 + 0.01 * k, 0.01)
            health.ticks += 1
    health.judge(2.0, limits)
    assert "joint_states stayed away for 0.210 s" in health.warning
    assert "80 ticks per second instead of 100" in health.warning
    health.report(2.0)
    health.judge(9.0, limits)
    assert health.level() is Level.ERROR
    assert health.problem == "no joint_states for 7.0 s"
    assert "no friction_compensation" in health.warning
    health.heard("joint_states", 9.0)
    health.well("no joint_states")
    assert health.level() is Level.ERROR, "what was wrong since the last report is in it"
    assert "no joint_states" in health.warning
    for k in range(100):
        health.heard("joint_states", 9.0 + 0.03 * k, 0.01)
        health.ticks += 1
    health.report(9.0)
    assert health.level() is Level.WARN, "the compensation is still away"
    health.overruns += 90
    health.ticks += 100
    health.judge(10.0, limits)
    assert "90 overruns" in health.warning
