"""The launch file: arguments, choices, what each node is given, who activates it. With stand-ins for the launch system; the
last test starts the real one where it is installed."""

from __future__ import annotations

import importlib.util
import os
import runpy
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition

from tcs_friction.errors import InputError
from tcs_friction.nodes.graph import GRAPH

FILE = Path(__file__).resolve().parents[2] / "launch/axis.launch.py"


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The arguments declared, `actions(**arguments)` of the launch file and the `nodes` among them."""
    names = (
        "launch",
        "launch.actions",
        "launch.events",
        "launch.substitutions",
        "launch_ros",
        "launch_ros.actions",
    )
    names += ("launch_ros.event_handlers", "launch_ros.events", "launch_ros.events.lifecycle")
    modules = {name: ModuleType(name) for name in names}

    def record(kind: str) -> Any:
        return lambda *values, **fields: SimpleNamespace(kind=kind, values=values, **fields)

    given: dict[str, str] = {}
    modules["launch"].__dict__.update(Action=object, LaunchContext=object, LaunchDescription=list)
    modules["launch.actions"].__dict__.update(
        DeclareLaunchArgument=lambda name, **fields: SimpleNamespace(name=name, **fields),
        **{name: record(name) for name in ("EmitEvent", "OpaqueFunction", "RegisterEventHandler")},
    )
    modules["launch.events"].__dict__["matches_action"] = lambda action: action
    modules["launch.substitutions"].__dict__["LaunchConfiguration"] = lambda name: SimpleNamespace(
        perform=lambda _: given[name]
    )
    modules["launch_ros.actions"].__dict__.update(Node=record("Node"), LifecycleNode=record("LifecycleNode"))
    modules["launch_ros.event_handlers"].__dict__["OnStateTransition"] = record("OnStateTransition")
    modules["launch_ros.events.lifecycle"].__dict__["ChangeState"] = record("ChangeState")
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    content = runpy.run_path(str(FILE))
    declared = {
        entry.name: entry for entry in content["generate_launch_description"]() if hasattr(entry, "name")
    }

    def actions(**arguments: str) -> list[Any]:
        given.clear()
        given.update({name: entry.default_value for name, entry in declared.items()} | arguments)
        return list(content["nodes"](None))

    def nodes(**arguments: str) -> dict[str, Any]:
        return {node.name: node for node in actions(**arguments) if node.kind in ("Node", "LifecycleNode")}

    return SimpleNamespace(declared=declared, nodes=nodes, actions=actions)


def test_what_is_not_one_of_the_choices_cannot_be_given(launched: Any) -> None:
    choices = {name: entry.choices for name, entry in launched.declared.items()}
    assert choices["clock"] == ["lock_step", "real_time"]
    assert choices["use_sim_time"] == choices["auto_activate"] == ["true", "false"]
    assert choices["plant"] == ["true", "false", "mujoco"]
    assert "warn" in choices["log_level"]
    assert choices["axis"] is None
    assert all(entry.description for entry in launched.declared.values())


def test_an_axis_file_that_is_not_there_starts_nothing(launched: Any) -> None:
    with pytest.raises(InputError, match=r"/nope\.yaml: no such file"):
        launched.actions(axis="/nope.yaml")


def test_every_node_is_given_what_it_has(launched: Any) -> None:
    nodes = launched.nodes()
    assert set(nodes) == set(GRAPH)
    assert all(
        node.parameters[0]["clock"] == "lock_step" and len(node.parameters) == 1 for node in nodes.values()
    )
    assert nodes["commission"].parameters[0]["measure_file"] == "azimuth_1p2m_measure.yaml"
    assert nodes["identifier"].parameters[0]["results"] == "results"
    assert isinstance(nodes["plant"].parameters[0]["start_position"], float)


def test_arguments_reach_the_nodes(launched: Any) -> None:
    wanted = {
        "measure_file": "mine.yaml",
        "params_file": "params.yaml",
        "log_level": "debug",
        "use_sim_time": "true",
    }
    assert launched.nodes(beside="/altitude,/dome")["plant"].parameters[0]["beside"] == ["/altitude", "/dome"]
    nodes = launched.nodes(plant="false", **wanted)
    assert "plant" not in nodes
    commission = nodes["commission"]
    assert commission.parameters[0]["measure_file"] == "mine.yaml"
    assert (commission.parameters[0]["simulated"], commission.parameters[0]["use_sim_time"]) == (False, True)
    assert commission.parameters[1] == "params.yaml", "what the file says comes last and wins"
    assert commission.ros_arguments == ["--log-level", "debug"]


def test_a_joint_of_a_mujoco_model_takes_the_place_of_the_plant(launched: Any) -> None:
    nodes = launched.nodes(plant="mujoco", model="mine.xml", joint="az")
    plant = nodes["plant"]
    assert (plant.executable, plant.kind) == ("mujoco_plant", "LifecycleNode")
    given = plant.parameters[0]
    assert (given["mujoco_model"], given["mujoco_joint"], given["truth"]) == ("mine.xml", "az", False)
    assert nodes["commission"].parameters[0]["truth"] is False
    assert nodes["commission"].parameters[0]["simulated"] is True
    assert "truth" not in launched.nodes()["commission"].parameters[0]


@pytest.mark.parametrize(("plant", "managed"), [("true", ["plant", "controller"]), ("false", ["controller"])])
def test_managed_nodes_are_configured_and_then_activated(
    launched: Any, plant: str, managed: list[str]
) -> None:
    actions = launched.actions(plant=plant)
    kinds = [action.kind for action in actions]
    assert [node.name for node in actions if node.kind == "LifecycleNode"] == managed
    first = min(kinds.index("RegisterEventHandler"), kinds.index("EmitEvent"))
    assert not {"Node", "LifecycleNode"} & set(kinds[first:]), "a node that is not there yet hears no event"
    asked = []
    heard: list[Any] = []
    for action in actions[first:]:
        if action.kind == "RegisterEventHandler":
            heard += action.values
            continue
        change = action.event
        node = change.lifecycle_node_matcher
        asked.append(node.name)
        assert change.transition_id == Transition.TRANSITION_CONFIGURE
        (handler,) = [entry for entry in heard if entry.target_lifecycle_node is node]
        assert (handler.start_state, handler.goal_state, handler.handle_once) == (
            "configuring",
            "inactive",
            True,
        )
        (then,) = handler.entities
        assert then.event.lifecycle_node_matcher is node
        assert then.event.transition_id == Transition.TRANSITION_ACTIVATE
    assert asked == managed
    assert all(launched.nodes()[name].parameters[0]["auto_activate"] is False for name in managed)


def test_managed_nodes_wait_when_they_are_told_to(launched: Any) -> None:
    actions = launched.actions(auto_activate="false")
    assert {action.kind for action in actions} == {"Node", "LifecycleNode"}


LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

source = PythonLaunchDescriptionSource(sys.argv[1])
arguments = [tuple(word.split(":=")) for word in sys.argv[2:]]
service = LaunchService()
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(source, launch_arguments=arguments)])
)
sys.exit(service.run())
"""


@pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="the launch system is not installed"
)
@pytest.mark.parametrize("clock", ["lock_step", "real_time"])
def test_launched_for_real_the_graph_moves_and_a_signal_ends_it(
    caller: Any, tmp_path: Path, clock: str
) -> None:
    from lifecycle_msgs.srv import GetState

    (tmp_path / "params.yaml").write_text(
        "/azimuth/plant: {ros__parameters: {run_until: 0.5}}\n"
    )  # of lock-step only
    words = [f"clock:={clock}", f"results:={tmp_path}/results", f"params_file:={tmp_path}/params.yaml"]
    with (tmp_path / "launch.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", LAUNCH, str(FILE), *words],
            stdout=log,
            stderr=log,
            env=os.environ | {"ROS_LOG_DIR": str(tmp_path)},
            start_new_session=True,
        )
    said = (tmp_path / "launch.log").read_text

    def active(name: str) -> bool:
        answer = caller.call(GetState, f"{name}/get_state", GetState.Request(), 5.0)
        return answer is not None and answer.current_state.label == "active"

    try:
        for name in ("plant", "controller"):
            assert any(active(name) for _ in range(60) if process.poll() is None), said()
        assert caller.until(lambda: said().count("ready: axis") == len(GRAPH), 200.0), said()
        moved = "run_until (0.5 s) is reached"
        assert (
            caller.until(lambda: moved in said(), 60.0) if clock == "lock_step" else caller.positions(1.0)
        ), said()
        os.killpg(process.pid, signal.SIGINT)  # to the whole group, as a terminal sends it
        assert process.wait(30.0) == 0, said()
        assert "process has died" not in said()
        assert "escalating" not in said()
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
