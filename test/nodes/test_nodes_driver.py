"""Drivers of every kind in place of the plant: what they leave out is made up for or named, in the log and in diagnostics."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisTorque, FrictionEstimate

from tcs_friction.config import load_axis, shipped
from tcs_friction.nodes.core.joint_states import judge
from tcs_friction.physics.simulate import Simulator

REAL_TIME = ("-p", "clock:=real_time", "-p", "period:=0.01", "-p", "switch1:=true")


class Motor:
    """The simulated axis as somebody's motor; what it was told last is kept."""

    def __init__(self, period: float) -> None:
        self._simulator, self.told = Simulator(load_axis(shipped("azimuth_1p2m.yaml")).axis, period), [0.0]

    def move(self, torque: float) -> tuple[float, float, float]:
        self.told.append(torque)
        applied = self._simulator.step(torque)
        return self._simulator.measured_position, self._simulator.measured_velocity, applied


def test_the_driver_of_the_documentation_drives(together: Callable[..., Any]) -> None:
    """It tracks with the torque that is commanded; without commands, and with those of two, there is none."""
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/drivers.md").read_text(), re.DOTALL)
    content: dict[str, Any] = {}
    exec(compile(code, "docs/drivers.md", "exec"), content)
    period = content["PERIOD"]
    graph = together("-p", "clock:=real_time", "-p", f"period:={period}", nodes=["reference", "lugre_compensator", "controller"])
    motor = Motor(period)
    driver = graph.nodes["plant"] = content["Driver"](motor)
    graph.executor.add_node(driver)
    assert graph.until(lambda: sum(map(bool, motor.told[-20:])) == 20, 20.0), graph["controller"].health.warning
    assert graph["controller"]._told == (content["SPEED_LIMIT"], content["TORQUE_LIMIT"])
    rival = graph.driver.create_publisher(AxisTorque, "torque_command", 10)
    assert graph.until(lambda: not any(motor.told[-20:]), 10.0), "two publishers"
    graph.driver.destroy_publisher(rival)
    assert graph.until(lambda: sum(map(bool, motor.told[-20:])) == 20, 20.0)
    graph["controller"].trigger_deactivate()
    assert graph.until(lambda: not any(motor.told[-20:]), 10.0), "nobody commands"


class Driver:
    """Publishes an axis that turns at 0.01 rad/s, 100 times a second."""

    def __init__(self, graph: Any, profile: QoSProfile | int = 10, **fields: list[Any]) -> None:
        self.graph, self.fields = graph, fields
        self.publisher = graph.driver.create_publisher(JointState, "joint_states", profile)
        self.estimates: list[FrictionEstimate] = []
        self.reports: dict[str, Any] = {}
        graph.driver.create_subscription(FrictionEstimate, "friction_estimate", self.estimates.append, 100)
        graph.driver.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 100)
        graph.driver.create_timer(0.01, self._publish)

    def _publish(self) -> None:
        message = JointState(name=["azimuth"], position=[0.01 * (time.time() % 100.0)], velocity=[0.01], effort=[40.0])
        for name, value in self.fields.items():
            setattr(message, name, value)
        message.header.stamp = self.graph.driver.get_clock().now().to_msg()
        self.publisher.publish(message)

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name.rpartition("/")[2]] = status

    def says(self, node: str) -> str:
        """Everything in the last report of a node."""
        status = self.reports.get(node)
        return f"{status.message} {[f'{item.key}={item.value}' for item in status.values]}" if status else ""


def test_a_driver_that_reports_everything_is_complete(together: Callable[..., Any]) -> None:
    driver = Driver(together(*REAL_TIME, nodes=["dob"]))
    assert driver.graph.until(lambda: len(driver.estimates) > 50 and "dob" in driver.reports)
    assert "driver" not in driver.says("dob")
    assert driver.reports["dob"].hardware_id == "azimuth"
    assert driver.estimates[-1].valid


