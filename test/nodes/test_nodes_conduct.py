"""How a commissioning conducts itself: what it refuses first and sets back, how the axis rests, that it ends in real time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.srv import SetMode
from test_nodes_commission import CANCELED, act, call, switches

from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.control.tracking import Improvement
from tcs_friction.nodes.core.convert import lugre_message
from tcs_friction.nodes.graph import GRAPH

ABORTED = 6
ACTION = (CommissionAction, "commission/commission")
RUN = "{kind: legs, speed: 1.7453293e-3, leg: 0.5, acceleration: 5.0e-3, duration: 6.0}"
MEASURE = "{kind: sinusoid, amplitude: 3.0e-3, period: 8.0, duration: 7.0}"


@pytest.fixture
def files(tmp_path: Path) -> Callable[..., list[str]]:
    """Arguments for runs of a few seconds, and whatever else is wanted."""

    def arguments(**wanted: Any) -> list[str]:
        values: dict[str, Any] = {"settle": 1.0, "results": tmp_path, "answer_limit": 3.0, "run_until": 0.0}
        for name, text in (("reference_file", RUN), ("measure_file", MEASURE)):
            values[name] = tmp_path / f"{name}.yaml"
            values[name].write_text(f"reference: {wanted.pop(name, text)}\n")
        return [word for name, value in (values | wanted).items() for word in ("-p", f"{name}:={value}")]

    return arguments


def commissioned(graph: Any, directory: str = "", hear: Callable[[Any], None] = lambda _: None, **options: Any) -> Any:
    goal = CommissionAction.Goal(directory=directory, repetitions=options.pop("repetitions", 0))
    return graph.result(act(graph, *ACTION, goal, hear, **options), 120.0)


def test_what_cannot_be_done_is_said_before_the_first_run(
    together: Callable[..., Any], files: Callable[..., list[str]], tmp_path: Path
) -> None:
    (tmp_path / "used").mkdir()
    (tmp_path / "used/axis.yaml").write_text("mine")
    (tmp_path / "file").write_text("")
    for name, text in (("still", "{kind: hold, duration: 5.0}"), ("one_way", RUN.replace("6.0", "2.5"))):
        (tmp_path / name).write_text(f"reference: {text}\n")
    graph = together(*files(answer_limit=0.3), nodes=["commission"])
    stages: list[str] = []

    def refused(words: str, directory: str = "", repetitions: int = 0, **changes: Any) -> None:
        node = graph["commission"]
        before = [Parameter(name, value=getattr(node.config, name)) for name in changes]
        node.set_parameters([Parameter(name, value=value) for name, value in changes.items()])
        ended = commissioned(graph, directory, lambda feedback: stages.append(feedback.stage), repetitions=repetitions)
        assert ended.status == ABORTED
        assert words in ended.result.message
        assert "\n" not in ended.result.message
        node.set_parameters(before)

    refused("no reversal to positive or negative motion in its 5 s", reference_file=str(tmp_path / "still"))
    refused("no reversal to positive motion in its 2.5 s", reference_file=str(tmp_path / "one_way"))
    refused("after the 6 s of settle", settle=6.0)
    refused("'/tmp/first_light': is not allowed", "/tmp/first_light")
    refused("used: holds something already", "used")
    refused("file/below: cannot be made", "file/below")
    refused("at most 100", repetitions=4_000_000_000)
    refused("identifier: not there within 0.3 s, expected the node to run")
    assert not stages


def test_no_proven_gain_is_no_success_and_everything_is_as_before(
    together: Callable[..., Any], files: Callable[..., list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every gain is taken as one that chance may have given."""
    monkeypatch.setattr(Improvement, "proven", False)
    graph = together(*files(period=0.004, switch3="true", diagnoses=0), "-p", "positive.coulomb:=60.0", nodes=GRAPH)
    before = graph["lugre_compensator"].config
    ended = commissioned(graph, "night/one")
    assert ended.status == ABORTED
    assert "switches and compensation are as they were before" in ended.result.message
    assert ended.result.rms_before > 0.0
    assert switches(graph) == (False, False, True)
    graph.for_seconds(0.2)  # for what is latched
    assert graph["lugre_compensator"].config == before
    assert "No improvement" in (tmp_path / "night/one/report.html").read_text()


def test_a_cancelled_commissioning_sets_back_and_rests(together: Callable[..., Any], files: Callable[..., list[str]]) -> None:
    """Meanwhile nobody else sets the mode, and another goal is rejected."""
    graph = together(*files(switch3="true", period=0.004, reference_file=RUN.replace("6.0}", "600.0}")), nodes=GRAPH)
    answers: list[Any] = []
    asked: list[str] = []

    def hear(feedback: Any) -> None:
        if not asked and feedback.progress > 0.0:
            asked.append(feedback.stage)
            client = graph.driver.create_client(SetMode, "set_mode")
            client.call_async(SetMode.Request(mode=1)).add_done_callback(lambda done: answers.append(done.result()))

    ended = commissioned(graph, hear=hear, cancel_when=lambda: bool(answers))
    assert ended.status == CANCELED
    assert not answers[0].success
    assert "set_mode: refused while commission: busy with another request for" in answers[0].message
    assert switches(graph) == (False, False, True)
    stamp = graph["plant"]._stamp
    graph.for_seconds(1.5)
    assert graph["plant"]._stamp == stamp < 600_000_000_000, "simulated time stands still"
    assert "is reached" in graph["plant"].waits()
    assert call(graph, SetMode, "set_mode", SetMode.Request(mode=1)).success


