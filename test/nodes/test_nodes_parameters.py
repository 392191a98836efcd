"""Parameters: declared with description, unit and range; changed at run time; bad values refused whole, with the reason."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from tcs_friction.control.config_field import flatten
from tcs_friction.control.shaper import Shaper
from tcs_friction.errors import InputError
from tcs_friction.nodes.core import files, parameters
from tcs_friction.nodes.graph import CLASSES, GRAPH
from tcs_friction.nodes.loop.controller import ControllerConfig
from tcs_friction.nodes.loop.dob import DobNodeConfig
from tcs_friction.nodes.loop.reference import ReferenceConfig

OF_ROS = ("axis", "use_sim_time", "start_type_description_service")


def test_nested_settings_have_dotted_names() -> None:
    flat = flatten(DobNodeConfig())
    assert flat["plant.first"][0].unit == "kg m^2"
    assert "switch1" in flat
    assert flatten(ReferenceConfig())["sinusoid.amplitude"][1] > 0.0


def test_a_change_leaves_the_rest_alone() -> None:
    before = DobNodeConfig()
    after = parameters.changed(before, {"plant.first": 5, "bandwidth": 3.0})
    assert (after.plant.first, after.bandwidth) == (5.0, 3.0)
    assert isinstance(after.plant.first, float)
    assert (after.plant.constant, before.plant.first) == (before.plant.constant, 1000.0)


@pytest.mark.parametrize("name", GRAPH)
def test_every_parameter_is_described(together: Callable[..., Any], name: str) -> None:
    graph = together(nodes=[name])
    node = graph[name]
    names = [entry for entry in node._parameters if entry not in OF_ROS and not entry.startswith("qos")]
    flat = flatten(node.config)
    assert sorted(names) == sorted(flat)
    for entry, (declared, _) in flat.items():
        described = node.describe_parameter(entry)
        assert described.description
        assert declared.unit in described.description
        if isinstance(declared.default, float):
            (span,) = described.floating_point_range
            assert (span.from_value, span.to_value) == (declared.lower, declared.upper)
    assert node.describe_parameter("axis").description
    assert CLASSES[name] == type(node).__name__


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("velocity_proportional", float("nan"), "velocity_proportional"),
        ("velocity_proportional", -1.0, "velocity_proportional"),
        ("torque_limit", float("inf"), "torque_limit"),
        ("clock", "sundial", "read-only"),
        ("feed_back", 3, "BOOL"),
        ("axis", "nowhere.yaml", "no such file"),
    ],
)
def test_a_bad_value_is_refused_with_the_reason(
    together: Callable[..., Any], name: str, value: object, reason: str
) -> None:
    node = together(nodes=["controller"])["controller"]
    before = node.config
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful
    assert reason in result.reason
    assert node.config == before


def test_changes_are_applied_whole_or_not_at_all(together: Callable[..., Any]) -> None:
    node = together(nodes=["controller"])["controller"]
    before = node.config
    both = [Parameter("position_proportional", value=7.0), Parameter("clock", value="sundial")]
    assert not node.set_parameters_atomically(both).successful
    assert node.config == before
    both[1] = Parameter("velocity_integral", value=5)
    assert node.set_parameters_atomically(both).successful
    assert (node.config.position_proportional, node.config.velocity_integral) == (7.0, 5.0)
    assert node._pid.config.position_proportional == 7.0


def test_another_axis_file_brings_its_own_values(together: Callable[..., Any], tmp_path: Any) -> None:
    axis = tmp_path / "axis.yaml"
    axis.write_text(
        "axis: {name: azimuth, inertia: 10.0, friction: {law: coulomb_viscous, coulomb: 1.0, viscous: 2.0}}\n"
        "control: {controller: {position_proportional: 3.0}}\n"
    )
    node = together(nodes=["controller"])["controller"]
    assert node.set_parameters([Parameter("axis", value=str(axis))])[0].successful
    assert node.config.position_proportional == 3.0
    assert node.get_parameter("position_proportional").value == 3.0


def test_a_bad_value_at_the_start_is_an_input_error(together: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=r"^controller: Parameter torque_limit out of range.*-5.0$"):
        together("-p", "torque_limit:=-5.0", nodes=["controller"])


def test_static_friction_below_coulomb_friction_is_refused(together: Callable[..., Any]) -> None:
    node = together(nodes=["lugre_compensator"])["lugre_compensator"]
    answer = node.set_parameters([Parameter("positive.static", value=50)])[0]
    assert not answer.successful
    assert "static is 50, expected coulomb (78.1 N m) or more" in answer.reason


def test_a_missing_axis_file_is_an_input_error(together: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=r"nowhere\.yaml: no such file"):
        together("-p", "axis:=nowhere.yaml", nodes=["controller"])


def test_a_pipe_as_axis_file_is_called_what_it_is(together: Callable[..., Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "axis.yaml")
    with pytest.raises(InputError, match=r"axis\.yaml: is no regular file"):
        together("-p", f"axis:={tmp_path / 'axis.yaml'}", nodes=["controller"])
    with pytest.raises(InputError, match="is a directory"):
        together("-p", f"axis:={tmp_path}", nodes=["controller"])


def test_defaults_come_from_the_axis_file(together: Callable[..., Any]) -> None:
    graph = together(nodes=["controller", "plant"])
    assert graph["controller"].config.position_proportional == 32.7
    assert isinstance(graph["controller"].config, ControllerConfig)
    assert graph["plant"].config.torque_limit == 1e3


HOSTILE = {
    "a date that is none": "axis: {inertia: 2001-99-99}",
    "a long integer": f"axis: {{inertia: {'9' * 400}, friction: {{law: coulomb_viscous, coulomb: 1.0, viscous: 1.0}}}}",
    "a very long integer": f"axis: {{inertia: {'9' * 5000}}}",
    "deep lists": "[" * 5000,
    "words called numbers": "axis: {inertia: !!int x}",
    "aliases": "a0: &a0 [1]\n" + "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 12)),
    "a key twice": "axis: {name: a, name: b}",
}


def test_no_file_and_no_name_takes_a_running_node_down(together: Callable[..., Any], tmp_path: Path) -> None:
    """Asked through the service, as `ros2 param set` does."""
    graph = together(nodes=("plant", "reference"))
    clients = {
        (node, parameter): graph.driver.create_client(SetParameters, f"/azimuth/{node}/set_parameters")
        for node, parameter in (("plant", "axis"), ("reference", "axis"), ("reference", "reference_file"))
    }
    assert graph.until(lambda: all(client.service_is_ready() for client in clients.values()))
    before = graph["plant"].file
    paths = []
    for name, content in HOSTILE.items():
        paths.append(tmp_path / f"{name}.yaml")
        paths[-1].write_text(content)
    for (node, parameter), client in clients.items():
        for value in [*map(str, paths), "x" * 5000, "/dev/zero", str(tmp_path)]:
            request = SetParameters.Request(parameters=[Parameter(parameter, value=value).to_parameter_msg()])
            future = client.call_async(request)
            assert graph.until(future.done), (node, value[:80])
            (answer,) = future.result().results
            assert not answer.successful
            assert 0 < len(answer.reason) < 2100
            assert "\n" not in answer.reason
    assert graph["plant"].file is before


def test_a_reference_is_shaped_by_its_file_or_by_parameters(together: Callable[..., Any], tmp_path: Path) -> None:
    node = together(nodes=["reference"])["reference"]
    shaped = tmp_path / "shaped.yaml"
    shaped.write_text("reference: {kind: constant_speed, duration: 5.0}\nshaper: {kind: zv, frequency: 4.0}\n")
    own = [Parameter("shaper.kind", value="zvd"), Parameter("shaper.frequency", value=7.0)]
    assert all(answer.successful for answer in node.set_parameters(own))
    assert node._reference.shaper == Shaper("zvd", 7.0)
    (answer,) = node.set_parameters([Parameter("reference_file", value=str(shaped))])
    assert answer.successful
    assert node._reference.shaper == Shaper("zv", 4.0)
    (answer,) = node.set_parameters([Parameter("shaper.damping", value=1.5)])
    assert not answer.successful
    assert "shaper.damping" in answer.reason


def test_a_file_is_read_once_for_a_change(together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the check and the use of it the file may have changed."""
    graph = together(nodes=["plant"])
    read: list[str] = []
    load = files.load_axis
    monkeypatch.setattr(files, "load_axis", lambda path: read.append(str(path)) or load(path))
    assert graph["plant"].set_parameters([Parameter("axis", value="azimuth_1p2m.yaml")])[0].successful
    assert len(read) == 1
