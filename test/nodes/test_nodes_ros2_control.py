"""The driver for ros2_control beside a stand-in for a robot: what it passes on, what takes the torque away, and its ends.

The robot is always a process of its own. Faults are its parameters; what acts on its joints is on /robot/applied.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, wait_until

from benchmarks.listening import Listening
from tcs_friction.errors import InputError

PERIOD = 0.02  # s: a busy machine keeps up with that
ARGUMENTS = [
    word
    for name, value in {
        "clock": "real_time", "period": PERIOD, "watchdog": 0.3, "age_limit": 0.3, "state_limit": 0.3,
        "ramp_time": 0.2, "stop_time": 0.2, "others": "['elbow=7']",
    }.items()
    for word in ("-p", f"{name}:={value}")
]  # fmt: skip
BRAKES = (78.1 * 0.99 - 0.5 - 4.0 * 0.25) / 1000.0
"""rad/s^2 at least, without torque: Coulomb friction by inertia; against it its asymmetry, cogging and the drive's noise."""
BRISTLE = 117.2 / 2.96e5
"""rad by which an axis that comes to rest can spring back at most."""
SWITCH = "effort_controller is inactive: ros2 control switch_controllers --activate effort_controller"


class Robot:
    """The stand-in, its faults, and a controller that answers every state of the driver with a torque."""

    def __init__(self, node: Any, until: Callable[..., bool], torque: float, *arguments: str) -> None:
        from rcl_interfaces.srv import SetParameters
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray
        from tcs_friction_msgs.msg import AxisTorque

        from tcs_friction.nodes.core.qos import LISTEN, PUBLISH
        from tcs_friction.nodes.core.wire import TORQUE, JointWire

        self.torque: float | None = torque
        self.applied: list[list[float]] = [[0.0] * 3]
        self.states: list[tuple[float, ...]] = []
        self.stamps: set[int] = set()
        self._until, self._request = until, SetParameters.Request
        self._robot_wire, self._wire, self._command = JointWire("azimuth"), JointWire("azimuth"), TORQUE
        self._commands = node.create_publisher(AxisTorque, "torque_command", PUBLISH)
        node.create_subscription(JointState, "joint_states", self._on_state, LISTEN, raw=True)
        node.create_subscription(JointState, "/joint_states", self._on_robot, LISTEN, raw=True)
        node.create_subscription(Float64MultiArray, "/robot/applied", lambda m: self.applied.append(list(m.data)), 100)
        self._client = node.create_client(SetParameters, "/robot/set_parameters")
        env = os.environ | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}
        command = [sys.executable, "-m", "benchmarks.simulated_robot", "--ros-args", "-p", f"period:={PERIOD}", *arguments]
        self._process = subprocess.Popen(command, env=env)

    @property
    def now(self) -> list[float]:
        """Effort on elbow, azimuth and wrist."""
        return self.applied[-1]

    def acts(self, torque: float) -> bool:
        """Whether this acts on the axis, and on the others what they are to keep."""
        elbow, axis, wrist = self.now
        return abs(axis - torque) < 0.5 and (elbow, wrist) == (7.0, 0.0)

    def rests(self) -> bool:
        """Whether the axis has stood still, without torque, for 50 states."""
        return len(self.states) > 100 and all(abs(speed) < 1e-3 and not torque for _, _, speed, torque in self.states[-50:])

    def set(self, **values: Any) -> None:
        """Faults begin or end."""
        from rclpy.parameter import Parameter

        assert self._until(self._client.service_is_ready, 20.0)
        changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        answer = self._client.call_async(self._request(parameters=changes))
        assert self._until(answer.done, 20.0)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(10.0)

    def _on_state(self, data: bytes) -> None:
        self.states.append(self._wire.read(data))
        if self.torque is not None:
            self._commands.publish(self._command.write(int(self.states[-1][0]), self.torque))

    def _on_robot(self, data: bytes) -> None:
        self.stamps.add(self._robot_wire.read(data)[0])


@pytest.fixture
def beside(together: Callable[..., Any]) -> Iterator[Callable[..., tuple[Any, Any, Robot]]]:
    """Makes the driver in this process and a robot beside it: the graph, the driver, the robot."""
    made: list[Robot] = []

    def make(*arguments: str, robot: tuple[str, ...] = ()) -> tuple[Any, Any, Robot]:
        graph = together(*ARGUMENTS, *arguments, nodes=["ros2_control_driver"])
        made.append(Robot(graph.driver, graph.until, 40.0, *robot))  # less than friction: the axis rests
        return graph, graph["ros2_control_driver"], made[0]

    yield make
    for item in made:
        item.close()


def reactivate(driver: Any) -> None:
    """As somebody does who has mended something."""
    driver.trigger_deactivate()
    driver.trigger_activate()


