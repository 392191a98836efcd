"""Records topics as they come, raw, into a bag that survives the death of this process.

What limits it: taking a message from the middleware costs 25 to 30 us, writing it 3 us.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks

from tcs_friction.control.config_field import choice, setting, text, texts
from tcs_friction.nodes.bags.bag_topics import message_class, recorded_channel, subscription_profile
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.plain_node import PlainNode
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.recording.record import BagRecorder

SECOND = 1_000_000_000


@dataclass(frozen=True)
class RecorderConfig:
    """What to record, and into what."""

    bag: str = text("", "directory to write; empty for recording_DATE_TIME here")
    topics: tuple[str, ...] = texts("topics to record; none, and no axis: all")
    axis: str = text("", "axis file: record what is in this namespace, and the signals that the file names")
    compression: str = choice("none", ("none", "lz4", "zstd"), "compression of the chunks of the file")
    split_size: float = setting(0.0, "MB", 0.0, 1e6, "begin a new file at this size; 0 for never")
    split_duration: float = setting(0.0, "s", 0.0, 1e6, "begin a new file after this time; 0 for never")
    flush_period: float = setting(0.5, "s", 0.01, 1.0, "what is older than this survives when the process is killed")
    discovery_period: float = setting(0.2, "s", 0.01, 10.0, "how often to look for new topics")


class RecorderNode(PlainNode[RecorderConfig]):
    """Subscribes to topics as they appear; a message is never deserialised."""

    def __init__(self) -> None:
        super().__init__("recorder", RecorderConfig())
        config = self.config
        path = Path(config.bag or time.strftime("recording_%Y%m%d_%H%M%S"))
        compression = "" if config.compression == "none" else config.compression
        size, span = int(config.split_size * 1e6), int(config.split_duration * SECOND)
        self.bag = BagRecorder(path, compression, size, span)
        self.lost = 0
        self._wanted = set(self.resolved(config.topics))
        self._own = ""  # what the names of this axis' topics begin with, "" if they are not asked for
        if config.axis:
            self._own = f"{self.get_namespace().rstrip('/')}/"
            self._wanted |= _signals(config.axis)
        self._seen: set[str] = set()
        self._now: Callable[[], int] = time.time_ns
        if self.get_parameter("use_sim_time").value:
            self._now = lambda: int(self.get_clock().now().nanoseconds)
        steady_timer(self, config.discovery_period, self._discover)
        steady_timer(self, config.flush_period, self.bag.flush)
        self.get_logger().info(f"recording into {path}")
        self._discover()

    def destroy_node(self) -> None:
        """Finish the bag and say what is in it. Raises JobError when the disk does not take the end of it."""
        try:
            self.bag.close()
        finally:
            counts = ", ".join(f"{topic} {count}" for topic, count in self.bag.counts.items()) or "nothing"
            lost = f"; {self.lost} messages lost on the way here" if self.lost else ""
            self.get_logger().info(f"recorded {counts}{lost}")
            super().destroy_node()

    def condition(self) -> tuple[str, dict[str, str]]:
        """Messages recorded and lost."""
        awaited = sorted(self._wanted - self._seen)
        problem = f"{self.lost} messages lost on the way here" if self.lost else ""
        if awaited:
            problem = f"nobody publishes {', '.join(awaited)}"
        return problem, {"bag": str(self.bag.path), **{topic: str(count) for topic, count in self.bag.counts.items()}}

    def _discover(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            if topic not in self._seen and self._asked(topic):
                offered = self.get_publishers_info_by_topic(topic)
                if offered:
                    self._seen.add(topic)
                    self._subscribe(topic, kinds[0], offered)

    def _asked(self, topic: str) -> bool:
        if self._own and topic.startswith(self._own):
            return True
        return topic in self._wanted or not (self._wanted or self._own)

    def _subscribe(self, topic: str, msgtype: str, offered: list[Any]) -> None:
        kind = message_class(msgtype)
        if kind is None:
            self.get_logger().warning(f"{topic} is not recorded: package of {msgtype} not installed")
            return
        channel, type_hash = recorded_channel(topic, msgtype, offered)
        if not channel.definition:
            self.get_logger().warning(f"{topic} is recorded without the definition of {msgtype}, which was not found")
        number = self.bag.add_topic(channel, type_hash)
        write, now = self.bag.write, self._now
        events = SubscriptionEventCallbacks(message_lost=self._on_lost)
        profile = subscription_profile([endpoint.qos_profile for endpoint in offered])
        self.create_subscription(
            kind, topic, lambda raw: write(number, now(), raw), profile, event_callbacks=events, raw=True
        )

    def _on_lost(self, event: Any) -> None:
        self.lost += event.total_count_change
        self.get_logger().warning(f"{self.lost} messages lost on the way to the recorder", throttle_duration_sec=1.0)


def _signals(name: str) -> set[str]:
    """The topics that an axis file names. Reading it loads all of physics, which a recorder does without otherwise."""
    from tcs_friction.nodes.core.files import axis_file

    signals = axis_file(name).signals
    return set() if signals is None else set(signals.topics)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(RecorderNode, args=args)