def test_speed_is_derived_where_a_driver_gives_none(together: Callable[..., Any]) -> None:
    driver = Driver(together(*REAL_TIME, nodes=["dob", "controller"]), velocity=[])
    assert driver.graph.until(lambda: all("no velocity, derived" in driver.says(name) for name in ("dob", "controller")))
    assert driver.graph.until(lambda: len(driver.estimates) > 20)
    speeds = [estimate.velocity for estimate in driver.estimates[5:]]
    assert sum(speeds) / len(speeds) == pytest.approx(0.01, rel=0.2)


def test_the_command_is_taken_for_the_effort_that_a_driver_does_not_give(together: Callable[..., Any]) -> None:
    graph = together(*REAL_TIME, "-p", "compensator:=false", nodes=["dob", "identifier"])
    driver = Driver(graph, effort=[])
    commands = graph.driver.create_publisher(AxisTorque, "torque_command", 10)

    def command() -> None:
        message = AxisTorque(torque=30.0)
        message.header.stamp = graph.driver.get_clock().now().to_msg()
        commands.publish(message)

    graph.driver.create_timer(0.01, command)
    assert graph.until(lambda: "no effort, torque_command is taken for it" in driver.says("dob"))
    assert graph.until(lambda: bool(driver.estimates) and abs(driver.estimates[-1].torque - 30.0) < 3.0, 20.0)
    assert graph.until(lambda: len(graph["identifier"]._live) > 20)
    graph.for_seconds(0.5)
    assert graph["identifier"]._live.recording().torque[-1] == 30.0


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": ["joint_1"]}, "joint_states name joint_1, expected azimuth"),
        ({"name": [], "position": [0.0, 1.0]}, "joint_states hold 2 joints and name none, expected azimuth"),
        ({"position": []}, "joint_states without a position of azimuth"),
    ],
)
def test_what_makes_a_driver_useless_is_named(
    together: Callable[..., Any], fields: dict[str, list[Any]], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    driver = Driver(together(*REAL_TIME, nodes=["controller"]), **fields)
    assert driver.graph.until(lambda: words in driver.says("controller"))
    driver.graph.for_seconds(2.2)
    log = capfd.readouterr().err
    assert log.count(words) == 1, "once, and throttled"


def test_messages_of_another_joint_are_no_fault_of_the_own_ones(together: Callable[..., Any]) -> None:
    """Each joint has a driver of its own on one topic; what is said is said of the own one."""
    watch = together(*REAL_TIME, nodes=["dob"])["dob"]._driver
    own = serialize_message(JointState(name=["azimuth"], position=[0.0]))
    other = serialize_message(JointState(name=["elevation"], position=[0.0]))
    for _ in range(2):
        for data in (other, own, other):
            watch._hear(data)
        found = watch.judge("azimuth")
        assert (found.useless, len(found.served)) == ("", 2)
    watch._hear(other)
    assert watch.judge("azimuth").useless == "joint_states name elevation, expected azimuth"


def test_a_driver_that_publishes_best_effort_is_heard(together: Callable[..., Any]) -> None:
    profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    driver = Driver(together(*REAL_TIME, nodes=["dob"]), profile)
    assert driver.graph.until(lambda: len(driver.estimates) > 20, 15.0)
    assert driver.graph.until(lambda: "best effort" in driver.says("dob"))


def test_another_rate_is_named_by_one_node(together: Callable[..., Any]) -> None:
    driver = Driver(together(*REAL_TIME, "-p", "period:=0.005", nodes=["dob", "controller"]))
    assert driver.graph.until(lambda: "period is 0.005 s" in driver.says("controller"), 20.0), driver.says("controller")
    assert "period is" not in driver.says("dob")


def test_the_joint_is_found_wherever_it_stands() -> None:
    message = JointState(name=["elevation", "azimuth"], position=[1.0, 2.0], velocity=[0.0, 0.0], effort=[1.0])
    assert judge(message, "azimuth").served == ("no effort, torque_command is taken for it",)
    assert judge(message, "elevation") == judge(JointState(position=[1.0], velocity=[0.0], effort=[0.0]), "any")
    many = JointState(name=[f"joint_{k}" for k in range(20_000)])
    assert len(judge(many, "azimuth").useless) < 100
