"""The loop's nodes with a wire and a clock of the test's own: no middleware, no waiting, every message in a fixed order."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message

from tcs_friction.nodes.core.wire import REFERENCE, TORQUE, JointWire
from tcs_friction.nodes.graph import LOOP, factory
from tcs_friction.nodes.loop.plant import Plant
from tcs_friction.physics.simulate import Simulator

SECOND = 1_000_000_000  # ns
OWN = ("/diagnostics", "/parameter_events", "/rosout")
"""Topics that are left to ROS, where nobody listens."""


class Loop:
    """Plant, controller, reference, observer and compensator; what they say is heard in the order in which it is said."""

    def __init__(
        self,
        patch: pytest.MonkeyPatch,
        given: Mapping[str, Any],
        plant: Callable[[], Any] = Plant,
        simulator: Callable[[Any], Simulator] = lambda plant: plant._simulator,
    ) -> None:
        """plant: a class that takes the plant's place; simulator: what tells its simulated axis."""
        self.now = 1000.0
        self._queue: deque[tuple[str, bytes]] = deque()
        self._hearers: dict[str, list[tuple[Any, Callable[[Any], None], bool]]] = {}
        patch.setattr(time, "monotonic", lambda: self.now)
        self._patch_nodes(patch)
        words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
        rclpy.init(args=["test", "--ros-args", *words])
        self.nodes = {name: plant() if name == "plant" else factory(name)() for name in LOOP}
        self._plant, self._simulator = self.nodes["plant"], simulator
        self.lock_step, self.period = self._plant.lock_step, self._plant.config.period
        self.torques: list[float] = []
        self.applied: list[float] = []
        self.errors: list[float] = []
        self.speeds: list[float] = []
        self._wire = JointWire("azimuth")
        if self.lock_step:
            self._plant._states.publish(self._plant._state)

    def _patch_nodes(self, patch: pytest.MonkeyPatch) -> None:
        usual_publisher, usual_subscription = Node.create_publisher, Node.create_subscription
        loop = self

        def publisher(node: Node, kind: Any, topic: str, *args: Any, **more: Any) -> Any:
            return usual_publisher(node, kind, topic, *args, **more) if topic in OWN else Publisher(loop._queue, topic)

        def subscription(node: Node, kind: Any, topic: str, hear: Any, *args: Any, raw: bool = False, **more: Any) -> Any:
            if topic in OWN:
                return usual_subscription(node, kind, topic, hear, *args, raw=raw, **more)
            loop._hearers.setdefault(topic, []).append((kind, hear, raw))
            return None

        patch.setattr(Node, "create_publisher", publisher)
        patch.setattr(Node, "create_subscription", subscription)

    def run(self, seconds: float) -> None:
        """Go on for so long."""
        ticks = round(seconds / self.period)
        if self.lock_step:
            end = len(self.torques) + ticks
            self._deliver(lambda: len(self.torques) < end)
            return
        for _ in range(ticks):
            self.now += self.period
            self._plant._on_timer()
            self._deliver(lambda: True)

    def _deliver(self, goes_on: Callable[[], bool]) -> None:
        while self._queue and goes_on():
            topic, data = self._queue.popleft()
            self._note(topic, data)
            for kind, hear, raw in self._hearers.get(topic, ()):
                hear(data if raw else deserialize_message(data, kind))

    def _note(self, topic: str, data: bytes) -> None:
        if topic == "torque_command":
            self.torques.append(TORQUE.read(data)[1][0])
        elif topic == "joint_states":
            self.applied.append(self._wire.read(data)[3])
        elif topic == "reference":
            _, numbers = REFERENCE.read(data)
            self.errors.append(numbers[0] - self._simulator(self._plant).position)
            self.speeds.append(numbers[1])

    def say(self, topic: str, message: Any) -> None:
        """A message of somebody else, heard at once."""
        for _, hear, raw in self._hearers[topic]:
            hear(serialize_message(message) if raw else message)

    def set(self, node: str, **values: Any) -> bool:
        """Set parameters of a node; whether it took them."""
        changes = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
        return bool(self.nodes[node].set_parameters_atomically(changes).successful)

    def steps(self, begin: int, end: int | None = None) -> float:
        """Largest change of the torque from tick to tick, N m."""
        return float(np.abs(np.diff(self.torques[begin:end])).max())

    def close(self) -> None:
        for node in self.nodes.values():
            node.destroy_node()
        rclpy.try_shutdown()


class Publisher:
    """Puts what is published at the end of the queue."""

    def __init__(self, queue: deque[tuple[str, bytes]], topic: str) -> None:
        self._queue, self.topic = queue, topic

    def publish(self, message: Any) -> None:
        self._queue.append((self.topic, message if isinstance(message, bytes) else serialize_message(message)))
