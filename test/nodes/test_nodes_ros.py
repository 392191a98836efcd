"""`./tcs ros` over the middleware, on a graph in a process of its own: the words and the output of `ros2`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import ROOT, wait_until
from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisTorque
from tcs_friction_msgs.srv import SetMode

from tcs_friction.cli import main
from tcs_friction.commands import ros as command
from tcs_friction.commands.parser import parser_of
from tcs_friction.errors import InputError
from tcs_friction.nodes.ros.interface_values import as_yaml, from_yaml, interface, plain

KINDS = "|".join(command.VERBS)
RECIPE = re.compile(rf"(?<![\w/])(?:\./tcs ros|ros2) ((?:{KINDS}) (?!\|)[^`\n]+)")
Ros = Callable[..., tuple[int, str, str]]


@pytest.fixture
def ros(capsys: pytest.CaptureFixture[str]) -> Ros:
    """Runs a command line in this process: exit status, standard output and standard error."""

    def run(words: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main(["ros", *shlex.split(words)])
        return status, *capsys.readouterr()

    return run


def out(ros: Ros, words: str) -> str:
    """What a command that succeeds prints."""
    status, printed, wrong = ros(words)
    assert status == 0, wrong
    return printed


def test_services_parameters_and_life_cycles_of_a_running_graph(processes: Any, ros: Ros, tmp_path: Path) -> None:
    processes.start_graph("-p", "clock:=real_time", "-p", "period:=0.01", "-p", f"results:={tmp_path}", one=True)
    assert wait_until(lambda: "commission]: ready" in processes.log("graph"), 90.0), processes.log("graph")

    assert "/azimuth/reference/start [std_srvs/srv/Trigger]\n" in out(ros, "service list -t")
    assert out(ros, "service type /azimuth/set_mode") == "tcs_friction_msgs/srv/SetMode\n"
    called = out(ros, "service call /azimuth/set_mode tcs_friction_msgs/srv/SetMode '{mode: 1}'")
    assert "requester: making request: tcs_friction_msgs.srv.SetMode_Request(mode=1)\n\nresponse:\n" in called
    assert "tcs_friction_msgs.srv.SetMode_Response(success=True, message='mode MEASURE" in called

    assert out(ros, "param get azimuth/dob switch1") == "Boolean value is: True\n"
    assert out(ros, "param get /azimuth/dob period --hide-type") == "0.01\n"
    assert out(ros, "param get /azimuth/dob left_out") == "String values are: ['']\n"
    assert out(ros, "param set /azimuth/dob bandwidth 7.5") == "Set parameter successful\n"
    status, _, wrong = ros("param set /azimuth/dob bandwidth -7.5")
    assert status == 1
    assert re.fullmatch(r"tcs-friction: Setting parameter failed: .*bandwidth.*\n", wrong)
    misspelt = "tcs-friction: node /azimuth/dob: no parameter bandwith, expected bandwidth"
    assert ros("param get /azimuth/dob bandwith")[2].startswith(misspelt)
    assert "  bandwidth\n" in out(ros, "param list /azimuth/dob")
    dumped = yaml.safe_load(out(ros, "param dump /azimuth/lugre_compensator"))
    assert dumped["/azimuth/lugre_compensator"]["ros__parameters"]["positive"]["coulomb"] > 0.0
    described = out(ros, "param describe /azimuth/dob bandwidth")
    expected = r"Parameter name: bandwidth\n  Type: double\n  Description: .*\n  Constraints:\n    Min value: .*\n"
    assert re.match(expected, described)

    assert out(ros, "lifecycle nodes") == "/azimuth/controller\n/azimuth/plant\n"
    assert out(ros, "lifecycle set /azimuth/controller deactivate") == "Transitioning successful\n"
    assert out(ros, "lifecycle get") == "/azimuth/controller: inactive [2]\n/azimuth/plant: active [3]\n"
    status, _, wrong = ros("lifecycle set /azimuth/controller deactivate")
    assert (status, "expected one of cleanup, activate, shutdown" in wrong) == (1, True), wrong
    assert "- activate [3]\n\tStart: inactive\n\tGoal: activating\n" in out(ros, "lifecycle list /azimuth/controller")
    out(ros, "lifecycle set /azimuth/controller activate")
    assert out(ros, "lifecycle get /azimuth/controller") == "active [3]\n"

    look_at_topics(processes, ros)
    assert "/azimuth/commission/commission\n" in out(ros, "action list")
    goal = "/azimuth/identifier/identify tcs_friction_msgs/action/Identify '{directory: a/../b}'"
    status, told, wrong = ros(f"action send_goal -f {goal}")
    assert status == 1
    assert re.search(r"Sending goal:\n.*    directory: a/../b\n.*Goal accepted with ID: [0-9a-f]{32}\n", told, re.DOTALL), told
    assert "Goal finished with status: ABORTED\n" in told
    assert wrong == "tcs-friction: action /azimuth/identifier/identify: ended as ABORTED, expected SUCCEEDED\n"


def look_at_topics(processes: Any, ros: Ros) -> None:
    """Topics of the graph that runs; the rate is told until Ctrl-C."""
    processes.start_ros("topic", "hz", "/azimuth/joint_states")
    assert "/azimuth/joint_states [sensor_msgs/msg/JointState]\n" in out(ros, "topic list -t")
    about = out(ros, "topic info --verbose /azimuth/torque_command")
    head = "Type: tcs_friction_msgs/msg/AxisTorque\n\nPublisher count: 1\n\n"
    assert about.startswith(f"{head}Node name: controller\nNode namespace: /azimuth\n"), about
    echoed = out(ros, "topic echo --once /azimuth/joint_states")
    assert echoed.endswith("---\n")
    assert yaml.safe_load(echoed.removesuffix("---\n"))["name"] == ["azimuth"]
    assert out(ros, "topic echo --once --field effort /azimuth/joint_limits").startswith("- ")  # latched: sent long ago
    published = out(ros, "topic pub --once /azimuth/temperature sensor_msgs/msg/Temperature '{temperature: 21}'")
    assert "publishing #1: sensor_msgs.msg.Temperature(" in published
    assert "temperature=21.0" in published
    misspelt = "tcs-friction: topic /azimuth/joint_state: not found, expected /azimuth/joint_states"
    assert ros("topic echo /azimuth/joint_state")[2].startswith(misspelt)
    assert ros("topic info /azimuth/joint_state")[2].startswith(misspelt)
    assert wait_until(lambda: "average rate: " in processes.log("ros"), 30.0), processes.log("ros")
    assert processes.interrupt("ros") == 130
    rate = r"average rate: \d+\.\d{3}\n\tmin: \d\.\d{3}s max: \d+\.\d{3}s std dev: \d\.\d{5}s window: \d+\n"
    assert re.search(rate, processes.log("ros"))


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("{modus: 1}", "no field modus, expected mode"),
        ("{mode: fast}", "mode: The 'mode' field must be of type 'int'"),
        ("{mode: 256}", "mode: The 'mode' field must be an unsigned integer in [0, 255]"),
        ("[1]", "[1] is no mapping, expected for example {mode: ...}"),
        ("{mode: [", "is not YAML"),
    ],
)
def test_values_that_do_not_fit_are_refused_in_one_line(text: str, wrong: str) -> None:
    with pytest.raises(InputError, match=re.escape(wrong)):
        from_yaml(SetMode.Request, text)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("SetMode", "is not of the form PACKAGE/srv/NAME"),
        ("std_srvs/msg/Trigger", "is not of the form PACKAGE/srv/NAME"),
        ("nowhere/srv/Trigger", "no package nowhere with srv here"),
        ("std_srvs/srv/Triger", "std_srvs has no such srv, expected Trigger"),
    ],
)
def test_a_type_that_is_not_there_is_named(name: str, wrong: str) -> None:
    with pytest.raises(InputError, match=re.escape(wrong)):
        interface(name, "srv")


def test_without_a_graph_that_is_what_is_missing(ros: Ros) -> None:
    assert ros("topic info /nope")[::2] == (1, "tcs-friction: topic /nope: not found, expected its graph to run\n")


def test_a_message_is_what_it_was_in_yaml() -> None:
    message = from_yaml(JointState, "{header: {frame_id: a, stamp: {sec: 3}}, name: [x, y], position: [1, 2.5]}")
    assert (message.header.stamp.sec, list(message.name), list(message.position)) == (3, ["x", "y"], [1.0, 2.5])
    assert from_yaml(JointState, as_yaml(message)) == message
    assert plain(JointState(effort=[0.0] * 200))["effort"][-2:] == [0.0, "..."]
    assert from_yaml(AxisTorque, "{header: auto, torque: 3}").header.stamp.sec > 1e9


def recipes() -> list[str]:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    found = [match for page in pages for match in RECIPE.findall(page.read_text())]
    assert len(found) > 10
    return found


@pytest.mark.parametrize("recipe", recipes())
def test_what_the_documentation_tells_to_type_can_be_typed(recipe: str) -> None:
    arguments = parser_of("ros", command).parse_args(shlex.split(recipe, comments=True))
    if getattr(arguments, "type", ""):
        kind, part = {"service": ("srv", "Request"), "action": ("action", "Goal")}[arguments.kind]
        from_yaml(getattr(interface(arguments.type, kind), part), arguments.values)


def test_every_verb_is_offered_and_done() -> None:
    from tcs_friction.nodes.ros.verbs import KINDS as DONE

    assert {kind: set(verbs) for kind, verbs in command.VERBS.items()} == {kind: set(verbs) for kind, verbs in DONE.items()}
