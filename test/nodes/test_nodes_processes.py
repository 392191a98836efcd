"""Real processes and real kills: what is left stays sound, says what is missing, and goes on when the node is back."""

from __future__ import annotations

import importlib
import inspect
import time
from typing import Any

import numpy as np
import pytest
from conftest import wait_until
from test_nodes_lockstep import offline

from tcs_friction.nodes.graph import LOOP, module_of, node_names

ERROR = 2
ARGUMENTS = ("-p", "axis:=azimuth_1p2m.yaml", "-p", "reference_file:=azimuth_1p2m_run.yaml", "-p", "time_limit:=1.0")


SECOND = 1_000_000_000  # ns


def start(processes: Any, *arguments: str, names: tuple[str, ...] = LOOP) -> None:
    for name in names:
        processes.start(name, *ARGUMENTS, *arguments)


@pytest.mark.parametrize("name", node_names())
def test_every_node_takes_arguments(name: str) -> None:
    """As `ros2 run` calls it, without, and as `./tcs node` does, with."""
    signature = inspect.signature(importlib.import_module(module_of(name)).main)
    signature.bind()
    signature.bind([name, "--ros-args"])


def test_processes_compute_what_one_process_computes(processes: Any, listener: Any) -> None:
    options = ("-p", "run_until:=0.8", "-p", "switch1:=true", "-p", "switch3:=true")
    start(processes, *options, names=("plant",))
    assert wait_until(lambda: listener.node.count_publishers("/azimuth/joint_states") == 1, 60.0), processes.log("plant")
    start(processes, *options, names=LOOP[1:])  # the plant waits for them, and the listener is there already
    assert wait_until(lambda: bool(listener.states) and listener.states[-1][0] >= 800_000_000, 90.0), processes.log("plant")
    loop = offline("lugre", duration=0.8)
    heard = {state[0]: state[1:] for state in listener.states}
    expected = {
        round(t * 1e9): (q, v, u) for t, q, v, u in zip(loop.t, loop.position, loop.velocity, loop.torque, strict=True)
    }
    assert len(heard) > 300, len(heard)
    assert all(values == expected[stamp] for stamp, values in heard.items())


def test_a_killed_node_is_named_and_the_run_goes_on_when_it_is_back(processes: Any, listener: Any) -> None:
    """One after the other, by a node that needs it: one that is killed between two messages has still served one hearer.

    The other hearer has then no tick to answer, and warns.
    """
    needed_by = {
        "dob": ("friction_estimate", ["controller"]),
        "lugre_compensator": ("friction_compensation", ["controller", "dob"]),
        "reference": ("reference", ["controller", "lugre_compensator"]),
        "controller": ("torque_command", ["plant"]),
    }
    start(processes, "-p", "switch1:=true")
    assert wait_until(lambda: len(listener.states) > 200, 90.0)
    for victim, (words, witnesses) in needed_by.items():
        assert wait_until(lambda: all(listener.health.get(name, (ERROR, ""))[0] != ERROR for name in LOOP), 20.0), listener.health
        processes.kill(victim)

        def named(witnesses: list[str] = witnesses, words: str = words) -> bool:
            said = [listener.health[witness] for witness in witnesses]
            idle = f"idle: no new {words} "
            return any((level == ERROR and words in message) or idle in message for level, message in said)

        assert wait_until(named, 30.0), (victim, listener.health)
        stopped = len(listener.states)
        assert all(processes.alive(name) for name in LOOP if name != victim)
        processes.start(victim, *ARGUMENTS, "-p", "switch1:=true")
        assert wait_until(lambda stopped=stopped: len(listener.states) > stopped + 200, 60.0), (victim, listener.health)
    stamps = np.diff([state[0] for state in listener.states])
    assert stamps.min() > 0, "the clock must not go back when the plant lived"
    assert wait_until(lambda: all(listener.health[name][0] != ERROR for name in LOOP), 10.0)
    assert all(np.isfinite(state[1:]).all() for state in listener.states)


def test_a_plant_that_is_back_starts_a_new_run(processes: Any, listener: Any) -> None:
    start(processes)
    # long enough for the listener to find the new plant before it has come as far
    assert wait_until(lambda: bool(listener.states) and listener.states[-1][0] > 8 * SECOND, 180.0)
    processes.kill("plant")
    processes.start("plant", *ARGUMENTS)

    def after() -> int:
        """States heard since the clock went back; what the dead plant had sent may still be coming."""
        falls = np.flatnonzero(np.diff([state[0] for state in listener.states]) < -SECOND)  # less is a late repetition
        return len(listener.states) - int(falls[-1]) - 1 if len(falls) else 0

    assert wait_until(lambda: after() > 200, 60.0), listener.health
    back = len(listener.states) - after()
    run = listener.states[back : back + 100]  # from where the listener has found the new plant
    loop = offline(duration=1.0 + max(state[0] for state in run) / SECOND)
    for state in run:
        index = round(state[0] / 1e6)
        assert state[1:] == (loop.position[index], loop.velocity[index], loop.torque[index])
    assert all(processes.alive(name) for name in LOOP)