def test_a_joint_is_found_moved_and_let_go(beside: Callable[..., tuple[Any, Any, Robot]]) -> None:
    graph, driver, robot = beside(robot=("-p", "active:=false"))
    assert graph.until(lambda: driver.hardware.waits == SWITCH, 20.0), driver.hardware.waits
    assert robot.now == [3.0, 0.0, 0.0], "nothing has been commanded"
    robot.set(active=True)
    assert graph.until(lambda: robot.acts(40.0), 10.0), (driver.hardware.fault, driver.hardware.waits)
    assert any(1.0 < axis < 39.0 for _, axis, _ in robot.applied), "it came over the ramp time"
    assert driver.health.values["limits"].startswith("150 N m, 0.09 rad/s, -0.5 to 0.5 rad; URDF: friction 60 N m")
    assert {int(state[0]) for state in robot.states[-50:]} <= robot.stamps

    robot.set(order=["elbow", "azimuth", "wrist"], nan_effort=True)
    count = len(robot.states)
    assert graph.until(lambda: len(robot.states) > count + 100, 10.0)
    assert max(abs(state[1]) for state in robot.states[-50:]) < 0.01, "the axis' position, not the 0.25 rad of the others"
    sent = [40.0] * 50  # which is taken for what the robot does not tell
    assert graph.until(lambda: [state[3] for state in robot.states[-50:]] == sent, 10.0), robot.states[-1]
    assert graph.until(lambda: robot.acts(40.0), 10.0)

    robot.torque = 150.5
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    assert "150.5 N m was refused, the limit is 150" in " ".join([*driver.health._events, driver.health.warning])
    robot.torque = 40.0
    assert graph.until(lambda: robot.acts(40.0), 10.0)
    robot.torque = None
    assert graph.until(lambda: robot.acts(0.0), 10.0), "no commands"
    robot.torque = 40.0
    assert graph.until(lambda: robot.acts(40.0), 10.0)
    driver.trigger_deactivate()
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    assert graph.until(lambda: driver.hardware._command is None, 10.0), "others may command now"


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_the_period_of_the_states_is_found_although_some_are_late_or_lost(lost: float) -> None:
    from tcs_friction.nodes.drivers.ros2_control import PERIOD_SHARE, state_period

    random = np.random.default_rng(5)
    for _ in range(200):
        stamps = PERIOD * np.arange(200.0) + random.exponential(0.1 * PERIOD, 200)  # late by a tenth on the average
        kept = np.diff(stamps[random.random(200) >= lost])[:50]
        assert abs(state_period(list(kept), PERIOD) - PERIOD) < PERIOD_SHARE * PERIOD


@pytest.mark.parametrize("lost", [0.0, 0.3])
@pytest.mark.parametrize("wrong", [0.2, 0.5, 0.8, 1.25, 1.6, 2.0, 3.0, 10.0])
def test_another_period_than_the_wanted_one_is_found(wrong: float, lost: float) -> None:
    from tcs_friction.nodes.drivers.ros2_control import PERIOD_SHARE, state_period

    random = np.random.default_rng(5)
    for _ in range(200):
        stamps = wrong * PERIOD * (np.arange(200.0) + random.exponential(0.02, 200))
        kept = np.diff(stamps[random.random(200) >= lost])[:50]
        assert abs(state_period(list(kept), PERIOD) - PERIOD) > PERIOD_SHARE * PERIOD


def test_states_that_are_lost_late_swapped_or_missing(beside: Callable[..., tuple[Any, Any, Robot]]) -> None:
    graph, driver, robot = beside()
    assert graph.until(lambda: robot.acts(40.0), 20.0), (driver.hardware.fault, driver.hardware.waits)
    robot.set(lost=0.3)
    count = len(robot.states)
    assert graph.until(lambda: len(robot.states) > count + 100, 10.0)
    assert graph.until(lambda: robot.acts(40.0), 10.0), (driver.hardware.fault, driver.hardware.waits)
    robot.set(lost=0.0, late=0.5)
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    assert graph.until(lambda: any("older than 0.3 s when they come" in text for text in driver.health._events), 10.0)
    robot.set(late=0.0)
    assert graph.until(lambda: robot.acts(40.0), 10.0)
    robot.set(silent=True)
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    assert "no position for 0.3 s" in driver.health.warning
    robot.set(silent=False)
    assert graph.until(lambda: robot.acts(40.0), 10.0)
    robot.set(swapped=True)
    assert graph.until(lambda: "come every 0.0" in driver.health.warning, 10.0), "every second one comes too late"
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    robot.set(swapped=False)
    assert graph.until(lambda: robot.acts(40.0), 10.0), "it comes back by itself"
    stamps = [state[0] for state in robot.states]
    assert stamps == sorted(set(stamps))


