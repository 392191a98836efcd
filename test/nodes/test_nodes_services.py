"""Every service of every node while messages flow, with real processes; `./tcs bench services` does it for as long as wanted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from std_srvs.srv import Trigger

from benchmarks.services import ARGUMENTS, Stress
from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import JobError
from tcs_friction.nodes.graph import GRAPH
from tcs_friction.nodes.loop.calibration import CalibrationMemory, calibrated

WORDS = [word for entry in ARGUMENTS for word in ("-p", entry)]
PERIOD = 5e-3


def test_every_service_answers_while_messages_flow(processes: Any, caller: Any, tmp_path: Any) -> None:
    """Calibration, which once took its node down within six calls, a few times more."""
    processes.start_graph(*WORDS, "-p", f"results:={tmp_path}")
    stress = Stress(caller.driver, seed=1)
    stress.find(GRAPH)
    assert len(stress.services) > 50
    stress.run(6.0, least=100)
    assert processes.alive("graph"), processes.log("graph")
    assert stress.unanswered == []
    assert sum(stress.calls.values()) >= 100
    caller.executor.add_node(caller.driver)  # the stress had it on an executor of its own
    for _ in range(10):
        answer = caller.call(Trigger, "dob/calibrate", Trigger.Request(), 100.0)
        assert answer is not None, processes.log("graph")
        assert answer.message
    assert processes.alive("graph"), processes.log("graph")


def recorded(seconds: float, period: float = PERIOD, wrong: float = 0.0) -> CalibrationMemory:
    """Legs of constant speed to and fro; the dynamometer is `wrong` N m off, up and down."""
    memory = CalibrationMemory()
    memory.configure(PERIOD, 1000.0)
    for k in range(round(seconds / period)):
        t = 10.0 + k * period
        speed = 2e-3 * math.tanh(20.0 * math.sin(2.0 * math.pi * t / 10.0))
        friction = 80.0 * math.copysign(1.0, speed)
        stamp = round(t * 1e9)
        memory.reading(stamp, friction + wrong * math.sin(2.3 * t))
        memory.state(stamp, friction, speed)
    return memory


def observer() -> Any:
    control = load_axis(shipped("azimuth_1p2m.yaml")).control
    assert control is not None
    return control.observer


def test_a_calibration_that_is_none_fails() -> None:
    assert calibrated(recorded(40.0).comparisons(), observer()).accuracy > 0.9
    with pytest.raises(JobError, match=r"dynamometer agree to .* at best; nothing was changed, expected at least 90 %"):
        calibrated(recorded(40.0, wrong=40.0).comparisons(), observer())


def test_states_at_another_rate_do_not_calibrate() -> None:
    with pytest.raises(JobError, match=r"joint_states came every 0.00625 s, expected the observer's period, 0.005 s"):
        recorded(20.0, period=0.00625).comparisons()


def test_a_pause_is_not_bridged() -> None:
    memory = recorded(10.0)
    for k in range(1000):
        stamp = round((30.0 + k * PERIOD) * 1e9)
        memory.reading(stamp, 80.0)
        memory.state(stamp, 80.0, 2e-3)
    first, second = memory.comparisons()
    assert first.t[-1] < 20.0
    assert second.t[0] == pytest.approx(30.0)


def test_a_failed_calibration_changes_nothing(together: Callable[..., Any]) -> None:
    graph = together("-p", f"period:={PERIOD}", nodes=["dob"])
    node = graph["dob"]
    node._calibration = recorded(40.0, wrong=40.0)
    before = node.config
    client = graph.driver.create_client(Trigger, "dob/calibrate")
    assert graph.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert graph.until(future.done)
    assert not future.result().success
    assert "nothing was changed" in future.result().message
    assert node.config == before


def test_an_exception_in_a_service_is_an_answer(together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """One that reaches the events executor ends the process."""
    from tcs_friction_msgs.srv import SetMode

    graph = together(nodes=["commission"])

    async def broken(*_: Any) -> None:
        raise IndexError("list index out of range")

    monkeypatch.setattr(graph["commission"]._tools.modes, "set", broken)
    client = graph.driver.create_client(SetMode, "set_mode")
    assert graph.until(client.service_is_ready)
    future = client.call_async(SetMode.Request(mode=1))
    assert graph.until(future.done)
    assert "IndexError" in future.result().message
    assert not future.result().success
