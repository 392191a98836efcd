"""Two publishers of a topic that may have one only, in real time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Protocol

from tcs_friction.nodes.base import AxisNode
from tcs_friction.nodes.steady import steady_timer

LOOK_EVERY = 0.1  # s
REMEMBERED = 1.0
"""s after the last contradiction in which two publishers still count as rivals."""


class HeardInput(Protocol):
    """What knows when (steady time, s) it last heard messages that contradict each other."""

    @property
    def contradicted(self) -> float: ...


class Rivals:
    """Notices, in real time, a second publisher of any of a node's inputs, and reports it through the node's health.

    A publisher that was killed is remembered by discovery for a while, hence it takes a contradiction as well.
    """

    def __init__(self, node: AxisNode[Any], inputs: Mapping[str, HeardInput]) -> None:
        self._node = node
        self._health = node.health
        self._inputs = inputs
        self.topics: set[str] = set()
        """Topics on which two publishers contradict each other."""
        if not node.lock_step:
            steady_timer(node, LOOK_EVERY, self._look)

    def _look(self) -> None:
        now = time.monotonic()
        for topic, heard in self._inputs.items():
            count = self._node.count_publishers(topic)
            if count < 2:
                self.topics.discard(topic)
                self._health.well(f"rivals {topic}")
                continue
            found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
            names = ", ".join(sorted(f"{item.node_namespace.rstrip('/')}/{item.node_name}" for item in found))
            if now - heard.contradicted < REMEMBERED:
                self.topics.add(topic)
                self._health.fail(f"rivals {topic}", f"{count} publishers of {topic} contradict each other: {names}")
            else:
                self.topics.discard(topic)
                self._health.doubt(f"rivals {topic}", f"{count} publishers of {topic}: {names}")
