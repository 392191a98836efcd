"""What users have set stays set when another axis file comes, and messages that come twice or astray keep no node deaf."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import wait_until
from rclpy.parameter import Parameter, parameter_value_to_python

from tcs_friction.config import load_axis, save_axis
from tcs_friction.errors import InputError
from tcs_friction.nodes.loop.gate import torque_limits

CONFIG = Path(__file__).resolve().parents[2] / "config"
GIVEN = {"travel_to": 0.5, "travel_margin": 0.1, "watchdog": 0.25, "period": 0.005, "ramp_time": 0.2}
TICK = 5_000_000  # ns


@pytest.fixture
def other_axis(tmp_path: Path) -> Path:
    """An axis file with limits of its own."""
    content = yaml.safe_load((CONFIG / "azimuth_1p2m.yaml").read_text())
    content["control"]["limits"] = {"travel_from": -4.7, "travel_to": 4.7, "watchdog": 0.05, "state_limit": 0.06}
    content["control"]["controller"]["torque_limit"] = 400.0
    path = tmp_path / "other.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_an_axis_file_states_limits_and_keeps_them(other_axis: Path, tmp_path: Path) -> None:
    limits = torque_limits(load_axis(other_axis))
    assert (limits.travel_from, limits.travel_to, limits.watchdog, limits.state_limit) == (-4.7, 4.7, 0.05, 0.06)
    assert (limits.torque_limit, limits.overspeed) == (400.0, pytest.approx(0.09)), "what is not stated is implied as ever"
    save_axis(tmp_path / "again.yaml", load_axis(other_axis))
    assert load_axis(tmp_path / "again.yaml") == load_axis(other_axis)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"travel_too": 1.0}, "control: limits: unknown key 'travel_too'"),
        ({"travel_from": 1.0, "travel_to": 0.0}, "travel_from is 1, expected at most travel_to"),
        ({"watchdog": -1.0}, "watchdog is -1, expected a number from 0.001"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(other_axis: Path, limits: dict[str, float], words: str) -> None:
    content = yaml.safe_load(other_axis.read_text())
    content["control"]["limits"] = limits
    other_axis.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=words):
        load_axis(other_axis)


def test_what_was_given_wins_over_an_axis_file_that_comes_later(processes: Any, listener: Any, other_axis: Path) -> None:
    from rcl_interfaces.srv import GetParameters, SetParameters

    words = [word for name, value in GIVEN.items() for word in ("-p", f"{name}:={value}")]
    processes.start("plant", "-p", "clock:=real_time", *words)
    setting = listener.node.create_client(SetParameters, "plant/set_parameters")
    getting = listener.node.create_client(GetParameters, "plant/get_parameters")
    assert wait_until(setting.service_is_ready, 40.0), processes.log("plant")

    def call(client: Any, request: Any) -> Any:
        future = client.call_async(request)
        assert wait_until(future.done, 20.0)
        return future.result()

    def put(**values: Any) -> Any:
        changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return call(setting, SetParameters.Request(parameters=changes)).results

    assert put(temperature=5.0)[0].successful
    assert put(axis=str(other_axis))[0].successful
    wanted = GIVEN | {"temperature": 5.0, "travel_from": -4.7, "state_limit": 0.06, "torque_limit": 400.0}
    answer = call(getting, GetParameters.Request(names=list(wanted)))
    assert dict(zip(wanted, map(parameter_value_to_python, answer.values), strict=True)) == wanted
    assert put(axis="azimuth_1p2m.yaml")[0].successful
    answer = call(getting, GetParameters.Request(names=list(wanted)))
    there = dict(zip(wanted, map(parameter_value_to_python, answer.values), strict=True))
    assert there == GIVEN | {"temperature": 5.0, "travel_from": -1e9, "state_limit": 0.1, "torque_limit": 1000.0}


def test_what_was_identified_is_of_the_axis_and_goes_with_it(together: Callable[..., Any], other_axis: Path) -> None:
    graph = together("-p", "positive.coulomb:=70.0", nodes=["lugre_compensator"])
    node = graph["lugre_compensator"]
    assert node.set_parameters([Parameter("axis", value=str(other_axis))])[0].successful
    assert node.config.positive.coulomb == 70.0
    assert node.replace_given({"positive.coulomb": 60.0}).successful
    assert node.set_parameters([Parameter("axis", value="azimuth_1p2m.yaml")])[0].successful
    assert node.config.positive.coulomb == 78.1


@pytest.mark.parametrize("faults", ["doubled", "swapped", "stray"])
def test_messages_that_come_twice_late_or_astray_are_answered(processes: Any, listener: Any, faults: str) -> None:
    """The reference answers a driver's states; every 20th comes twice, after its successor, or with a stamp of before."""
    from sensor_msgs.msg import JointState
    from tcs_friction_msgs.msg import AxisReference

    from tcs_friction.nodes.core.qos import COLLECT, PUBLISH
    from tcs_friction.nodes.core.wire import JointWire

    wire, answered = JointWire("azimuth"), []
    states = listener.node.create_publisher(JointState, "joint_states", PUBLISH)
    listener.node.create_subscription(AxisReference, "reference", lambda m: answered.append(m), COLLECT)
    processes.start("reference", "-p", "clock:=real_time", "-p", "period:=0.005", "-p", "age_limit:=0.3")
    assert wait_until(lambda: states.get_subscription_count() > 1, 40.0), processes.log("reference")  # the listener is one
    sent, end = 0, time.monotonic() + 20.0
    held: list[int] = []
    while len(answered) < 100 and time.monotonic() < end:
        stamps = [now := listener.node.get_clock().now().nanoseconds]
        if sent % 20 == 19:
            stamps = {"doubled": [now, now], "swapped": [], "stray": [now, now - 30_000_000_000]}[faults]
        stamps += held
        held = [] if stamps else [now]
        for stamp in stamps:
            states.publish(wire.write(stamp, 0.1, 0.0, 0.0))
        sent += 1
        time.sleep(0.005)
    assert len(answered) >= 100, (sent, processes.log("reference"))


def test_what_is_heard_and_not_believed_is_named(together: Callable[..., Any]) -> None:
    from tcs_friction.nodes.core.wire import JointWire

    wire = JointWire("azimuth")
    graph = together("-p", "clock:=real_time", "-p", "time_limit:=0.5", nodes=["reference"])
    node = graph["reference"]
    now = graph.driver.get_clock().now().nanoseconds
    for k in range(400):
        node._on_state(wire.write(now + k * TICK, 0.1 * (k % 2), 0.0, 0.0))  # two positions in turns
    node.health._begun = -100.0
    node._judge(time.monotonic())
    assert "no joint_states: heard and not believed (step of 0.1" in node.health.problem + node.health.warning
