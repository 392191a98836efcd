"""Identification of what the graph says: which states are kept, and that what is found in them is the axis'."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.parameter import Parameter
from tcs_friction_msgs.srv import Identify, SetMode

from tcs_friction.config import load_axis, save_axis
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.wire import ESTIMATE, JointWire
from tcs_friction.nodes.graph import GRAPH

WIRE = JointWire("azimuth")
TICK = 10**6  # ns


def call(graph: Any, kind: Any, name: str, request: Any, limit: float = 120.0) -> Any:
    client = graph.driver.create_client(kind, name)
    return graph.result(Waiter(graph.driver).call(client, request, limit), limit)


def states(node: Any, ticks: range, valid: bool | None = None) -> None:
    """States, each with an estimate after it; None for none."""
    for k in ticks:
        node._on_state(WIRE.write(k * TICK, 1e-6 * k, 1e-3, 1.0))
        if valid is not None:
            node._on_estimate(ESTIMATE.write(k * TICK, 80.0, 1e-3, 0.0, valid))


def kept(node: Any) -> list[int]:
    """The ticks of the states kept."""
    stamps, _ = node._live._series.newest()
    return [int(stamp) // TICK for stamp in stamps]


def switch(node: Any, on: bool) -> None:
    assert node.set_parameters_atomically([Parameter("switch2", value=on)]).successful


def test_all_states_are_kept_until_switch2_lets_an_estimate_in(together: Callable[..., Any]) -> None:
    node = together(nodes=["identifier"])["identifier"]
    states(node, range(10), valid=True)
    assert kept(node) == list(range(10)), "Switch2 is off: what an observer says does not matter"
    assert node._heard()[1] == "10 live joint states"
    switch(node, True)
    states(node, range(10, 20), valid=False)
    assert kept(node) == list(range(20)), "Switch1 is off"
    states(node, range(20, 30), valid=True)
    assert kept(node) == list(range(21, 30)), "the first estimate begins a measurement"
    assert node._heard()[1] == "9 live joint states with estimates"


def test_states_without_estimates_do_not_belong_to_a_measurement(together: Callable[..., Any]) -> None:
    """Those between two valid ones leave a gap, which cuts the recording; those after Switch2 is off stay out."""
    node = together("-p", "switch2:=true", nodes=["identifier"])["identifier"]
    states(node, range(50), valid=True)
    states(node, range(50, 100), valid=False)
    states(node, range(100, 150), valid=True)
    switch(node, False)
    states(node, range(150, 200), valid=True)
    assert kept(node) == [*range(1, 51), *range(101, 150)]
    assert len(node._heard()[0].segments) == 2


def test_a_measurement_begins_anew_with_switch2(together: Callable[..., Any]) -> None:
    node = together("-p", "switch2:=true", nodes=["identifier"])["identifier"]
    states(node, range(50), valid=True)
    switch(node, False)
    states(node, range(50, 60), valid=True)
    switch(node, True)
    assert kept(node) == []
    states(node, range(60, 70))
    assert kept(node) == list(range(60, 70)), "nobody gives estimates"
    states(node, range(70, 80), valid=True)
    assert kept(node) == list(range(71, 80))


def test_a_new_run_forgets_the_one_before(together: Callable[..., Any]) -> None:
    node = together("-p", "switch2:=true", nodes=["identifier"])["identifier"]
    states(node, range(100, 150), valid=True)
    states(node, range(20), valid=True)
    assert kept(node) == list(range(20))


def test_states_of_another_joint_are_no_measurement(together: Callable[..., Any], tmp_path: Path) -> None:
    node = together("-p", "switch2:=true", nodes=["identifier"])["identifier"]
    states(node, range(20), valid=True)
    file = node.file
    save_axis(tmp_path / "other.yaml", file.with_axis(replace(file.axis, name="other")))
    node.file = load_axis(tmp_path / "other.yaml")
    node.configure(replace(node.config, switch2=False))
    other = JointWire("other")
    for k in range(30, 40):
        node._on_state(other.write(k * TICK, 0.0, 0.0, 1.0))
    assert kept(node) == list(range(30, 40))


@pytest.fixture
def measured(together: Callable[..., Any], tmp_path: Path) -> Any:
    """A graph that has measured friction on the shipped axis: two and a half turns of a sinusoid, through zero speed."""
    reference = tmp_path / "measure.yaml"
    reference.write_text("reference: {kind: sinusoid, amplitude: 4.0e-3, period: 14.4, duration: 36.0}\n")
    given = {"reference_file": reference, "run_until": 36.0, "period": 0.002, "results": tmp_path, "switch1": True}
    words = [word for name, value in {**given, "switch2": True}.items() for word in ("-p", f"{name}:={value}")]
    graph = together(*words, nodes=GRAPH)
    assert graph.until(lambda: graph["identifier"]._live._state.stamp >= 36.0 * 10**9, 120.0)
    return graph


def test_the_shipped_axis_is_identified_within_its_intervals_as_the_command_would(measured: Any, tmp_path: Path) -> None:
    """Estimates have passed the observer's filter; motion and torque have not."""
    answer = call(measured, Identify, "identifier/identify", Identify.Request(directory="out"))
    assert answer.success, answer.message
    assert "live joint states with estimates" in answer.message
    content = json.loads((tmp_path / "out/identification.json").read_text())
    for name, true in measured["identifier"].file.axis.friction.values.items():
        one = content["parameters"][name]
        print(f"{name:18} true {true:10.6g}  found {one['value']:10.6g} +- {one['std']:.2g}")
        assert one["determined"], name
        assert abs(one["value"] - true) < 4.0 * one["std"], name
        assert one["std"] < 0.5 * true, name
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"identification.json", "axis.yaml", "report.html", "friction_speed.png", "torque.png"} <= written
    file = load_axis(tmp_path / "out/axis.yaml")
    kinds = [item.term.id for item in file.axis.effects]
    assert kinds[:2] == ["coulomb_asymmetry", "cogging"], "what is believed stays so"
    assert answer.parameters.positive.standard_deviation[0] > 0.0
    assert np.isfinite(answer.rmse)


def test_a_search_that_ends_at_no_minimum_is_told(measured: Any, tmp_path: Path) -> None:
    identifier = measured["identifier"]
    assert identifier.set_parameters_atomically([Parameter("method", value="pso")]).successful
    answer = call(measured, Identify, "identifier/identify", Identify.Request(directory="out"))
    assert answer.success, answer.message
    assert answer.message.endswith("; the search did not end at a minimum")
    assert np.isnan(answer.parameters.positive.standard_deviation).all()
    assert json.loads((tmp_path / "out/identification.json").read_text())["minimum"] is False


def test_set_mode_measures(together: Callable[..., Any]) -> None:
    """MEASURE lets estimates in; PLAIN ends it, and what was kept stays."""
    graph = together("-p", "run_until:=0.0", nodes=GRAPH)
    assert call(graph, SetMode, "set_mode", SetMode.Request(mode=SetMode.Request.MEASURE)).success
    node = graph["identifier"]
    states(node, range(1, 30), valid=True)
    assert call(graph, SetMode, "set_mode", SetMode.Request(mode=SetMode.Request.PLAIN)).success
    before = kept(node)
    states(node, range(30, 60), valid=True)
    assert kept(node) == before
