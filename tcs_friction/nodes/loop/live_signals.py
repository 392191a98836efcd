"""Signals that act on an axis, such as wind or another axis' speed, heard on the topics that an axis file names."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from tcs_friction.control.stamps import SECOND
from tcs_friction.nodes.core.convert import nanoseconds
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.qos import COLLECT
from tcs_friction.recording.signals import SignalSource

NAME_LISTS = ("name", "names", "joint_names")
"""Fields of a message that may list its joints."""
NO_NUMBER = (AttributeError, IndexError, StopIteration, TypeError, ValueError)
"""What reading a field that is not there may raise."""


@dataclass
class Signal:
    """The newest value of a signal, its rate per second, its stamp (ns), and when it came (steady time, s; -1: never yet)."""

    source: SignalSource
    value: float = 0.0
    rate: float = 0.0
    stamp: int = 0
    heard: float = -1.0


class LiveSignals:
    """Subscribes once a topic's type is known; `look` is to be called now and then until it is. `begun`: a first value came."""

    def __init__(self, node: Node, health: Health, begun: Callable[[], None]) -> None:
        self._node, self._health, self._begun = node, health, begun
        self._signals: dict[str, Signal] = {}
        self._subscriptions: dict[str, Any] = {}

    def follow(self, sources: Mapping[str, SignalSource]) -> None:
        """Hear these signals, by name, and no others. What is heard already goes on."""
        known = self._signals
        self._signals = {
            name: known[name] if name in known and known[name].source == source else Signal(source)
            for name, source in sources.items()
        }
        topics = {signal.source.topic for signal in self._signals.values()}
        for topic in set(self._subscriptions) - topics:
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        self.look()

    def look(self) -> None:
        """Subscribe to the topics whose type is known by now."""
        lacking = {signal.source.topic for signal in self._signals.values()} - set(self._subscriptions)
        types = dict(self._node.get_topic_names_and_types()) if lacking else {}
        for topic in lacking & set(types):
            kind = _message_type(types[topic][0])
            if kind is None:
                self._health.doubt(f"type of {topic}", f"{topic} has type {types[topic][0]}, which is not installed here")
                continue
            self._health.well(f"type of {topic}")
            self._subscriptions[topic] = self._node.create_subscription(kind, topic, self._listener(topic), COLLECT)

    def _listener(self, topic: str) -> Any:
        def listen(message: Any) -> None:
            for signal in self._signals.values():
                if signal.source.topic == topic:
                    self._take(signal, message)

        return listen

    def _take(self, signal: Signal, message: Any) -> None:
        source = signal.source
        try:
            value = source.si(number_in(message, source))
        except NO_NUMBER:
            self._health.refuse(f"{source.topic} refused: it has no number {source.field} of {source.joint or 'its own'}")
            return
        if not math.isfinite(value):
            self._health.refuse(f"{source.topic} refused: {source.field} is {value}")
            return
        now = time.monotonic()
        stamp = nanoseconds(message.header.stamp) if hasattr(message, "header") else round(now * SECOND)
        gap = (stamp - signal.stamp) / SECOND
        if signal.heard >= 0.0 and gap == 0.0:
            return  # said again
        signal.rate = (value - signal.value) / gap if signal.heard >= 0.0 and gap > 0.0 else 0.0
        first = signal.heard < 0.0
        signal.value, signal.stamp, signal.heard = value, stamp, now
        if first:
            self._begun()

    def heard(self, name: str, age: float = math.inf) -> bool:
        """Whether a signal is there and not older than `age` seconds."""
        signal = self._signals.get(name)
        return signal is not None and signal.heard >= 0.0 and time.monotonic() - signal.heard <= age

    def named(self, name: str) -> bool:
        """Whether it is known on which topic a signal comes."""
        return name in self._signals

    def told_on(self, name: str) -> str:
        """A signal and its topic, in words."""
        return f"{name} ({self._signals[name].source})" if name in self._signals else f"{name} (on no topic of the axis file)"

    def values(self, names: Sequence[str]) -> list[float]:
        """Each signal's value and rate, 0 where it was not heard."""
        found: list[float] = []
        for name in names:
            signal = self._signals.get(name)
            found += (signal.value, signal.rate) if signal is not None else (0.0, 0.0)
        return found


def _message_type(name: str) -> Any:
    """The class of `package/msg/Name`, None if it is not installed."""
    package, _, kind = name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError):
        return None


def number_in(message: Any, source: SignalSource) -> float:
    """The number that a source names in a message. Raises one of NO_NUMBER where it has none."""
    value, holder = message, message
    for step in source.steps:
        if isinstance(step, int):
            value = value[step]
        else:
            value, holder = getattr(value, step), value
    if source.joint is not None:
        names = next(getattr(holder, field) for field in NAME_LISTS if hasattr(holder, field))
        value = value[list(names).index(source.joint)]
    return float(value)
