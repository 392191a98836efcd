"""Lock-step: the graph computes what the offline loop computes, bit for bit, and nothing lost or bad makes it hang."""

from __future__ import annotations

import math
import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.parameter import Parameter

from tcs_friction.config import load_axis, save_axis
from tcs_friction.control.loop import Cancellation, LoopRun, simulate_loop
from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, TORQUE, JointWire
from tcs_friction.nodes.graph import GRAPH, LOOP
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

CONFIG = Path(__file__).resolve().parents[2] / "config"
DURATION = 1.5  # s: from rest through the start of the first leg


def offline(compensation: str = "none", feed_back: bool = False, seed: int = 0, duration: float = DURATION) -> LoopRun:
    file = load_axis(CONFIG / "azimuth_1p2m.yaml")
    reference = load_reference(CONFIG / "azimuth_1p2m_run.yaml")
    control = file.control
    assert control is not None
    return simulate_loop(
        file.axis,
        Reference(replace(reference.config, duration=duration)),
        control.controller,
        replace(control.loop, compensation=compensation, feed_back=feed_back),
        control.observer,
        control.compensator,
        seed,
    )


class Ears:
    """Everything that goes over the topics of the loop, by stamp."""

    def __init__(self, graph: Any) -> None:
        from sensor_msgs.msg import JointState
        from tcs_friction_msgs.msg import AxisReference, AxisTorque, FrictionEstimate

        from tcs_friction.nodes.core.qos import COLLECT

        joint = JointWire("azimuth")
        wires: dict[str, tuple[Any, Callable[[bytes], tuple[int, tuple[float, ...]]]]] = {
            "joint_states": (JointState, lambda data: (joint.read(data)[0], joint.read(data)[1:])),
            "reference": (AxisReference, REFERENCE.read),
            "friction_estimate": (FrictionEstimate, ESTIMATE.read),
            "friction_compensation": (AxisTorque, TORQUE.read),
            "torque_command": (AxisTorque, TORQUE.read),
        }
        self.heard: dict[str, dict[int, tuple[float, ...]]] = {name: {} for name in wires}
        for name, (kind, read) in wires.items():

            def listen(data: bytes, name: str = name, read: Any = read) -> None:
                stamp, values = read(data)
                assert self.heard[name].get(stamp, values) == values, f"{name} said two things at {stamp}"
                self.heard[name][stamp] = values

            graph.driver.create_subscription(kind, name, listen, COLLECT, raw=True)

    def column(self, name: str, index: int) -> np.ndarray:
        return np.array([values[index] for _, values in sorted(self.heard[name].items())])


def finished(graph: Any) -> bool:
    plant = graph["plant"]
    return bool(plant._stamp >= plant._until and plant._command is not None)


def run(graph: Any, limit: float = 60.0) -> Ears:
    ears = Ears(graph)
    assert graph.until(lambda: finished(graph), limit), graph["plant"].health.problem or graph["controller"].missing()
    return ears


def expect_equal(ears: Ears, loop: LoopRun) -> None:
    assert np.array_equal(ears.column("joint_states", 0), loop.position)
    assert np.array_equal(ears.column("joint_states", 1), loop.velocity)
    assert np.array_equal(ears.column("joint_states", 2), loop.torque)


@pytest.mark.parametrize(
    ("switches", "loop"),
    [
        ({}, {}),
        ({"switch1": True}, {}),
        ({"switch3": True, "switch1": True}, {"compensation": "lugre"}),
        ({"switch3": True, "switch1": True, "feed_back": True}, {"compensation": "lugre", "feed_back": True}),
        ({"switch1": True, "feed_back": True, "seed": 5}, {"feed_back": True, "seed": 5}),
    ],
)
def test_the_graph_equals_the_offline_loop_bit_for_bit(
    together: Callable[..., Any], switches: dict[str, Any], loop: dict[str, Any]
) -> None:
    given = [word for name, value in switches.items() for word in ("-p", f"{name}:={str(value).lower()}")]
    graph = together("-p", f"run_until:={DURATION}", *given)
    ears = run(graph)
    expected = offline(**loop)
    expect_equal(ears, expected)
    estimate = ears.column("friction_estimate", 0)
    if switches.get("switch1"):
        assert np.array_equal(estimate, expected.friction_estimate)
        assert np.array_equal(ears.column("friction_estimate", 2), expected.rest_estimate)
    else:
        assert not estimate.any()
    assert np.array_equal(ears.column("friction_compensation", 0)[:-1], expected.compensation[1:])


