"""A recorded run played back into the identifier gives what the command finds in the bag: real processes, topics over DDS."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from conftest import wait_until
from rclpy.executors import SingleThreadedExecutor
from tcs_friction_msgs.srv import Identify

from tcs_friction import cli
from tcs_friction.commissioning.run import Run
from tcs_friction.config import load_axis, save_axis
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Reference, load_reference

CONFIG = Path(__file__).resolve().parents[2] / "config"
PERIOD = 4e-3  # s, with which the run is recorded
RATE = 10.0
LAW = ("coulomb", "static", "stribeck_velocity", "stiffness")


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, Path]:
    """A bag of a measuring run, with what the graph records of it, and its axis file."""
    file = load_axis(CONFIG / "azimuth_1p2m.yaml")
    assert file.signals is not None
    file = replace(file, axis=replace(file.axis, effects=()), signals=replace(file.signals, reference=None))
    save_axis(tmp_path / "axis.yaml", file)
    reference = Reference(replace(load_reference(CONFIG / "azimuth_1p2m_measure.yaml").config, duration=30.0, period=20.0))
    control = file.control
    assert control is not None
    run = simulate_loop(file.axis, reference, control.controller, control.loop, control.observer)
    keep = slice(0, None, round(PERIOD / control.loop.period))
    columns = {
        "joint_states": [run.t, run.position, run.velocity, run.torque],
        "friction_estimate": [run.t, run.friction_estimate, run.velocity, run.rest_estimate, np.ones(len(run.t))],
    }
    columns["true_friction"] = columns["friction_estimate"]  # which nobody takes
    kept = {name: [column[keep] for column in entry] for name, entry in columns.items()}
    Run("azimuth", kept).write(tmp_path / "bag", "/azimuth")
    return tmp_path / "bag", tmp_path / "axis.yaml"


@pytest.fixture
def call() -> Iterator[Callable[..., Any]]:
    """Calls a service of another process and waits for the answer."""
    rclpy.init(args=[])
    node = rclpy.create_node("caller", namespace="azimuth")
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def answer(kind: Any, name: str, request: Any, limit: float = 60.0) -> Any:
        client = node.create_client(kind, name)
        assert client.wait_for_service(limit), f"no service {name}"
        future = client.call_async(request)
        executor.spin_until_future_complete(future, timeout_sec=limit)
        assert future.done(), f"no answer of {name}"
        return future.result()

    yield answer
    node.destroy_node()
    rclpy.shutdown()


def found(directory: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((directory / "identification.json").read_text())
    return {name: item["value"] for name, item in content["parameters"].items() if item["determined"]}


def recipe(**names: object) -> list[list[str]]:
    """The commands of the recipe in docs/bags.md, as a shell splits them, with its capital words replaced."""
    text = (CONFIG.parent / "docs/bags.md").read_text()
    _, _, rest = text.partition("the command finds in the bag:\n\n")
    lines = [line.strip() for line in rest.partition("\n\nThe result")[0].splitlines()]
    for word, value in names.items():
        lines = [re.sub(rf"\b{word}\b", str(value), line) for line in lines]
    return [shlex.split(line) for line in lines]


def test_a_run_played_back_as_the_documentation_says_is_identified_as_its_bag_is(
    processes: Any, call: Callable[..., Any], recorded: tuple[Path, Path], tmp_path: Path
) -> None:
    """Played faster, with a second identifier beside the first and results elsewhere; else word by word."""
    bag, axis = recorded
    identifier, player, service = recipe(BAG=bag, AXIS=axis.with_suffix(""), OUT="states")
    for command in (identifier, player):
        assert command[:2] == ["./tcs", "node"]
        assert command[3] == "--ros-args"
    more = ("-p", f"period:={PERIOD}", "-p", f"results:={tmp_path}")
    processes.start(identifier[2], *identifier[4:], *more)
    observing = ("-p", "switch2:=true", "-r", "__node:=observing")
    processes.start(identifier[2], *identifier[4:], *more, *observing, label="observing")
    processes.start(player[2], *player[4:], "-p", f"rate:={RATE}", "-p", "subscribers:=2", "-p", "delay:=2.0")
    assert cli.main(["identify", str(bag), "--axis", str(axis), "-o", str(tmp_path / "offline")]) == 0
    offline = found(tmp_path / "offline")
    assert offline["coulomb"] == pytest.approx(78.1, rel=0.02)
    assert wait_until(lambda: not processes.alive("player"), 40.0), processes.log("player")

    assert service[:4] == ["./tcs", "ros", "service", "call"]
    assert service[5] == "tcs_friction_msgs/srv/Identify"
    answer = call(Identify, service[4], Identify.Request(**yaml.safe_load(service[6])))
    assert answer.success, answer.message
    assert "7501 live joint states" in answer.message
    assert found(tmp_path / "states") == offline  # the same samples, so the same numbers

    answer = call(Identify, "observing/identify", Identify.Request(directory="measured"))
    assert answer.success, answer.message
    assert re.search(r"7(500|499) live joint states with estimates", answer.message), "all since the first estimate"
    live = found(tmp_path / "measured")
    assert {name: live[name] for name in LAW} == pytest.approx({name: offline[name] for name in LAW}, rel=0.01)
