"""The nodes of the loop in processes of their own; their publishers garble and double messages, a driver's clock steps."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import random
import shutil
import signal
import struct
import sys
import tempfile
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from tcs_friction.nodes.graph import ending

LOOP = ("plant", "reference", "lugre_compensator", "dob", "controller")
PERIOD = 0.01
"""s; five Python processes hold 100 Hz on any machine."""
GARBLED, DOUBLED = 0.01, 0.01
"""Shares of the messages."""
CLOCK_STEP = 2.0  # s
TRUE_STATES = "true_joint_states"
"""What the axis does, for the judge alone."""
PARAMETERS: dict[str, object] = {
    "clock": "real_time",
    "period": PERIOD,
    "position_proportional": 8.0,  # gains for 100 Hz
    "velocity_proportional": 2.5e4,
    "velocity_integral": 2e5,
    "velocity_delay": 0.0,
    "age_limit": 0.5,  # a process may have to wait for a busy machine
    "patience": 1.0,
    "watchdog": 0.3,
    "switch1": True,
    "switch3": True,
    "kind": "sinusoid",
    "sinusoid.amplitude": 0.05,
    "sinusoid.period": 10.0,
    "sinusoid.duration": 1e6,
}


def ros_arguments() -> list[str]:
    """The loop's parameters as arguments."""
    words = ["faults", "--ros-args", "--log-level", "fatal"]
    for name, value in PARAMETERS.items():
        words += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
    return words


class Loop:
    """The processes. They are forked from a server that has imported everything, so that a restart takes a second.

    What each of them writes on stderr is kept in a file of its own while it may be of interest.
    """

    def __init__(self, seed: int) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["benchmarks.faulty_nodes", *(f"tcs_friction.nodes.{name}" for name in LOOP)])
        self._processes: dict[str, BaseProcess] = {}
        self._seed = seed
        self._folder = Path(tempfile.mkdtemp(prefix="tcs-friction-faults-"))
        self._died = False

    def start(self, name: str) -> None:
        """A node in a new process."""
        self._seed += 1
        self._words(name).unlink(missing_ok=True)
        process = self._context.Process(target=run_node, args=(name, self._seed, self._words(name)), daemon=True)
        process.start()
        self._processes[name] = process

    def _words(self, name: str) -> Path:
        return self._folder / f"{name}.txt"

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node's process, if it lives."""
        process = self._processes[name]
        if process.pid is not None and process.exitcode is None:
            os.kill(process.pid, number)

    def kill(self, name: str) -> None:
        """The hard way."""
        self._processes[name].kill()
        self._processes[name].join()

    def revive(self) -> list[str]:
        """Start what has ended by itself, and say of each how it ended and in which file its last words are."""
        found = []
        for name, process in self._processes.items():
            if process.exitcode is not None:
                kept = self._words(name).replace(self._folder / f"{name}_{self._seed}.txt")
                found.append(f"node {name} {ending(process.exitcode)} by itself; its last words are in {kept}")
                self.start(name)
                self._died = True
        return found

    def end(self) -> None:
        """Kill what is left, stopped processes included; only last words are kept."""
        for process in self._processes.values():
            process.kill()
            process.join()
        if not self._died:
            shutil.rmtree(self._folder)


def run_node(name: str, seed: int, words: Path) -> None:
    """In a process of its own: one node with faulty publishers; `words` is the file that it complains in."""
    from tcs_friction.nodes.executor import run
    from tcs_friction.nodes.graph import factory

    def make() -> Any:
        node = factory(name)()
        if name == "plant":
            node._states = _TruthfulToo(node, node._states, random.Random(seed))
            signal.signal(signal.SIGUSR1, lambda *_: _step_clock(node, CLOCK_STEP))
            signal.signal(signal.SIGUSR2, lambda *_: _step_clock(node, -CLOCK_STEP))
        else:
            node._publisher = Faulty(node._publisher, random.Random(seed))
        return node

    faulthandler.enable()
    # the middleware complains there of every message that it cannot read
    os.dup2(os.open(words, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), 2)
    sys.exit(run(make, args=ros_arguments()))


def _step_clock(plant: Any, seconds: float) -> None:
    plant._origin += round(seconds * 1e9)


class Faulty:
    """A publisher some of whose messages come garbled, twice, or once more when they are old."""

    def __init__(self, publisher: Any, chance: random.Random) -> None:
        self._publisher, self._chance = publisher, chance
        self._old = b""

    def publish(self, data: bytes) -> None:
        self._publisher.publish(data)
        if self._chance.random() < GARBLED:
            self._publisher.publish(garbled(data, self._chance))
        if self._chance.random() < DOUBLED:
            self._publisher.publish(data)
            self._publisher.publish(self._old or data)
            self._old = data


class _TruthfulToo(Faulty):
    """The plant's: it tells the judge the true speed and the torque that acts."""

    def __init__(self, plant: Any, publisher: Any, chance: random.Random) -> None:
        from sensor_msgs.msg import JointState

        from tcs_friction.nodes.qos import PUBLISH

        super().__init__(publisher, chance)
        self._plant = plant
        self._truth = plant.create_publisher(JointState, TRUE_STATES, PUBLISH)

    def publish(self, data: bytes) -> None:
        super().publish(data)
        plant = self._plant
        simulator = plant._simulator
        self._truth.publish(plant._wire.write(plant._stamp, simulator.position, simulator.velocity, plant._applied))


def garbled(data: bytes, chance: random.Random) -> bytes:
    """A message with wrong bytes, a wrong stamp, a wild number, or an end too early. Never longer than it was."""
    kind = chance.randrange(4)
    if kind == 0:
        broken = bytearray(data)
        for _ in range(chance.randrange(1, 8)):
            broken[chance.randrange(len(broken))] = chance.randrange(256)
        return bytes(broken)
    if kind == 1:
        stamp = chance.choice((0, 1, 2**31 - 1))
        return data[:4] + struct.pack("<iI", stamp, chance.choice((0, 2**32 - 1))) + data[12:]
    if kind == 2:
        at = max(12, len(data) - 8 * chance.randrange(1, 4))
        value = chance.choice((float("nan"), float("inf"), 1e300, -1e308, 1e6))
        return data[:at] + struct.pack("<d", value) + data[at + 8 :]
    return data[: chance.randrange(1, len(data))]
