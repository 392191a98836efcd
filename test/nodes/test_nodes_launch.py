"""The launch file, with stand-ins where the launch system is not installed: arguments, choices, what each node is given."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tcs_friction.nodes.graph import GRAPH

FILE = Path(__file__).resolve().parents[2] / "launch/axis.launch.py"


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The launch file's namespace, and `nodes(**arguments)` as it makes them."""
    names = ("launch", "launch.actions", "launch.substitutions", "launch_ros", "launch_ros.actions")
    modules = {name: ModuleType(name) for name in names}

    def record(**fields: Any) -> SimpleNamespace:
        return SimpleNamespace(**fields)

    given: dict[str, str] = {}
    modules["launch"].__dict__.update(LaunchContext=object, LaunchDescription=list)
    modules["launch.actions"].__dict__.update(
        DeclareLaunchArgument=lambda name, **fields: record(name=name, **fields), OpaqueFunction=record
    )
    modules["launch.substitutions"].__dict__["LaunchConfiguration"] = lambda name: record(perform=lambda _: given[name])
    modules["launch_ros.actions"].__dict__["Node"] = record
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    content = runpy.run_path(str(FILE))
    declared = {entry.name: entry for entry in content["generate_launch_description"]() if hasattr(entry, "name")}

    def nodes(**arguments: str) -> dict[str, Any]:
        given.clear()
        given.update({name: entry.default_value for name, entry in declared.items()} | arguments)
        return {node.name: node for node in content["nodes"](None)}

    return SimpleNamespace(declared=declared, nodes=nodes)


def test_what_is_not_one_of_the_choices_cannot_be_given(launched: Any) -> None:
    choices = {name: entry.choices for name, entry in launched.declared.items()}
    assert choices["clock"] == ["lock_step", "real_time"]
    assert choices["plant"] == choices["use_sim_time"] == ["true", "false"]
    assert "warn" in choices["log_level"]
    assert choices["axis"] is None
    assert all(entry.description for entry in launched.declared.values())


def test_every_node_is_given_what_it_has(launched: Any) -> None:
    nodes = launched.nodes()
    assert set(nodes) == set(GRAPH)
    assert all(node.parameters[0]["clock"] == "lock_step" and len(node.parameters) == 1 for node in nodes.values())
    assert nodes["commission"].parameters[0]["measure_file"] == "azimuth_1p2m_measure.yaml"
    assert nodes["identifier"].parameters[0]["results"] == "results"
    assert isinstance(nodes["plant"].parameters[0]["start_position"], float)


def test_arguments_reach_the_nodes(launched: Any) -> None:
    wanted = {"measure_file": "mine.yaml", "params_file": "params.yaml", "log_level": "debug", "use_sim_time": "true"}
    nodes = launched.nodes(plant="false", **wanted)
    assert "plant" not in nodes
    commission = nodes["commission"]
    assert commission.parameters[0]["measure_file"] == "mine.yaml"
    assert (commission.parameters[0]["simulated"], commission.parameters[0]["use_sim_time"]) == (False, True)
    assert commission.parameters[1] == "params.yaml", "what the file says comes last and wins"
    assert commission.ros_arguments == ["--log-level", "debug"]