def richer(folder: Path) -> Path:
    """The shipped axis with a drive that ripples and lags, friction that follows the temperature, and encoder errors."""
    file = load_axis(CONFIG / "azimuth_1p2m.yaml")
    effects = {
        "torque_ripple": {"order": 300.0, "amplitude": 0.1},
        "actuator_lag": {"time_constant": 2e-3},
        "position_dependent_friction": {"order": 100.0, "amplitude": 0.1},
        "temperature_dependent_friction": {"dry": -0.01},
        "flexible_mode": {"frequency": 20.0, "inertia_ratio": 0.1},
        "encoder_periodic_error": {"order": 3000.0, "amplitude": 4e-7},
    }
    axis = file.axis
    for name, values in effects.items():
        axis = axis.with_effect(instance(effect(name), values))
    save_axis(folder / "richer.yaml", file.with_axis(axis))
    return folder / "richer.yaml"


def test_all_that_a_model_knows_is_cancelled_as_in_the_offline_loop_bit_for_bit(
    together: Callable[..., Any], tmp_path: Path
) -> None:
    path, temperature = richer(tmp_path), 15.0
    given = ("axis", path), ("model", path), ("temperature", temperature), ("run_until", DURATION)
    switches = ("switch1", "switch3", "feed_back")
    words = [f"{name}:={value}" for name, value in given] + [f"{name}:=true" for name in switches]
    ears = run(together(*(word for item in words for word in ("-p", item))))
    file = load_axis(path)
    assert file.control is not None
    reference = load_reference(CONFIG / "azimuth_1p2m_run.yaml")
    expected = simulate_loop(
        file.axis,
        Reference(replace(reference.config, duration=DURATION)),
        file.control.controller,
        replace(file.control.loop, compensation="model", feed_back=True),
        file.control.observer,
        temperature=temperature,
        cancellation=Cancellation(file.axis),
    )
    assert np.array_equal(ears.column("joint_states", 2), expected.torque)
    assert np.array_equal(ears.column("friction_estimate", 0), expected.friction_estimate)
    assert np.array_equal(ears.column("friction_compensation", 0)[:-1], expected.compensation[1:])
    assert not np.array_equal(ears.column("joint_states", 0), expected.position), "the driver says what the encoder says"


def test_another_seed_gives_another_run(together: Callable[..., Any]) -> None:
    ears = run(together("-p", f"run_until:={DURATION}", "-p", "seed:=1"))
    assert not np.array_equal(ears.column("joint_states", 0), offline().position)


