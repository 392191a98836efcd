"""Two publishers of a topic that may have one only, in real time.

A publisher that was killed is remembered by discovery for a while (`LEASE`). Two are therefore rivals when they contradict each
other, or, of a topic that nobody else ever publishes, when both have been there for longer than that.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from typing import Any, Protocol

from tcs_friction.nodes.core.base import AxisNode
from tcs_friction.nodes.core.steady import steady_timer

LOOK_EVERY = 0.1  # s
REMEMBERED = 1.0
"""s after the last contradiction in which two publishers still count as rivals."""
LEASE = 25.0
"""s until a publisher that was killed is forgotten: 20 by default in Fast DDS, and some more."""


class HeardInput(Protocol):
    """What knows when (steady time, s) it last heard messages that contradict each other."""

    @property
    def contradicted(self) -> float: ...


class Rivals:
    """Notices, in real time, a second publisher of any of a node's inputs, and reports it through the node's health."""

    def __init__(self, node: AxisNode[Any], inputs: Mapping[str, HeardInput], exclusive: Collection[str] = ()) -> None:
        """Of an `exclusive` topic there may never be two publishers."""
        self._node = node
        self._health = node.health
        self._inputs, self._exclusive = inputs, exclusive
        self._since: dict[str, dict[bytes, float]] = {topic: {} for topic in inputs}
        self._lasting: set[str] = set()
        if not node.lock_step:
            steady_timer(node, LOOK_EVERY, self._look)

    @property
    def topics(self) -> set[str]:
        """Topics that have rivals at this moment: no torque is based on them."""
        now = time.monotonic()
        return self._lasting | {topic for topic, heard in self._inputs.items() if self._contested(topic, heard, now)}

    def _contested(self, topic: str, heard: HeardInput, now: float) -> bool:
        return now - heard.contradicted < REMEMBERED and self._node.count_publishers(topic) > 1

    def _look(self) -> None:
        now = time.monotonic()
        for topic, heard in self._inputs.items():
            found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
            self._note_lasting(topic, [bytes(item.endpoint_gid) for item in found], now)
            if len(found) < 2:
                self._health.well(f"rivals {topic}")
                continue
            names = ", ".join(sorted(f"{item.node_namespace.rstrip('/')}/{item.node_name}" for item in found))
            if self._contested(topic, heard, now):
                self._health.fail(f"rivals {topic}", f"{len(found)} publishers of {topic} contradict each other: {names}")
            elif topic in self._lasting:
                self._health.fail(f"rivals {topic}", f"{len(found)} publishers of {topic}, expected one: {names}")
            else:
                self._health.doubt(f"rivals {topic}", f"{len(found)} publishers of {topic}: {names}")

    def _note_lasting(self, topic: str, publishers: list[bytes], now: float) -> None:
        """Whether two publishers have been there for longer than a dead one is remembered."""
        known = self._since[topic]
        since = self._since[topic] = {publisher: known.get(publisher, now) for publisher in publishers}
        lasting = sum(now - first > LEASE for first in since.values())
        if topic in self._exclusive and lasting > 1:
            self._lasting.add(topic)
        else:
            self._lasting.discard(topic)
