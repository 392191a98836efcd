"""Nodes in processes of their own; the publishers of the loop garble, double, swap and lose messages, a driver's clock steps."""

from __future__ import annotations

import faulthandler
import importlib
import multiprocessing
import os
import random
import shutil
import signal
import struct
import sys
import tempfile
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from benchmarks.faulty_companions import LISTENERS, Surroundings
from tcs_friction.nodes.graph import LOOP, ending, module_of, node_names

PERIOD = 0.01
"""s; five Python processes hold 100 Hz on any machine."""
GARBLED, DOUBLED, SWAPPED, LOST = 0.01, 0.01, 0.01, 0.01
"""Shares of the messages."""
CLOCK_STEP = 2.0  # s
TRUE_STATES, TRUE_REFERENCE = "true_joint_states", "true_reference"
"""What the axis does, and the reference with the position of the axis that it was told: for the judge alone."""
GARBLED_COUNT = "messages garbled beyond doubt"
HEARS = {  # of which nodes each hears messages that may be garbled
    "plant": ("controller",),
    "reference": ("plant",),
    "lugre_compensator": ("reference",),
    "dob": ("plant", "lugre_compensator"),
    "controller": ("plant", "reference", "lugre_compensator", "dob"),
}
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
QUIET = ["faults", "--ros-args", "--log-level", "fatal"]


def ros_arguments() -> list[str]:
    """The loop's parameters as arguments."""
    given = [f"{name}:={str(value).lower() if isinstance(value, bool) else value}" for name, value in PARAMETERS.items()]
    return [*QUIET, *(word for entry in given for word in ("-p", entry))]


class Loop:
    """The processes. They are forked from a server that has imported everything, so that a restart takes a second.

    What each of them writes on stderr is kept in a file of its own while it may be of interest.
    """

    def __init__(self, seed: int) -> None:
        self._context = multiprocessing.get_context("forkserver")
        modules = [module_of(name) for name in node_names()]
        self._context.set_forkserver_preload(["benchmarks.faulty_nodes", *modules])
        self._processes: dict[str, BaseProcess] = {}
        self._seed = seed
        self._folder = Path(tempfile.mkdtemp(prefix="tcs-friction-faults-"))
        self._died = False
        self._beside = tempfile.TemporaryDirectory(prefix="tcs-friction-beside-")
        self.surroundings = Surroundings(Path(self._beside.name))

    def start(self, name: str) -> None:
        """A node in a new process."""
        self._seed += 1
        self._words(name).unlink(missing_ok=True)
        given = [] if name in LOOP else self.surroundings.parameters(name)
        process = self._context.Process(target=run_node, args=(name, self._seed, self._words(name), given), daemon=True)
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
        self._beside.cleanup()
        if not self._died:
            shutil.rmtree(self._folder)


def run_node(name: str, seed: int, words: Path, given: Sequence[str]) -> None:
    """In a process of its own: one node, of the loop with a faulty publisher; `words` is the file that it complains in."""
    from tcs_friction.nodes.core.executor import run
    from tcs_friction.nodes.graph import factory

    def make() -> Any:
        node = factory(name)()
        if name == "plant":
            node._states = _TruthfulPlant(node, node._states, random.Random(seed))
            signal.signal(signal.SIGUSR1, lambda *_: _step_clock(node, CLOCK_STEP))
            signal.signal(signal.SIGUSR2, lambda *_: _step_clock(node, -CLOCK_STEP))
        else:
            kind = _TruthfulReference if name == "reference" else Faulty
            node._publisher = kind(node, node._publisher, random.Random(seed))
        return node

    faulthandler.enable()
    # The middleware complains there of every message that it cannot read. The file has its name once all words go there.
    begun = words.with_suffix(".begun")
    os.dup2(os.open(begun, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), 2)
    begun.rename(words)
    if name in LOOP:
        sys.exit(run(make, args=ros_arguments()))
    arguments = ros_arguments() if name in LISTENERS else list(QUIET)
    for entry in given:
        arguments += ["-p", entry]
    sys.exit(importlib.import_module(module_of(name)).main(arguments))


def _step_clock(plant: Any, seconds: float) -> None:
    plant._origin += round(seconds * 1e9)


class Faulty:
    """A publisher some of whose messages are lost, come after the next one, garbled, twice, or once more when they are old.

    The node reports how many were garbled.
    """

    def __init__(self, node: Any, publisher: Any, chance: random.Random) -> None:
        self._node, self._publisher, self._chance = node, publisher, chance
        self._old = self._late = b""
        self._beyond_doubt = 0

    def publish(self, data: bytes) -> None:
        self._pass_on(data)
        if self._chance.random() < GARBLED:
            broken = garbled(data, self._chance)
            self._publisher.publish(broken)
            self._beyond_doubt += beyond_doubt(data, broken)
            self._node.health.values[GARBLED_COUNT] = str(self._beyond_doubt)
        if self._chance.random() < DOUBLED:
            self._publisher.publish(data)
            self._publisher.publish(self._old or data)
            self._old = data

    def _pass_on(self, data: bytes) -> None:
        draw = self._chance.random()
        if draw < LOST:
            return
        if draw < LOST + SWAPPED and not self._late:
            self._late = data
            return
        self._publisher.publish(data)
        if self._late:
            self._publisher.publish(self._late)
            self._late = b""


class _Truthful(Faulty):
    """It tells the judge, too, what is not garbled."""

    topic = ""

    def __init__(self, node: Any, publisher: Any, chance: random.Random) -> None:
        from sensor_msgs.msg import JointState

        from tcs_friction.nodes.core.qos import PUBLISH
        from tcs_friction.nodes.core.wire import JointWire

        super().__init__(node, publisher, chance)
        self._truth = node.create_publisher(JointState, self.topic, PUBLISH)
        self._wire = JointWire(node.file.axis.name)

    def publish(self, data: bytes) -> None:
        super().publish(data)
        self._truth.publish(self._wire.write(*self.numbers(data)))

    def numbers(self, data: bytes) -> tuple[int, float, float, float]:
        """Stamp, position, speed and effort to tell. For subclasses."""
        raise NotImplementedError


class _TruthfulPlant(_Truthful):
    """The true motion, and the torque that acts."""

    topic = TRUE_STATES

    def numbers(self, data: bytes) -> tuple[int, float, float, float]:  # noqa: ARG002
        simulator = self._node._simulator
        return self._node._stamp, simulator.position, simulator.velocity, self._node._applied


class _TruthfulReference(_Truthful):
    """The reference; for effort the position of the axis as it was heard."""

    topic = TRUE_REFERENCE

    def numbers(self, data: bytes) -> tuple[int, float, float, float]:
        from tcs_friction.nodes.core.wire import REFERENCE

        stamp, (position, speed, _) = REFERENCE.read(data)
        return stamp, position, speed, self._node._state.position


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


def beyond_doubt(data: bytes, broken: bytes) -> bool:
    """Whether nobody can take a garbled message for a good one: it is cut short, or its stamp is years away."""
    return len(broken) < len(data) or abs(int.from_bytes(broken[4:8], "little") - int.from_bytes(data[4:8], "little")) > 1e6