def test_a_reset_repeats_the_run(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.5", "-p", "switch3:=true", "-p", "switch1:=true")
    ears = run(graph)
    first = {name: dict(heard) for name, heard in ears.heard.items()}
    for heard in ears.heard.values():
        heard.clear()
    graph["plant"]._restart()
    assert graph.until(lambda: finished(graph) and len(ears.heard["torque_command"]) == 501)
    assert ears.heard == first


def test_the_run_goes_on_when_its_end_is_moved(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.5")
    ears = run(graph)
    graph["plant"].set_parameters([Parameter("run_until", value=DURATION)])
    assert graph.until(lambda: finished(graph))
    expect_equal(ears, offline())


@pytest.mark.parametrize("name", LOOP)
def test_a_lost_message_costs_time_and_nothing_else(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    graph = together("-p", "run_until:=0.3", "-p", "switch1:=true", "-p", "switch3:=true")
    node = graph[name]
    publisher = node._states if name == "plant" else node._publisher

    class Leaky:
        count = 0

        def publish(self, message: Any) -> None:
            self.count += 1
            if self.count != 100:
                publisher.publish(message)

    monkeypatch.setattr(node, "_states" if name == "plant" else "_publisher", Leaky())
    ears = run(graph)
    expect_equal(ears, offline("lugre", duration=0.3))
    assert sum(item.health.repeats for item in graph.nodes.values()) > 0


@pytest.mark.parametrize(
    ("absent", "node", "words"),
    [
        ("dob", "controller", "friction_estimate for 0.000000 s"),
        ("lugre_compensator", "controller", "friction_compensation for 0.000000 s"),
        ("reference", "controller", "reference and friction_compensation for 0.000000 s"),
        ("controller", "plant", "torque_command for 0.000000 s"),
    ],
)
def test_what_is_missing_is_named_after_the_time_limit(
    together: Callable[..., Any], absent: str, node: str, words: str
) -> None:
    graph = together("-p", "time_limit:=1.0", nodes=[name for name in LOOP if name != absent])
    assert graph.until(lambda: bool(graph[node].health.problem), 20.0)
    assert words in graph[node].health.problem
    assert "within 1 s" in graph[node].health.problem
    assert graph["plant"].health.ticks == 0


@pytest.mark.parametrize("torque", [math.nan, math.inf, -math.inf, 1000.1, -2e4])
def test_a_bad_command_is_refused_and_the_axis_stays(together: Callable[..., Any], torque: float) -> None:
    from tcs_friction_msgs.msg import AxisTorque

    graph = together(nodes=["plant"])
    publisher = graph.driver.create_publisher(AxisTorque, "torque_command", 10)
    assert graph.until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(TORQUE.write(0, torque))
    plant = graph["plant"]
    assert graph.until(lambda: plant.health.refused > 0)
    assert plant.health.ticks == 0
    assert "refused" in plant.missing()
    publisher.publish(TORQUE.write(0, 5.0))
    assert graph.until(lambda: plant.health.ticks == 1)
    assert plant._applied == 5.0


def test_bad_inputs_of_the_controller_are_refused(together: Callable[..., Any]) -> None:
    graph = together("-p", "time_limit:=1.0", nodes=["controller"])
    controller = graph["controller"]
    joint = JointWire("azimuth")
    controller._on_state(joint.write(0, math.nan, 0.0, 0.0))
    controller._on_reference(REFERENCE.write(0, 0.0, math.inf, 0.0))
    controller._on_compensation(TORQUE.write(0, math.nan))
    controller._on_estimate(ESTIMATE.write(0, 0.0, 0.0, math.nan, True))
    assert controller.health.refused == 4
    assert controller.health.ticks == 0
    assert controller._done < 0


def resident() -> int:
    """kB of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024


def test_memory_does_not_grow_with_the_run(together: Callable[..., Any]) -> None:
    """All nodes, everything switched on. What they remember is full after 4000 ticks, twice the 2 s asked for."""
    switches = [word for number in (1, 2, 3) for word in ("-p", f"switch{number}:=true")]
    graph = together(*switches, "-p", "run_until:=1.0", "-p", "memory:=2.0", nodes=GRAPH)
    plant = graph["plant"]
    sizes = []
    for thousands in (10, 40, 70):
        plant.set_parameters([Parameter("run_until", value=float(thousands))])
        assert graph.until(lambda: finished(graph), 120.0)
        sizes.append(resident())
    grown = min(sizes[1] - sizes[0], sizes[2] - sizes[1])  # what grows with the run grows in both; a page of the C library in one
    assert grown < 200, f"kB after 10, 40 and 70 thousand ticks: {sizes}; at 200 10 million would take 67 MB"
