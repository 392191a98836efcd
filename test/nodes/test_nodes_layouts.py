"""The shipped layouts name topics that the graph has and fields that their messages have, and MCAP readers find units there."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tcs_friction.nodes.bags.bag_topics import installed_definition, message_class
from tcs_friction.nodes.bags.event_ring import write_bag
from tcs_friction.nodes.core.wire import EVIDENCE
from tcs_friction.nodes.graph import GRAPH
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.record import definition_text

FOLDER = Path(__file__).resolve().parents[2] / "layouts"
FOXGLOVE, PLOTJUGGLER = FOLDER / "azimuth_foxglove.json", FOLDER / "azimuth_plotjuggler.xml"
PANELS = ("Plot", "DiagnosticSummary", "RosOut", "Tab")
UNITS = ("[rad]", "[rad/s]", "[N m]", "[degC]", "[log10]")


def foxglove_panels() -> dict[str, dict[str, Any]]:
    panels: dict[str, dict[str, Any]] = json.loads(FOXGLOVE.read_text())["configById"]
    return panels


def foxglove_paths() -> Iterator[str]:
    """Every message path: /topic.field.field[i]."""
    for panel in foxglove_panels().values():
        yield from (path["value"] for path in panel.get("paths", ()))
        if "xAxisPath" in panel:
            yield panel["xAxisPath"]["value"]


def plotjuggler_curves() -> Iterator[str]:
    """Every curve: /topic/field/field, of joint states /topic/joint/field."""
    for curve in ElementTree.parse(PLOTJUGGLER).iter("curve"):
        names = [curve.get("curve_x"), curve.get("curve_y")] if curve.get("curve_x") else [curve.get("name")]
        yield from (name for name in names if name is not None)


@pytest.fixture
def types(together: Callable[..., Any]) -> dict[str, str]:
    """Topics of the running graph and their types."""
    graph = together(nodes=[*GRAPH, "monitor"])
    wanted = {path.partition(".")[0] for path in foxglove_paths()}
    graph.until(lambda: wanted <= {name for name, _ in graph.driver.get_topic_names_and_types()}, 10.0)
    return {name: kinds[0] for name, kinds in graph.driver.get_topic_names_and_types()}


def kind_of(message: Any, steps: list[str]) -> str:
    """The type of a field of a message class, a path of names; KeyError where it has none."""
    for step in steps[:-1]:
        message = message_class(message.get_fields_and_field_types()[step].replace("/", "/msg/"))
    return str(message.get_fields_and_field_types()[steps[-1]])


def test_every_topic_and_field_of_the_layouts_exists(types: dict[str, str]) -> None:
    for path in foxglove_paths():
        topic, _, field = path.partition(".")
        kind = kind_of(message_class(types[topic]), re.sub(r"\[\d+\]", "", field).split("."))
        assert kind == ("sequence<double>" if field.endswith("]") else "double"), path
    for curve in plotjuggler_curves():
        topic = max((name for name in types if curve.startswith(f"{name}/")), key=len, default="")
        assert topic, f"no topic of {curve}"
        steps = curve.removeprefix(f"{topic}/").split("/")
        if types[topic] == "sensor_msgs/msg/JointState":  # PlotJuggler names what a joint has by the joint
            assert steps.pop(0) == "azimuth"
        assert "double" in kind_of(message_class(types[topic]), steps), curve
    for panel in foxglove_panels().values():
        assert panel.get("topicToRender", "/rosout") in types


def test_a_renamed_field_would_be_noticed() -> None:
    estimate = message_class("tcs_friction_msgs/msg/FrictionEstimate")
    assert kind_of(estimate, ["torque"]) == "double"
    with pytest.raises(KeyError):
        kind_of(estimate, ["torqe"])


def test_the_foxglove_layout_is_one() -> None:
    layout = json.loads(FOXGLOVE.read_text())
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}

    def shown(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
            for tab in layout["configById"][node].get("tabs", ()):
                yield from shown(tab["layout"])
            return
        assert node["direction"] in ("row", "column")
        yield from shown(node["first"])
        yield from shown(node["second"])

    assert sorted(shown(layout["layout"])) == sorted(layout["configById"])
    assert all(name.partition("!")[0] in PANELS for name in layout["configById"])


def test_what_is_drawn_says_its_unit() -> None:
    for name, panel in foxglove_panels().items():
        if name.startswith("Plot!"):
            assert any(unit in panel["title"] for unit in UNITS), name
            assert all(any(unit in path["label"] for unit in UNITS) for path in panel["paths"]), name
    areas = [area.get("name", "") for area in ElementTree.parse(PLOTJUGGLER).iter("DockArea")]
    assert areas
    assert all(any(unit in name for unit in UNITS) for name in areas)


def test_a_bag_has_definitions_with_units_that_other_readers_decode(tmp_path: Path) -> None:
    definition = definition_text("tcs_friction_msgs/msg/AxisEvidence", installed_definition)
    channel = Channel("/azimuth/axis_evidence", "tcs_friction_msgs/msg/AxisEvidence", "cdr", definition, "ros2msg", "")
    numbers = [0.1 * k for k in range(10)]
    write_bag(tmp_path / "bag", [(channel, "")], [(0, 5, 0, EVIDENCE.write(7, *numbers, True))])
    with (tmp_path / "bag/bag_0.mcap").open("rb") as file:
        ((schema, read, _, message),) = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
    assert schema is not None
    assert (schema.name, schema.encoding, read.message_encoding) == ("tcs_friction_msgs/msg/AxisEvidence", "ros2msg", "cdr")
    assert "float64 residual     # N m" in schema.data.decode()
    assert message.residual == 0.0
    assert message.learned == pytest.approx(0.9)
    assert message.changed is True
