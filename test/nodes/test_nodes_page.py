"""The page's node beside a graph on real DDS: what it hands on, what it carries out, what it does with nonsense."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from test_nodes_security import EVERYWHERE, of_node, policy

from benchmarks.listening import wait_until
from tcs_friction.commands.live import beside
from tcs_friction.commissioning.setup import MODELLED
from tcs_friction.config import load_axis, shipped
from tcs_friction.nodes.graph import GRAPH, LOOP
from tcs_friction.nodes.page.state import CANCEL, LEAVE_OUT, TOPICS, Condition, Job, Switches
from tcs_friction.nodes.page.switches import effects_of
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

MARKUP = "\x1b[31m<img src=x>"


class Sink:
    """Keeps everything."""

    def __init__(self) -> None:
        self.samples: dict[str, list[tuple[float, ...]]] = {topic: [] for topic in TOPICS}
        self.reports: dict[str, Condition] = {}
        self.switches: list[Switches] = []
        self.jobs: list[Job] = []
        self.orders: list[str] = []

    def writer(self, topic: str) -> Callable[..., None]:
        return lambda *sample: self.samples[topic].append(sample)

    def report(self, name: str, condition: Condition) -> None:
        self.reports[name] = condition

    def switched(self, switches: Switches) -> None:
        self.switches.append(switches)

    def told(self, job: Job) -> None:
        self.jobs.append(job)

    def next_order(self) -> str:
        return self.orders.pop() if self.orders else ""


def with_page(together: Callable[..., Any], *arguments: str, nodes: tuple[str, ...] = LOOP) -> tuple[Any, Sink, Any]:
    from tcs_friction.nodes.page.feed import PageFeed

    graph, sink = together(*arguments, nodes=nodes), Sink()
    page = graph.nodes["live"] = PageFeed(sink)
    graph.executor.add_node(page)
    return graph, sink, page


def test_samples_reports_and_switches_are_handed_on(together: Callable[..., Any]) -> None:
    graph, sink, page = with_page(together, "-p", "switch1:=true", "-p", "switch3:=true")
    assert graph.until(lambda: all(len(found) > 500 for found in sink.samples.values()))
    for topic, found in sink.samples.items():
        assert all(len(sample) == 1 + TOPICS[topic] for sample in found), topic
        assert all(math.isfinite(number) for sample in found for number in sample), topic
    stamps = [{sample[0] for sample in sink.samples[topic]} for topic in ("joint_states", "torque_command")]
    assert len(stamps[0] & stamps[1]) > 400
    assert graph.until(lambda: set(sink.reports) >= set(LOOP))
    assert "live" not in sink.reports
    assert "ticks" in sink.reports["plant"].values
    assert graph.until(lambda: bool(sink.switches))
    assert sink.switches[-1].positions == (True, None, True), "no identifier is there"
    assert {item.name for item in sink.switches[-1].effects} == {"coulomb_asymmetry", "cogging"}
    assert page.condition()[0] == ""


def test_estimates_of_an_observer_that_is_off_are_no_numbers(together: Callable[..., Any]) -> None:
    graph, sink, _ = with_page(together)
    assert graph.until(lambda: len(sink.samples["friction_estimate"]) > 50)
    assert all(math.isnan(sample[1]) for sample in sink.samples["friction_estimate"])


def test_nonsense_is_cut_made_printable_or_left_out(together: Callable[..., Any]) -> None:
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from sensor_msgs.msg import JointState

    graph, sink, page = with_page(together, nodes=("reference",))
    publisher = graph.driver.create_publisher(DiagnosticArray, "/diagnostics", 10)
    states = graph.driver.create_publisher(JointState, "joint_states", 10)
    values = [KeyValue(key=f"{MARKUP}{k}", value="x" * 5000) for k in range(500)]
    own = DiagnosticStatus(level=b"\x02", name=f"/azimuth/{MARKUP}", message=MARKUP * 1000, values=values)
    other = DiagnosticStatus(level=b"\x02", name="/elevation/plant", message="of another axis")
    assert graph.until(lambda: publisher.get_subscription_count() > 0 and states.get_subscription_count() > 0)

    def shout() -> bool:
        publisher.publish(DiagnosticArray(status=[own, other]))
        states.publish(b"\x00\x01\x00\x00nonsense")
        return len(sink.reports) > 1 and page.unreadable > 0

    assert graph.until(shout, 20.0)
    (name,) = set(sink.reports) - {"reference"}
    found = sink.reports[name]
    assert "\x1b" not in name + found.message + "".join(found.values)
    assert len(found.message) < 1000
    assert len(found.values) <= 60
    assert sink.samples["joint_states"] == []


def test_orders_are_carried_out_and_their_ends_told(together: Callable[..., Any], tmp_path: Path) -> None:
    graph, sink, _ = with_page(together, "-p", f"results:={tmp_path}", nodes=GRAPH)
    assert graph.until(lambda: len(sink.samples["joint_states"]) > 100)
    sink.orders.append("measure")
    assert graph.until(lambda: bool(sink.jobs) and sink.jobs[-1].success is not None)
    assert sink.jobs[-1] == Job("measure", "mode MEASURE: Switch1 on, Switch2 on, Switch3 off", 1.0, True)
    assert graph.until(lambda: bool(sink.switches) and sink.switches[-1].mode == "measure")
    sink.orders.append("identify")  # far too little has been heard
    assert graph.until(lambda: sink.jobs[-1].name == "identify" and sink.jobs[-1].success is not None)
    sink.orders.append("commission")
    assert graph.until(lambda: sink.jobs[-1].name == "commission" and sink.jobs[-1].stage == "measuring the axis as it is")
    sink.orders.append("plain")  # not while something runs
    graph.for_seconds(0.3)
    assert sink.jobs[-1].name == "commission"
    sink.orders.append("abort")
    assert graph.until(lambda: sink.jobs[-1].success is not None)
    assert (sink.jobs[-1].name, sink.jobs[-1].success) == ("commission", False)
    assert "cancelled" in sink.jobs[-1].stage
    sink.orders.append("abort")
    assert graph.until(lambda: sink.jobs[-1].name == "abort" and sink.jobs[-1].success is not None)
    assert sink.jobs[-1].stage == "no job was running"


def test_without_a_model_no_effect_is_switched(together: Callable[..., Any]) -> None:
    graph, sink, _ = with_page(together)
    sink.orders.append(f"{LEAVE_OUT}cogging")
    assert graph.until(lambda: bool(sink.jobs) and sink.jobs[-1].success is False)
    assert "has no model, expected one that has cogging" in sink.jobs[-1].stage


def test_an_order_that_nobody_answers_ends(together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    from tcs_friction.nodes.page import orders as page_orders

    monkeypatch.setattr(page_orders, "ANSWER_LIMIT", 0.3)
    graph, sink, _ = with_page(together, nodes=("reference",))
    for order in ("measure", "diagnose"):
        sink.orders.append(order)
        assert graph.until(lambda order=order: bool(sink.jobs) and sink.jobs[-1].name == order and sink.jobs[-1].success is False)
        assert "not there within" in sink.jobs[-1].stage
    sink.orders.append("abort")
    assert graph.until(lambda: sink.jobs[-1].name == "abort")
    assert "nothing there" in sink.jobs[-1].stage


def test_an_effect_of_the_model_is_left_out_and_cancelled_again_as_the_policy_allows(together: Callable[..., Any]) -> None:
    graph, sink, _ = with_page(together, "-p", "model:=azimuth_1p2m.yaml", nodes=GRAPH)
    assert graph.until(lambda: bool(sink.switches) and sink.switches[-1].mode == "plain")

    def asked() -> dict[str, bool | None]:
        return {effect.name: effect.asked for effect in sink.switches[-1].effects}

    assert asked() == {"coulomb_asymmetry": True, "cogging": True}
    for order, left_out in ((f"{LEAVE_OUT}cogging", ["cogging"]), (f"{CANCEL}cogging", [""])):
        sink.orders.append(order)
        assert graph.until(lambda order=order: bool(sink.jobs) and sink.jobs[-1].name == order and not sink.jobs[-1].running)
        assert sink.jobs[-1].success, sink.jobs[-1]
        for node in MODELLED:
            assert list(graph.nodes[node].get_parameter("left_out").value or [""]) == left_out, node
        assert graph.until(lambda left_out=left_out: asked() == {"coulomb_asymmetry": True, "cogging": left_out == [""]})
    does, allowed = of_node(graph.driver, "live"), policy()["live"]
    for rule, names in does.items():
        assert names - EVERYWHERE.get(rule, set()) == allowed[rule] - EVERYWHERE.get(rule, set()), rule


def test_a_graph_has_its_page_beside_it_and_takes_it_along(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)

    def children() -> set[str]:
        return {child.name for child in Path("/proc").glob("[0-9]*") if parent(child) == os.getpid()}

    others = children()
    with beside(["azimuth_1p2m.yaml"], ["--ros-args", "-p", f"results:={tmp_path}"], port=0):
        assert wait_until(lambda: "http://" in capfd.readouterr().err, 60.0)
        page = children() - others
        assert page
    assert not children() & page


def parent(process: Path) -> int:
    """The process that has made a process, 0 for one that has gone."""
    try:
        return int((process / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


def test_effects_are_those_of_the_model_and_what_else_the_axis_has() -> None:
    axis = load_axis(shipped("azimuth_1p2m.yaml")).axis
    assert {item.state for item in effects_of(axis, None, (), True)} == {"not cancelled"}
    model = load_axis(shipped("azimuth_1p2m.yaml")).with_axis(axis).axis
    states = {item.name: item.state for item in effects_of(axis, model, ("cogging",), True)}
    assert states == {"coulomb_asymmetry": "cancelled", "cogging": "left out"}
    more = instance(effect("imbalance"), {"amplitude": 1.0})
    states = {item.name: item.state for item in effects_of(replace(axis, effects=(more,)), model, (), False)}
    assert states == {
        "coulomb_asymmetry": "cancelled once Switch3 is on",
        "cogging": "cancelled once Switch3 is on",
        "imbalance": "not cancelled",
    }


@pytest.mark.parametrize(
    ("positions", "mode"),
    [((False, False, False), "plain"), ((True, True, False), "measure"), ((False, False, True), "compensate"),
     ((True, False, False), "mixed"), ((True, None, False), "")],
)  # fmt: skip
def test_the_mode_follows_from_the_switches(positions: Any, mode: str) -> None:
    assert Switches(positions).mode == mode
