"""set_mode, identification behind service and action, and the whole loop of commissioning."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import AxisTorque
from tcs_friction_msgs.srv import Diagnose, Identify, SetMode

from tcs_friction.config import load_axis
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.qos import PUBLISH
from tcs_friction.nodes.graph import GRAPH
from tcs_friction.recording.bags import read_recordings

CANCELED = 5


@pytest.fixture
def short(tmp_path: Path) -> list[str]:
    """A tracking run and a measuring run that take seconds."""
    run, measure = tmp_path / "run.yaml", tmp_path / "measure.yaml"
    run.write_text("reference: {kind: legs, speed: 1.7453293e-3, leg: 1.5, acceleration: 5.0e-3, duration: 6.0}\n")
    measure.write_text("reference: {kind: sinusoid, amplitude: 3.0e-3, period: 10.0, duration: 12.0}\n")
    arguments = {"reference_file": run, "measure_file": measure, "settle": 1.0, "run_until": 0.0, "answer_limit": 3.0}
    arguments |= {"results": tmp_path, "diagnoses": 0, "period": 0.004}
    return [word for name, value in arguments.items() for word in ("-p", f"{name}:={value}")]


def switches(graph: Any) -> tuple[bool, bool, bool]:
    return (
        graph["dob"].config.switch1,
        graph["identifier"].config.switch2,
        graph["lugre_compensator"].config.switch3,
    )


def call(graph: Any, kind: Any, name: str, request: Any, limit: float = 60.0) -> Any:
    client = graph.driver.create_client(kind, name)
    return graph.result(Waiter(graph.driver).call(client, request, limit), limit)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (SetMode.Request.MEASURE, (True, True, False)),
        (SetMode.Request.COMPENSATE, (False, False, True)),
        (SetMode.Request.PLAIN, (False, False, False)),
    ],
)
def test_set_mode_sets_the_three_switches(
    together: Callable[..., Any], mode: int, expected: tuple[bool, bool, bool], capfd: pytest.CaptureFixture[str]
) -> None:
    graph = together("-p", "run_until:=0.0", "-p", "switch1:=true", "-p", "switch3:=true", nodes=GRAPH)
    answer = call(graph, SetMode, "set_mode", SetMode.Request(mode=mode))
    said = ", ".join(f"Switch{k} {'on' if on else 'off'}" for k, on in enumerate(expected, 1))
    assert (answer.success, answer.message.partition(": ")[2]) == (True, said)
    assert switches(graph) == expected
    said = capfd.readouterr().err
    assert said.count("[azimuth.commission]: mode ") == 1
    assert ("[azimuth.identifier]: switch2 on" in said) == expected[1]


def test_set_mode_refuses_an_unknown_mode(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.0", nodes=GRAPH)
    answer = call(graph, SetMode, "set_mode", SetMode.Request(mode=7))
    assert not answer.success
    assert "mode 7" in answer.message


@pytest.mark.parametrize("refusing", ["identifier", "lugre_compensator"])
def test_set_mode_changes_nothing_when_one_node_refuses(together: Callable[..., Any], refusing: str) -> None:
    from rcl_interfaces.msg import SetParametersResult

    graph = together("-p", "run_until:=0.0", "-p", "switch3:=true", nodes=GRAPH)
    before = switches(graph)
    graph[refusing].add_on_set_parameters_callback(
        lambda _: SetParametersResult(successful=False, reason="not today")
    )
    answer = call(graph, SetMode, "set_mode", SetMode.Request(mode=SetMode.Request.MEASURE))
    assert not answer.success
    assert "not today" in answer.message
    assert "nothing was changed" in answer.message
    assert switches(graph) == before


def test_set_mode_names_a_node_that_is_not_there(together: Callable[..., Any]) -> None:
    graph = together("-p", "answer_limit:=1.0", nodes=["dob", "lugre_compensator", "commission"])
    answer = call(graph, SetMode, "set_mode", SetMode.Request(mode=SetMode.Request.MEASURE))
    assert not answer.success
    assert "identifier" in answer.message
    assert not graph["dob"].config.switch1


@pytest.mark.parametrize("given", [{}, {"bags": ["nowhere"]}, {"axis": "nowhere.yaml"}])
def test_identification_without_data_says_so(together: Callable[..., Any], given: dict[str, Any]) -> None:
    graph = together("-p", "run_until:=0.0", nodes=["identifier"])
    answer = call(graph, Identify, "identifier/identify", Identify.Request(**given))
    assert not answer.success
    assert ("nowhere" if given else "live recording: 0 joint states of azimuth heard") in answer.message


def test_diagnosis_without_data_says_so(together: Callable[..., Any]) -> None:
    graph = together(nodes=["diagnoser"])
    answer = call(graph, Diagnose, "diagnoser/diagnose", Diagnose.Request())
    assert not answer.success
    assert "0 joint states of azimuth heard" in answer.message


async def act(graph: Any, kind: Any, name: str, goal: Any, hear: Callable[[Any], None], cancel_when: Any = None) -> Any:
    waiter, client = Waiter(graph.driver), ActionClient(graph.driver, kind, name)
    assert await waiter.until(client.server_is_ready, 20.0)
    sent = client.send_goal_async(goal, feedback_callback=lambda message: hear(message.feedback))
    await waiter.until(sent.done, 20.0)
    finished = sent.result().get_result_async()
    if cancel_when is not None:
        await waiter.until(cancel_when, 60.0)
        sent.result().cancel_goal_async()
    await waiter.until(finished.done, 200.0)
    return finished.result()


def test_the_whole_loop_measures_identifies_compensates_and_gets_better(
    together: Callable[..., Any], short: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    graph = together(*short, nodes=GRAPH)
    heard: list[tuple[float, str]] = []
    directory = tmp_path / "out"
    goal = CommissionAction.Goal(directory="out")
    ended = graph.result(
        act(graph, CommissionAction, "commission/commission", goal, lambda f: heard.append((f.progress, f.stage))), 200.0
    )
    result = ended.result
    assert result.success, result.message
    assert result.rms_after < 0.4 * result.rms_before
    assert result.peak_after < 0.4 * result.peak_before
    assert result.dob_relative_error < 0.03
    assert result.parameters.positive.coulomb == pytest.approx(78.1, rel=0.03)
    assert switches(graph) == (False, False, True)
    said = capfd.readouterr().err
    assert said.count("[azimuth.identifier]: identifier/identify: coulomb") == 1
    deadline = time.monotonic() + 20.0
    while "[azimuth.plant]: waiting: run_until" not in said and time.monotonic() < deadline:
        graph.for_seconds(0.1)
        said += capfd.readouterr().err
    assert "[azimuth.plant]: waiting: run_until" in said
    assert graph["lugre_compensator"].config.positive.coulomb == result.parameters.positive.coulomb
    shares = [share for share, _ in heard]
    assert shares == sorted(shares)
    assert {"measuring friction", "compensating"} <= {stage for _, stage in heard}
    content = json.loads((directory / "commission.json").read_text())
    known = {"before", "after", "friction_off", "dob_relative_error", "identified", "true"}
    assert set(content) == known | {"found", "ideal", "effects", "statements"}
    assert content["after"]["rms"] < content["before"]["rms"]
    assert (content["found"], content["effects"]) == (None, [])
    names = {path.name for path in directory.iterdir()}
    assert {"before", "measure", "after", "identification.json", "axis.yaml", "report.html"} <= names
    own = directory / "identification"
    assert {"report.html", "friction_speed.png"} <= {path.name for path in own.iterdir()}, "as the command makes it"
    assert (own / "identification.json").read_text() == (directory / "identification.json").read_text()
    signals = load_axis(directory / "axis.yaml").signals
    assert signals is not None
    for name in ("before", "measure", "after"):
        (run,) = read_recordings([directory / name], signals)
        assert run.reference is not None
        assert np.abs(run.reference - run.position).max() < 1e-3, f"{name} begins at its own reference"


def test_a_cancelled_commissioning_leaves_the_mode_plain(together: Callable[..., Any], short: list[str]) -> None:
    graph = together(*short, nodes=GRAPH)
    heard: list[str] = []
    ended = graph.result(
        act(
            graph,
            CommissionAction,
            "commission/commission",
            CommissionAction.Goal(),
            lambda feedback: heard.append(feedback.stage),
            lambda: "measuring friction" in heard,
        ),
        200.0,
    )
    assert ended.status == CANCELED
    assert "cancelled" in ended.result.message
    assert switches(graph) == (False, False, False)


def test_a_second_goal_is_refused_while_one_runs(
    together: Callable[..., Any], short: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    graph = together(*short, nodes=GRAPH)
    heard: list[str] = []
    client = ActionClient(graph.driver, IdentifyAction, "identifier/identify")
    graph["identifier"]._jobs._since = 1.0
    assert graph.until(client.server_is_ready)
    sent = client.send_goal_async(IdentifyAction.Goal())
    assert graph.until(sent.done)
    assert not sent.result().accepted
    assert "goal rejected: identifier/identify: busy with another request for" in capfd.readouterr().err
    answer = call(graph, Identify, "identifier/identify", Identify.Request())
    assert "busy" in answer.message
    assert heard == []


def test_commissioning_names_a_loop_that_stalls(together: Callable[..., Any], short: list[str]) -> None:
    graph = together(*short, "-p", "stall_limit:=2.0", nodes=GRAPH)
    graph["controller"].destroy_publisher(graph["controller"]._publisher)
    graph["controller"]._publisher = graph["controller"].create_publisher(AxisTorque, "nowhere", PUBLISH)
    ended = graph.result(
        act(graph, CommissionAction, "commission/commission", CommissionAction.Goal(), lambda _: None), 120.0
    )
    assert not ended.result.success
    assert "stalled" in ended.result.message
    assert "joint_states" in ended.result.message


def test_commissioning_names_a_node_that_is_not_there(together: Callable[..., Any], short: list[str]) -> None:
    graph = together(*short, "-p", "answer_limit:=1.0", nodes=[name for name in GRAPH if name != "controller"])
    ended = graph.result(
        act(graph, CommissionAction, "commission/commission", CommissionAction.Goal(), lambda _: None), 120.0
    )
    assert not ended.result.success
    assert "service controller/get_parameters: not there within 1 s" in ended.result.message


def test_the_compensator_refuses_bad_parameters_whole(together: Callable[..., Any]) -> None:
    from tcs_friction_msgs.msg import LugreParameters

    from tcs_friction.nodes.core.convert import lugre_message

    graph = together(nodes=["lugre_compensator"])
    node = graph["lugre_compensator"]
    before = node.config
    message: LugreParameters = lugre_message(node.config, 0, "a bad day")
    message.positive.coulomb = 50.0
    message.negative.stiffness = float("nan")
    node._on_parameters(serialize_message(message))
    assert node.config == before
    assert "refused" in node.health.warning
    message.negative.stiffness = 2e5
    node._on_parameters(serialize_message(message))
    assert (node.config.positive.coulomb, node.config.negative.stiffness) == (50.0, 2e5)
    assert node.get_parameter("positive.coulomb").value == 50.0
    assert node.set_parameters([Parameter("switch3", value=True)])[0].successful