def test_a_controller_that_is_switched_off_or_commanded_by_others(beside: Callable[..., tuple[Any, Any, Robot]]) -> None:
    from std_msgs.msg import Float64MultiArray

    graph, driver, robot = beside()
    assert graph.until(lambda: robot.acts(40.0), 20.0), (driver.hardware.fault, driver.hardware.waits)
    robot.set(active=False)
    assert graph.until(lambda: SWITCH in driver.health.problem, 10.0)
    assert robot.acts(40.0), "the hardware keeps it while nobody writes: as the sources say"
    robot.set(active=True)
    assert graph.until(lambda: robot.acts(0.0), 10.0)
    graph.for_seconds(0.5)
    assert robot.acts(0.0)
    assert "activate the node again" in driver.health.problem
    reactivate(driver)
    assert graph.until(lambda: robot.acts(40.0), 10.0)

    rival = graph.driver.create_publisher(Float64MultiArray, "/effort_controller/commands", 10)
    graph.for_seconds(0.5)
    assert graph.until(lambda: robot.acts(40.0), 10.0), "another publisher that is silent is none"
    timer = graph.driver.create_timer(0.02, lambda: rival.publish(Float64MultiArray(data=[1.0, 2.0])))
    assert graph.until(lambda: "somebody else commands /effort_controller/commands" in driver.health.problem, 10.0)
    assert graph.until(lambda: "the controller keeps their 2 N m" in driver.health.problem, 10.0)
    graph.for_seconds(0.4)
    assert robot.now == [1.0, 2.0, 0.0], "the robot is left to them"
    graph.driver.destroy_timer(timer)
    assert graph.until(lambda: robot.acts(0.0), 10.0), "nothing of theirs stays"
    assert graph.until(lambda: "their 2 N m was replaced by zero" in driver.health.problem, 10.0)
    rival.publish(Float64MultiArray(data=[1.0, 3.0]))
    assert graph.until(lambda: "their 3 N m was replaced by zero" in driver.health.problem, 10.0)
    assert graph.until(lambda: robot.acts(0.0), 10.0), "nor of what comes later"
    reactivate(driver)
    assert graph.until(lambda: robot.acts(40.0), 10.0)


def test_a_rivals_torque_ends_with_it_and_at_once_where_the_axis_is_too_fast(processes: Any) -> None:
    """As `ros2 topic pub` does it: 130 N m, more than friction, for a second, and the node is a process of its own."""
    from std_msgs.msg import Float64MultiArray

    ears = Listening("commander")
    robot = Robot(ears.node, wait_until, 40.0)
    positions: list[float] = []
    ears.begin()
    try:
        rival = ears.node.create_publisher(Float64MultiArray, "/effort_controller/commands", 10)
        processes.start("ros2_control_driver", *ARGUMENTS, "-p", "overspeed:=0.01")
        assert wait_until(lambda: robot.acts(40.0), 40.0), processes.log("ros2_control_driver")
        begun, end = len(robot.applied), time.monotonic() + 1.0
        while time.monotonic() < end:
            rival.publish(Float64MultiArray(data=[7.0, 130.0]))
            positions.append(robot.states[-1][1])
            time.sleep(PERIOD)
        assert wait_until(lambda: robot.acts(0.0), 10.0), "theirs is gone"
        assert max(state[2] for state in robot.states) < 0.03, "0.13 rad/s without anybody who ends it"
        heard = [axis for _, axis, _ in robot.applied[begun:]]
        zero = heard.index(0.0, heard.index(130.0))
        assert 130.0 in heard[zero:], "zero while they still command: the axis was too fast"
        assert wait_until(robot.rests, 10.0)
        free = 1 + max(k for k, state in enumerate(robot.states) if state[3] != 0.0)
        _, position, speed, _ = robot.states[free]
        rests = robot.states[-1][1]
        assert abs(rests - position) < speed**2 / (2.0 * BRAKES) + BRISTLE, "nothing but friction acts"
        assert max(abs(state[1] - rests) for state in robot.states[-50:]) < 1e-3, "it stays there"
        assert wait_until(lambda: "their 130 N m was replaced by zero" in processes.log("ros2_control_driver"), 5.0)
        assert "somebody else commands /effort_controller/commands" in processes.log("ros2_control_driver")
    finally:
        ears.close()
        robot.close()


