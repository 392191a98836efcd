"""The newest messages of some topics, raw, so that a bag can begin before what it is about."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node

from tcs_friction.nodes.bags.bag_topics import message_class, recorded_channel, subscription_profile
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.record import BagRecorder
from tcs_friction.writable import writing

Kept = tuple[int, int, int, bytes]
"""Position on the ring's clock (ns), log time (ns), number of the topic, payload."""


class EventRing:
    """Keeps what is younger than `span` (ns) on the clock of the stamps that `keep` is given."""

    def __init__(self, span: int) -> None:
        self.span = span
        self.now = 0
        self._channels: list[tuple[Channel, str]] = []
        self._kept: deque[Kept] = deque()

    def __len__(self) -> int:
        return len(self._kept)

    def add_topic(self, channel: Channel, type_hash: str) -> int:
        """Announce a topic; the number to keep its messages with."""
        self._channels.append((channel, type_hash))
        return len(self._channels) - 1

    def keep(self, number: int, payload: bytes) -> None:
        """A message that has come now."""
        now, kept = self.now, self._kept
        kept.append((now, time.time_ns(), number, payload))
        while now - kept[0][0] > self.span:
            kept.popleft()

    def restart(self) -> None:
        """Another run: its clock begins anew, and what is kept belongs to the other."""
        self._kept.clear()

    def copy(self) -> tuple[list[tuple[Channel, str]], list[Kept]]:
        """What is kept now, for `write_bag` in a thread."""
        return list(self._channels), list(self._kept)


def write_bag(path: Path, channels: Sequence[tuple[Channel, str]], kept: Sequence[Kept]) -> None:
    """Messages into a new bag, which gets its name when it is complete. Raises InputError or JobError."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    try:
        bag = BagRecorder(scratch / path.name, "zstd")
        for channel, type_hash in channels:
            bag.add_topic(channel, type_hash)
        for _, log_time, number, payload in kept:
            bag.write(number, log_time, payload)
        bag.close()
        with writing(path):
            os.rename(scratch / path.name, path)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def new_name(folder: Path, stem: str) -> Path:
    """A path below `folder` that nothing has: `stem`, else `stem_2` and so on."""
    path, number = folder / stem, 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{number}"
    return path


class RingTopics:
    """Subscribes a node to the wanted topics as they appear, and keeps their messages; those of `heard` the node keeps itself."""

    def __init__(self, node: Node, ring: EventRing, wanted: Sequence[str], heard: Sequence[str]) -> None:
        self._node, self._ring = node, ring
        self._wanted, self._heard = set(wanted) | set(heard), set(heard)
        self.numbers: dict[str, int] = {}
        """Of the topics that the ring has, by name."""

    def look(self) -> None:
        """Subscribe to what is published by now."""
        lacking = self._wanted - set(self.numbers)
        types: dict[str, Any] = dict(self._node.get_topic_names_and_types()) if lacking else {}
        for topic in lacking & set(types):
            offered = self._node.get_publishers_info_by_topic(topic)
            kind = message_class(types[topic][0])
            if offered and kind is not None:
                self._add(topic, types[topic][0], kind, offered)

    def _add(self, topic: str, msgtype: str, kind: Any, offered: Sequence[Any]) -> None:
        number = self.numbers[topic] = self._ring.add_topic(*recorded_channel(topic, msgtype, offered))
        if topic in self._heard:
            return
        keep = self._ring.keep
        profile = subscription_profile([endpoint.qos_profile for endpoint in offered])
        self._node.create_subscription(kind, topic, lambda raw: keep(number, raw), profile, raw=True)
