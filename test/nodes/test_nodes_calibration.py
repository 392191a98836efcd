"""The observer's node with a dynamometer on the axis: calibrated through the topic; the Kalman observer by parameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_nodes_lockstep import Ears, offline

from tcs_friction.config import load_axis, shipped
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.nodes.loop.calibration import CalibrationMemory


def calibrated(graph: Any) -> Any:
    """What the service ~/calibrate answers."""
    from std_srvs.srv import Trigger

    client = graph.driver.create_client(Trigger, "dob/calibrate")
    assert graph.until(client.service_is_ready, 10.0)
    future = client.call_async(Trigger.Request())
    assert graph.until(future.done, 60.0)
    return future.result()


def test_the_topic_calibrates_the_observer(together: Callable[..., Any], tmp_path: Any) -> None:
    reference = tmp_path / "legs.yaml"
    reference.write_text("reference: {kind: legs, speed: 1.7453e-3, leg: 3.0, acceleration: 5.0e-3, duration: 16.0}\n")
    graph = together(
        "-p", f"reference_file:={reference}", "-p", "run_until:=16.0", "-p", "dynamometer:=100.0", "-p", "switch1:=true",
        "-p", "plant.first:=900.0", "-p", "torque_scale:=0.97", "-p", "torque_offset:=2.0",
    )  # fmt: skip
    assert graph.until(lambda: graph["plant"]._stamp >= 16_000_000_000, 120.0)
    answer = calibrated(graph)
    assert answer.success, answer.message
    config = graph["dob"].config
    assert config.torque_scale == pytest.approx(1.0, abs=3e-3)
    assert config.torque_offset == pytest.approx(0.0, abs=0.3)
    assert config.plant.first == pytest.approx(1000.0, rel=0.15)
    share = float(answer.message.partition("; ")[2].split()[0])
    assert share > 99.5


def test_without_a_dynamometer_there_is_nothing_to_calibrate(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.1")
    answer = calibrated(graph)
    assert not answer.success
    assert "no reading" in answer.message


def test_the_simulated_dynamometer_leaves_the_run_as_it_is(together: Callable[..., Any]) -> None:
    from geometry_msgs.msg import WrenchStamped

    graph = together("-p", "run_until:=0.5", "-p", "dynamometer:=100.0")
    heard: list[float] = []
    graph.driver.create_subscription(WrenchStamped, "dynamometer", lambda m: heard.append(m.wrench.torque.z), 100)
    ears = Ears(graph)
    assert graph.until(lambda: 500_000_000 in ears.heard["joint_states"], 30.0)
    loop = offline(duration=0.5)
    assert ears.heard["joint_states"][500_000_000] == (loop.position[-1], loop.velocity[-1], loop.torque[-1])
    assert len(heard) > 40
    assert np.std(np.array(heard[-20:]) - loop.friction[-1]) < 5.0


def test_the_kalman_observer_by_parameter_is_the_offline_one(together: Callable[..., Any]) -> None:
    graph = together("-p", "run_until:=0.5", "-p", "switch1:=true", "-p", "estimator:=kalman", "-p", "feed_back:=true")
    ears = Ears(graph)
    assert graph.until(lambda: 500_000_000 in ears.heard["friction_estimate"], 30.0)
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    control = file.control
    assert control is not None
    config = load_reference(shipped("azimuth_1p2m_run.yaml")).config
    reference = Reference(replace(config, duration=0.5))
    loop = simulate_loop(
        file.axis, reference, control.controller, replace(control.loop, feed_back=True),
        replace(control.observer, estimator="kalman"),
    )  # fmt: skip
    assert ears.heard["friction_estimate"][500_000_000][0] == loop.friction_estimate[-1]
    assert abs(loop.friction_estimate[-1]) > 1.0


def test_memory_forgets_a_run_whose_clock_went_back() -> None:
    memory = CalibrationMemory()
    memory.configure(1e-3, 10.0)
    memory.reading(2_000_000_000, 1.0)
    memory.state(2_000_000_000, 1.0, 1.0)
    memory.state(1_000_000, 1.0, 1.0)
    with pytest.raises(Exception, match="no reading"):
        memory.comparisons()
