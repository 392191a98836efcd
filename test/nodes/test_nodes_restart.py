"""A commissioning whose whole graph is killed in its middle goes on where it was when the graph is back. Real processes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import short_runs
from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message
from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.msg import LugreParameters

from tcs_friction.commissioning.journal import STATE
from tcs_friction.nodes.core.convert import friction_of


class Goal:
    """A goal of commissioning under way in a graph elsewhere."""

    def __init__(self, caller: Any, client: ActionClient) -> None:
        self.stages: list[str] = []
        self._caller = caller
        goal = CommissionAction.Goal(directory="out")
        def heard(message: Any) -> None:
            self.stages.append(message.feedback.stage)

        sent: list[Any] = []
        for _ in range(20):  # a server that was killed is remembered for a while, and what is sent to it is lost
            sent.append(client.send_goal_async(goal, feedback_callback=heard))
            if caller.until(lambda: any(one.done() for one in sent), 5.0):
                break
        handle = next(one for one in sent if one.done()).result()  # those that come after it find the server busy
        assert handle.accepted
        self._finished = handle.get_result_async()

    def reaches(self, stage: str) -> bool:
        return bool(self._caller.until(lambda: stage in self.stages or self._finished.done(), 120.0)) and stage in self.stages

    def result(self) -> Any:
        assert self._caller.until(self._finished.done, 120.0)
        return self._finished.result().result


def test_a_graph_killed_in_the_middle_goes_on_with_what_it_had_not_done(processes: Any, caller: Any, tmp_path: Path) -> None:
    run, measure = short_runs(tmp_path)
    run.write_text(run.read_text().replace("duration: 4.5", "duration: 9.0"))  # reversals enough to say that they are better
    given = {"measure_file": measure, "results": tmp_path, "diagnoses": 0, "settle": 0.5, "period": 0.004, "run_until": 0.0}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    options = ("--reference", str(run))
    client, out = ActionClient(caller.driver, CommissionAction, "commission/commission"), tmp_path / "out"

    processes.start_graph(*words, options=options)
    assert caller.until(client.server_is_ready, 90.0), processes.log("graph")
    assert Goal(caller, client).reaches("compensating"), processes.log("graph")
    processes.kill_graph()
    done = json.loads((out / STATE).read_text())["done"]
    assert list(done) == ["setup", "before", "measure", "identification"]
    written = {path: path.stat().st_mtime_ns for name in ("before", "measure") for path in (out / name).iterdir()}
    identified = friction_of(deserialize_message(bytes.fromhex(done["identification"]), LugreParameters))

    processes.start_graph(*words, options=options)
    goal = Goal(caller, client)
    result = goal.result()
    assert result.success, result.message
    assert "goes on after before, measure, identification" in processes.log("graph")
    assert not {"measuring the axis as it is", "measuring friction", "identifying"} & set(goal.stages)
    assert {path: path.stat().st_mtime_ns for path in written} == written, "not made again"
    assert friction_of(result.parameters) == identified
    assert result.rms_after < 0.7 * result.rms_before
    compensator = caller.parameters("lugre_compensator", ["switch3", *identified])
    assert compensator.pop("switch3")
    assert compensator == pytest.approx(identified)
    assert caller.parameters("dob", ["switch1"]) == {"switch1": False}
    assert not (out / STATE).exists()
    assert np.isfinite(json.loads((out / "commission.json").read_text())["after"]["rms"])