@pytest.mark.parametrize("plant", ["plant", "mujoco_plant"])
def test_in_real_time_a_plant_without_commands_holds_zero_torque(processes: Any, listener: Any, plant: str) -> None:
    if plant == "mujoco_plant":
        pytest.importorskip("mujoco", reason="of the optional set mujoco")
    real_time = ("-p", "clock:=real_time", "-p", "period:=0.01", "-p", "watchdog:=0.2")
    start(processes, *real_time, names=(plant, *LOOP[1:]))
    assert wait_until(lambda: any(state[3] != 0.0 for state in listener.states[-50:]), 90.0), listener.health
    processes.kill("controller")
    assert wait_until(lambda: len(listener.states) > 50 and not any(state[3] for state in listener.states[-20:]), 30.0)
    assert wait_until(lambda: "zero torque" in listener.health.get("plant", (0, ""))[1], 10.0)
    processes.start("controller", *ARGUMENTS, "-p", "clock:=real_time", "-p", "period:=0.01")
    assert wait_until(lambda: any(state[3] != 0.0 for state in listener.states[-20:]), 60.0)


def test_in_real_time_a_rival_whose_stamps_are_of_no_state_is_not_obeyed(processes: Any, caller: Any) -> None:
    """Another process commands half of the torque at once, with stamps 2 ms after those of the states."""
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import JointState
    from tcs_friction_msgs.msg import AxisTorque

    from tcs_friction.nodes.core.wire import TORQUE, JointWire

    loop = ("-p", "clock:=real_time", "-p", "period:=0.01", "-p", "compensator:=false", "-p", "observer:=false")
    start(processes, *loop, names=("plant", "reference", "controller"))
    node, wire = caller.driver, JointWire("azimuth")
    publisher = node.create_publisher(AxisTorque, "torque_command", 10)
    states: list[tuple[float, ...]] = []
    said: set[str] = set()
    commanding: list[bool] = []

    def on_state(data: bytes) -> None:
        states.append(wire.read(data))
        if commanding:
            publisher.publish(TORQUE.write(states[-1][0] + 2_000_000, 500.0))

    node.create_subscription(JointState, "joint_states", on_state, 100, raw=True)
    node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: said.update(s.message for s in m.status), 100)
    assert caller.until(lambda: len(states) > 20 and bool(states[-1][3]), 90.0), processes.log("plant")
    commanding.append(True)
    said.clear()
    begin = len(states)
    wanted = "2 publishers of torque_command contradict each other"
    assert caller.until(lambda: len(states) > begin + 50 and any(wanted in text for text in said), 15.0), said
    assert max(abs(state[2]) for state in states[begin:]) < 1e-3, "the axis stays"
    assert not any(state[3] for state in states[-20:]), "zero torque"
    assert any("stamp 0.002 s newer than the newest state, and of none" in text for text in said)


def test_in_real_time_a_controller_without_reference_commands_zero_torque(processes: Any, listener: Any) -> None:
    start(processes, "-p", "clock:=real_time", "-p", "period:=0.01", names=LOOP)
    assert wait_until(lambda: any(state[3] != 0.0 for state in listener.states[-50:]), 90.0), listener.health
    processes.kill("reference")
    assert wait_until(lambda: len(listener.states) > 50 and not any(state[3] for state in listener.states[-20:]), 30.0)
    assert wait_until(lambda: "no reference" in listener.health.get("controller", (0, ""))[1], 10.0)
    assert listener.health["controller"][0] == ERROR


def test_a_node_that_was_suspended_hears_who_started_meanwhile(processes: Any, listener: Any) -> None:
    start(processes)
    assert wait_until(lambda: bool(listener.states) and listener.states[-1][0] > 2 * SECOND, 90.0)
    processes.kill("plant")
    processes.suspend("controller")
    processes.start("plant", *ARGUMENTS)
    assert wait_until(lambda: listener.states[-1][0] < SECOND, 60.0), processes.log("plant")
    time.sleep(2.0)
    processes.resume("controller")
    back = len(listener.states)
    assert wait_until(lambda: len(listener.states) > back + 200, 60.0), listener.health
