"""Temperature and signals that the terms of an axis read, for a node that follows a real axis: it does without none of them."""

from __future__ import annotations

import math
import time

from rclpy.node import Node
from sensor_msgs.msg import Temperature

from tcs_friction.config import AxisFile
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.qos import COLLECT
from tcs_friction.nodes.loop.live_signals import LiveSignals
from tcs_friction.nodes.loop.lugre_compensator import COLDEST, HOTTEST

ROOM = 20.0  # degC, where no term reads the temperature and nobody tells it


class MeasuredSurroundings:
    """What was heard last of all that an axis' terms read."""

    def __init__(self, node: Node, health: Health) -> None:
        self.temperature = ROOM
        self.names: tuple[str, ...] = ()
        self._health = health
        self._measured = -1.0
        self._thermal = False
        self._signals = LiveSignals(node, health, lambda: None)
        node.create_subscription(Temperature, "temperature", self._on_temperature, COLLECT)

    def follow(self, file: AxisFile) -> None:
        """The terms of another axis."""
        self.names = signals_of(file.axis)
        self._thermal = any(item.thermal for item in file.axis.terms)
        sources = file.signals.exogenous if file.signals is not None else {}
        self._signals.follow({name: sources[name] for name in self.names if name in sources})

    def look(self) -> None:
        """Subscribe to what is published by now; to be called now and then."""
        self._signals.look()

    def values(self) -> list[float]:
        """Each signal's value and rate (1/s), in the order of `names`."""
        return self._signals.values(self.names)

    def lacking(self, temperature_age: float = math.inf, signal_age: float = math.inf) -> list[str]:
        """What the terms read and was not heard, or not so lately (s)."""
        missing = [self._signals.told_on(name) for name in self.names if not self._signals.heard(name, signal_age)]
        old = self._measured < 0.0 or time.monotonic() - self._measured > temperature_age
        return [*(["temperature"] if self._thermal and old else []), *missing]

    def _on_temperature(self, message: Temperature) -> None:
        if not COLDEST <= message.temperature <= HOTTEST:
            self._health.refuse(f"temperature refused: {message.temperature:g} degC, expected {COLDEST:g} to {HOTTEST:g}")
            return
        self.temperature, self._measured = message.temperature, time.monotonic()