def test_a_switch_that_somebody_turns_during_a_run_ends_it(together: Callable[..., Any], files: Callable[..., list[str]]) -> None:
    graph = together(*files(period=0.004), nodes=GRAPH)
    heard: list[str] = []

    def hear(feedback: Any) -> None:
        if feedback.stage == "measuring friction" and not heard:
            heard.append(feedback.stage)
            graph["dob"].set_parameters([Parameter("switch1", value=False)])

    ended = commissioned(graph, hear=hear)
    assert ended.status == ABORTED
    assert "node dob: switch1 was changed during the run" in ended.result.message


SLOW_LOOP = {  # gains for 100 Hz, which a busy machine holds; friction shows, for they are low
    "clock": "real_time",
    "period": 0.01,
    "position_proportional": 8.0,
    "velocity_proportional": 2.5e4,
    "velocity_integral": 2e5,
    "velocity_delay": 0.0,
    "age_limit": 0.3,
    "watchdog": 0.3,
}


def test_commissioning_in_real_time_succeeds(
    processes: Any, caller: Any, files: Callable[..., list[str]], tmp_path: Path
) -> None:
    """No stamp meets the end of a run there."""
    arguments = files(**SLOW_LOOP)
    processes.start_graph(*arguments)
    results: list[Any] = []
    stages: list[str] = []
    assert caller.until(ActionClient(caller.driver, *ACTION).server_is_ready, 200.0), processes.log("graph")

    async def commission() -> None:
        goal = CommissionAction.Goal(directory="real")
        results.append(await act(caller, *ACTION, goal, lambda feedback: stages.append(feedback.stage)))

    caller.executor.create_task(commission)
    assert caller.until(lambda: bool(results), 150.0), (stages[-1:], processes.log("graph"))
    ended = results[0]
    assert {"measuring the axis as it is", "measuring friction", "compensating"} <= set(stages), ended.result.message
    assert "tracking error" in ended.result.message
    assert (tmp_path / "real/commission.json").exists()
    assert ended.result.success, ended.result.message
    assert ended.result.rms_after < ended.result.rms_before
    parameters = caller.parameters("lugre_compensator", ["switch3", "positive.coulomb"])
    assert parameters == {"switch3": True, "positive.coulomb": ended.result.parameters.positive.coulomb}
    positions = caller.positions(1.0)
    assert max(positions) - min(positions) < 1e-5, "the axis rests"


def test_of_two_latched_sets_of_parameters_the_newer_one_holds(together: Callable[..., Any]) -> None:
    """A compensator that starts later hears both the identifier's and what commissioning has set back, in any order."""
    node = together(nodes=["lugre_compensator"])["lugre_compensator"]
    for stamp, coulomb in ((2_000_000_000, 70.0), (1_000_000_000, 60.0)):
        message = lugre_message(node.config, stamp, "a test")
        message.positive.coulomb = coulomb
        node._on_parameters(serialize_message(message))
    assert node.config.positive.coulomb == 70.0


@pytest.mark.parametrize(("losses", "message"), [(1, ""), (99, "reference: it stays at 0.5 with speed 0 for 0.05 s")])
def test_a_reference_that_has_lost_the_axis_for_a_moment_is_asked_again(
    losses: int, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It rests where the axis was then. An axis that it loses every time is not asked for ever."""
    from types import SimpleNamespace

    from tcs_friction.errors import JobError
    from tcs_friction.nodes.commissioning import programme

    monkeypatch.setattr(programme, "RESTS", 0.0)
    asked: list[str] = []
    runs = SimpleNamespace(reference=(0.5, 0.0, 0.0))

    class Others:
        async def set(self, node: str, values: Any, limit: float) -> None:
            asked.append(f"{node} {values['kind']} {limit:g}")

        async def trigger(self, name: str, _limit: float) -> None:
            asked.append(name)
            if asked.count(name) > losses:
                runs.reference = (0.0, 0.0, 0.0)

    class Waiter:
        async def until(self, ready: Callable[[], bool], _limit: float) -> bool:
            return ready()

    node = SimpleNamespace(file=SimpleNamespace(axis=SimpleNamespace(continuous=False)))
    going = programme.Programme(node, Waiter(), Others(), runs)  # type: ignore[arg-type]
    config = SimpleNamespace(answer_limit=1.0, stall_limit=0.05)
    steps = going._go_to_start(reference_from_mapping({"kind": "hold", "duration": 1.0}, "x"), config, lambda _: None)
    if message:
        with pytest.raises(JobError, match=message):
            steps.send(None)
        assert asked.count("reference/start") == programme.MOST_STARTS
    else:
        with pytest.raises(StopIteration):
            steps.send(None)
        assert asked == ["reference hold 1", "reference/start", "reference/start"]