def test_the_controller_keeps_within_the_limits_of_the_robot(processes: Any) -> None:
    """URDF: 40 N m and 0.08 rad/s, axis file: 1000 N m and 0.1 rad/s. A demand for more gets 40 N m, not nothing."""
    from tcs_friction_msgs.msg import AxisReference

    from tcs_friction.nodes.core.qos import PUBLISH
    from tcs_friction.nodes.core.wire import REFERENCE

    ears = Listening("commander")
    robot = Robot(ears.node, wait_until, 40.0, "-p", "effort_limit:=40.0")
    robot.torque = None
    references = ears.node.create_publisher(AxisReference, "reference", PUBLISH)
    ears.begin()
    try:
        processes.start("ros2_control_driver", *ARGUMENTS)
        alone = ("-p", "compensator:=false", "-p", "observer:=false", "-p", "following_limit:=1.0")
        processes.start("controller", *ARGUMENTS[:-2], *alone)
        assert wait_until(lambda: len(robot.states) > 20, 40.0), processes.log("ros2_control_driver")
        end = time.monotonic() + 20.0
        while time.monotonic() < end and not robot.acts(40.0):  # 0.2 rad away: the speed loop wants 14 kN m
            references.publish(REFERENCE.write(int(robot.states[-1][0]), robot.states[-1][1] + 0.2, 0.0, 0.0))
            time.sleep(PERIOD / 2)
        assert robot.acts(40.0), (robot.now, processes.log("controller"))
        assert "limits: 40 N m, 0.09 rad/s, where the driver's are smaller" in processes.log("controller")
        assert "was refused, the limit is" not in processes.log("ros2_control_driver")
    finally:
        ears.close()
        robot.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-p", "others:=['elbow']"), "parameter others: 'elbow', expected JOINT=EFFORT"),
        (("-r", "__ns:=/"), "namespace: that of the robot's joint_states, expected one of the axis' own"),
        (("-p", "urdf:=nowhere.urdf"), "nowhere.urdf: cannot be read"),
        (("-p", "clock:=lock_step"), "clock: lock_step, expected real_time"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused(together: Callable[..., Any], words: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        together(*ARGUMENTS, *words, nodes=["ros2_control_driver"])


def test_descriptions_and_controllers_that_cannot_be_used_are_named(together: Callable[..., Any]) -> None:
    from rclpy.parameter import Parameter
    from std_msgs.msg import String

    graph = together(*ARGUMENTS, nodes=["ros2_control_driver"])
    driver = graph["ros2_control_driver"]
    driver.hardware._look()
    assert driver.hardware.waits.startswith("no /robot_description yet")
    description = '<robot><joint name="azimuth" type="{}"><limit effort="20" velocity="2" lower="-1" upper="1"/></joint></robot>'
    driver._on_description(String(data=description.format("prismatic")))
    assert "URDF of joint azimuth: a linear joint, expected a rotary one" in driver.health.problem
    driver._on_description(String(data=description.format("revolute")))
    assert not driver.health.problem
    assert driver.health.values["limits"].startswith("20 N m, 0.09 rad/s, -1 to 1 rad")
    assert not driver.set_parameters([Parameter("travel_from", value=1.5)])[0].successful
    assert driver.set_parameters([Parameter("torque_limit", value=10.0)])[0].successful
    assert driver.health.values["limits"].startswith("10 N m")
    driver.hardware._look()
    assert driver.hardware.waits == "/effort_controller does not tell its joints (parameter service): is it loaded?"


def test_the_last_thing_a_driver_sends_is_zero_unless_it_is_killed(processes: Any) -> None:
    ears = Listening("commander")
    robot = Robot(ears.node, wait_until, 40.0)
    ears.begin()
    try:
        processes.start("ros2_control_driver", *ARGUMENTS)
        assert wait_until(lambda: robot.acts(40.0), 40.0), processes.log("ros2_control_driver")
        processes.kill("ros2_control_driver")
        count = len(robot.applied)
        assert wait_until(lambda: len(robot.applied) > count + 100)
        kept = {axis for _, axis, _ in robot.applied[-50:]}
        assert len(kept) == 1, "nobody ends it: that is why the drive needs a watchdog"
        assert min(kept) > 1.0
        assert "if this node is killed, the controller keeps the last torque" in processes.log("ros2_control_driver")
        processes.start("ros2_control_driver", *ARGUMENTS)
        assert wait_until(lambda: abs(robot.now[1]) < 39.0, 40.0), "a new one begins at zero"
        assert wait_until(lambda: robot.acts(40.0), 10.0)
        count = len(robot.applied)
        processes._processes["ros2_control_driver"].send_signal(signal.SIGTERM)
        assert wait_until(lambda: not processes.alive("ros2_control_driver"), 20.0)
        assert wait_until(lambda: robot.acts(0.0), 5.0)
        assert sum(1.0 < axis < 39.0 for _, axis, _ in robot.applied[count:]) > 5, "over the stop time"
    finally:
        ears.close()
        robot.close()
