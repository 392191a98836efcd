"""MuJoCo in place of the simulated axis, in the graph: the loop, joints beside the axis, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.action import ActionClient
from rclpy.logging import LoggingSeverity, get_logger_effective_level
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from tcs_friction_msgs.action import Commission

from tcs_friction.cli import main
from tcs_friction.errors import InputError
from tcs_friction.nodes import own_graph
from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.graph import LOOP
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.signals import graph_signals

pytest.importorskip("mujoco", reason="of the optional set mujoco")

ON_MUJOCO = ("mujoco_plant", *LOOP[1:])
MOUNT = ("-p", "axis:=mount_azimuth.yaml")
JOINTS = ["azimuth", "pier_twist", "pier_rock_x", "pier_rock_y", "altitude"]


def test_commissioning_a_mount_on_mujoco_makes_it_track_better(processes: Any, caller: Any, tmp_path: Path) -> None:
    run, measure = tmp_path / "run.yaml", tmp_path / "measure.yaml"
    run.write_text("reference: {kind: legs, speed: 1.7453293e-3, leg: 1.0, acceleration: 1.0e-2, duration: 4.0}\n")
    measure.write_text("reference: {kind: sinusoid, amplitude: 1.5e-3, period: 5.0, duration: 6.0}\n")
    settings = {"measure_file": measure, "settle": 1.0, "run_until": 0.0, "results": tmp_path, "diagnoses": 0}
    words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
    options = ("mount_azimuth.yaml", "--reference", str(run), "--plant", "mujoco", "--model", "mount_two_axis.xml")
    processes.start_graph(*words, options=options, one=True)
    client = ActionClient(caller.driver, Commission, "commission/commission")
    assert caller.until(client.server_is_ready, 60.0), processes.log("graph")
    sent = client.send_goal_async(Commission.Goal(directory="out"))
    assert caller.until(sent.done, 20.0)
    finished = sent.result().get_result_async()
    assert caller.until(finished.done, 200.0), processes.log("graph")
    result = finished.result().result
    assert result.success, result.message
    assert result.rms_after < 0.4 * result.rms_before
    assert result.parameters.positive.coulomb == pytest.approx(78.1, rel=0.05)
    content = json.loads((tmp_path / "out/commission.json").read_text())
    assert (content["true"], content["friction_off"], content["dob_relative_error"]) == (None, None, None)
    (measured,) = read_recordings([tmp_path / "out/measure"], graph_signals("/azimuth", "azimuth"))
    assert np.ptp(measured.position) == pytest.approx(3e-3, rel=0.01)
    assert "actuator azimuth_servo is a servo of joint azimuth and switched off" in processes.log("graph")


def heard(graph: Any, count: int) -> list[JointState]:
    """The next joint states, as any ROS node gets them."""
    messages: list[JointState] = []
    graph.driver.create_subscription(JointState, "joint_states", messages.append, LISTEN)
    assert graph.until(lambda: len(messages) >= count)
    return messages


def test_all_joints_are_published_and_the_loop_takes_its_own(together: Callable[..., Any]) -> None:
    graph = together(*MOUNT, nodes=ON_MUJOCO)
    message = heard(graph, 50)[-1]
    simulator = graph["mujoco_plant"]._simulator
    assert message.name == JOINTS
    assert len(message.position) == len(message.velocity) == len(message.effort) == len(JOINTS)
    assert message.position[4] == pytest.approx(0.7853, abs=1e-3)
    assert 0.0 < abs(message.position[1]) < 1e-4, "the pier gives way"
    assert np.isnan(message.effort[1:]).all()
    assert message.effort[0] != 0.0
    assert abs(graph["controller"]._state.position - simulator.measured_position) < 1e-4
    assert graph["controller"].health.problem == ""


def test_the_same_seed_makes_the_same_run(together: Callable[..., Any]) -> None:
    graph = together(*MOUNT, "-p", "run_until:=0.1", nodes=ON_MUJOCO)
    plant = graph["mujoco_plant"]
    ends = []
    for seed in (3, 4, 3):
        plant.set_parameters([Parameter("seed", value=seed)])
        assert graph.until(lambda: plant._index == 100 and plant._command is not None)
        ends.append((plant._simulator.position, plant._applied))
    assert ends[0] == ends[2] != ends[1]


def test_in_real_time_it_keeps_up(together: Callable[..., Any]) -> None:
    graph = together(*MOUNT, "-p", "clock:=real_time", "-p", "period:=0.005", nodes=ON_MUJOCO)
    messages = heard(graph, 100)
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]
    assert min(np.diff(stamps)) > 0.0
    assert np.median(np.diff(stamps)) == pytest.approx(0.005, rel=0.1)
    assert abs(messages[-1].position[0]) < 1e-3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-p", "truth:=true"), "mujoco_plant: truth: true, and MuJoCo does not tell"),
        (("-p", "mujoco_joint:=azimut"), "mount_two_axis.xml: no joint azimut, expected azimuth"),
        (("-p", "mujoco_model:=mount.xml"), "mount.xml: no such file, expected a path, or one of .*mount_two_axis.xml"),
    ],
)
def test_what_it_cannot_be_made_of_is_refused(together: Callable[..., Any], words: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        together(*MOUNT, *words, nodes=["mujoco_plant"])


def test_a_change_that_it_cannot_make_changes_nothing(together: Callable[..., Any]) -> None:
    graph = together(*MOUNT, nodes=["mujoco_plant"])
    plant = graph["mujoco_plant"]
    for name, value in (("truth", True), ("mujoco_joint", "altitude"), ("mujoco_model", "nowhere.xml")):
        (answer,) = plant.set_parameters([Parameter(name, value=value)])
        assert not answer.successful
    assert plant._simulator.joint == "azimuth"
    assert plant.config.truth is False


def test_the_demo_runs_on_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """The paper's part of it, on short runs."""
    run, measure = tmp_path / "run.yaml", tmp_path / "measure.yaml"
    run.write_text("reference: {kind: legs, speed: 1.7453293e-3, leg: 1.0, acceleration: 1.0e-2, duration: 3.6}\n")
    measure.write_text("reference: {kind: sinusoid, amplitude: 1.0e-3, period: 3.0, duration: 3.5}\n")
    short = {"measure_file": measure, "settle": 1.0, "diagnoses": 0}
    monkeypatch.setattr(own_graph, "SETTINGS", own_graph.SETTINGS | short)
    words = ["demo", "--plant", "mujoco", "--reference", str(run), "-o", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    content = json.loads(capfd.readouterr().out)
    assert content["after"]["rms"] < 0.5 * content["before"]["rms"]
    assert (content["true"], content["dob_relative_error"]) == (None, None)
    assert (tmp_path / "out/report.html").is_file()
    assert get_logger_effective_level("") == LoggingSeverity.INFO  # the demo's own is not left to what comes after


def test_the_demo_has_no_model_without_mujoco(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--model", "mount_two_axis.xml"]) == 2
    assert "--model: given without MuJoCo, expected --plant mujoco beside it" in capsys.readouterr().err
