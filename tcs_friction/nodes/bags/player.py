"""Plays a bag: its messages at their times, on their topics, with their quality of service, and the clock with them.

Services ~/pause and ~/resume. With `clock_rate` the bag's time is published on /clock, for nodes that use simulated time.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from tcs_friction.control.config_field import setting, switch, text, texts
from tcs_friction.errors import InputError, TcsError, nearest
from tcs_friction.nodes.bags.bag_topics import message_class, publisher_profile
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.plain_node import PlainNode
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.definitions import Channel, full_name
from tcs_friction.recording.play import Message, as_cdr, first_time, in_log_order

SECOND = 1_000_000_000
POLL = 0.02  # s
LONGEST_WAIT = 3600.0  # s; what the system can wait for at once ends somewhere
LAST_SECOND = 2**31 - 1  # that a ROS time can tell


@dataclass(frozen=True)
class PlayerConfig:
    """What to play, and how."""

    bag: str = text("", "bag to play")
    topics: tuple[str, ...] = texts("topics to play; none for all")
    rate: float = setting(1.0, "1", 0.001, 1000.0, "how many times faster than it was recorded")
    loop: bool = switch(False, "begin anew at the end")
    start_offset: float = setting(0.0, "s", 0.0, 1e9, "leave out so much at the beginning")
    delay: float = setting(1.0, "s", 0.0, 3600.0, "wait before the first message, for subscribers to be found")
    subscribers: int = setting(0, "", 0, 1000, "wait until every topic has so many, before the delay")
    paused: bool = switch(False, "wait for ~/resume before the first message")
    clock_rate: float = setting(0.0, "Hz", 0.0, 10000.0, "publish /clock so often (of wall time); 0 for never")


class Pace:
    """When a time of the bag is due on the wall clock; stands still while paused. Times of the bag in ns, else s."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._changed = threading.Condition()
        self._paused_at: float | None = None
        self._origin = 0.0
        self._begin = 0
        self.stopped = False

    def start(self, begin: int) -> None:
        """`begin` is due now."""
        with self._changed:
            self._origin, self._begin = time.monotonic(), begin
            if self._paused_at is not None:
                self._paused_at = self._origin

    def pause(self) -> None:
        """Stand still."""
        with self._changed:
            if self._paused_at is None:
                self._paused_at = time.monotonic()
                self._changed.notify_all()

    def resume(self) -> None:
        """Go on where it stood."""
        with self._changed:
            if self._paused_at is not None:
                self._origin += time.monotonic() - self._paused_at
                self._paused_at = None
                self._changed.notify_all()

    def stop(self) -> None:
        """Nothing is due any more."""
        with self._changed:
            self.stopped = True
            self._changed.notify_all()

    def bag_time(self) -> int:
        """The bag's time now."""
        with self._changed:
            now = time.monotonic() if self._paused_at is None else self._paused_at
            return self._begin + int((now - self._origin) * self.rate * SECOND)

    def wait(self, due: int) -> bool:
        """Return when a time of the bag is due: True, or False when stopped."""
        while not self.stopped:
            if self._paused_at is None:
                left = self._origin + (due - self._begin) / (self.rate * SECOND) - time.monotonic()
                if left <= 0.0:
                    return True
            with self._changed:
                if self._paused_at is not None:
                    self._changed.wait(0.1)
                elif left > 0.0 and not self.stopped:
                    self._changed.wait(min(left, LONGEST_WAIT))
        return False


class PlayerNode(PlainNode[PlayerConfig]):
    """One thread publishes at the bag's pace; the executor serves pause and resume, and ends the node when the thread is done."""

    def __init__(self, at_end: Callable[[], object] = rclpy.try_shutdown) -> None:
        super().__init__("player", PlayerConfig())
        self._at_end = at_end
        if not self.config.bag:
            raise InputError("player: parameter bag", "is empty", "the bag to play")
        self._bag = Bag(Path(self.config.bag))
        self._topics = self.resolved(self.config.topics) or None
        self._outlets: dict[Channel, Publisher | None] = {}
        self.count = 0
        self.pace = Pace(self.config.rate)
        if self.config.paused:
            self.pace.pause()
        self._first = first_time(self._bag, self._topics)
        if not self._first:
            known = [channel.topic for channel in self._bag.channels]
            wanted = " ".join(self._topics or ())
            raise InputError(f"{self.config.bag}", f"no message on {wanted or 'any topic'}", nearest(wanted, known))
        self.create_service(Trigger, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self._clock_outlet = self.create_publisher(Clock, "/clock", 10) if self.config.clock_rate else None
        self.get_logger().info(f"ready to play {self.config.bag}")
        self._finished = threading.Event()
        steady_timer(self, POLL, self._look)
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop playing."""
        self.pace.stop()
        self._bag.abandon()
        self._thread.join()
        super().destroy_node()

    def condition(self) -> tuple[str, dict[str, str]]:
        """How far it is."""
        if not self.count and (lonely := self._lonely()):
            return f"waiting for subscribers of {', '.join(lonely)}", {"bag": self.config.bag}
        played = max(self.pace.bag_time() - self._first, 0) / SECOND if self.count else 0.0
        return "", {"bag": self.config.bag, "messages": str(self.count), "time of the bag [s]": f"{played:.3f}"}

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.pace.pause()
        response.success = True
        return response

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.pace.resume()
        response.success = True
        return response

    def _look(self) -> None:
        """In the executor's thread: from another one the end would come while a callback may be publishing."""
        if self._finished.is_set():
            self._finished.clear()
            self._at_end()

    def _play(self) -> None:
        """The thread: everything once, or over and over."""
        try:
            self._announce()
            begin = self._first + int(self.config.start_offset * SECOND)
            again = True
            while again and not self.pace.stopped:
                messages = in_log_order(self._bag, self._topics, begin)
                head = list(itertools.islice(messages, 1))  # found before the time runs
                self.pace.start(begin)
                played = self._play_once(itertools.chain(head, messages))
                again = self.config.loop and played > 0
            unheard = set(self._topics or ()) - {channel.topic for channel in self._outlets}
            for topic in () if self.pace.stopped else sorted(unheard):
                self.get_logger().warning(f"no message on {topic} in {self.config.bag}")
            for note in self._bag.notes:
                self.get_logger().warning(note)
        except TcsError as error:
            self.get_logger().error(str(error))
        finally:
            if not self.pace.stopped:
                for outlet in filter(None, self._outlets.values()):
                    outlet.wait_for_all_acked(Duration(seconds=1.0))
                self.get_logger().info(f"played {self.count} messages")
                self._finished.set()

    def _announce(self) -> None:
        """Make the publishers of the bag's first second, then leave subscribers time to find them."""
        for _, channel, _ in self._head():
            self._publisher(channel)
        if lonely := self._lonely():
            least = f"{self.config.subscribers} subscriber{'s' if self.config.subscribers > 1 else ''}"
            self.get_logger().info(f"waiting for {least} of {', '.join(lonely)}; `topics` names what to play")
        while self._lonely() and not self.pace.stopped:
            time.sleep(POLL)
        self.pace.start(0)
        end = int(self.config.delay * SECOND * self.config.rate)
        if not self.config.paused:
            self.pace.wait(end)

    def _lonely(self) -> list[str]:
        """Topics that lack subscribers."""
        outlets = filter(None, list(self._outlets.values()))
        return [outlet.topic_name for outlet in outlets if outlet.get_subscription_count() < self.config.subscribers]

    def _head(self) -> Iterator[Message]:
        for message in in_log_order(self._bag, self._topics):
            if message[0] > self._first + SECOND:
                return
            yield message

    def _play_once(self, messages: Iterator[Message]) -> int:
        step = int(SECOND * self.config.rate / self.config.clock_rate) if self._clock_outlet else 0
        tick = 0
        played = 0
        for due, channel, payload in messages:
            while step and (tick := tick or due) <= due:
                if not self.pace.wait(tick):
                    return played
                self._publish_clock(tick)
                tick += step
            if not self.pace.wait(due):
                return played
            publisher = self._publisher(channel)
            message = as_cdr(channel, payload) if publisher is not None else None
            if message is not None:
                publisher.publish(message)
                played += 1
                self.count += 1
        return played

    def _publish_clock(self, now: int) -> None:
        assert self._clock_outlet is not None
        if not 0 <= now // SECOND <= LAST_SECOND:
            return
        self._clock_outlet.publish(Clock(clock=Time(sec=now // SECOND, nanosec=now % SECOND)))

    def _publisher(self, channel: Channel) -> Any:
        if channel not in self._outlets:
            kind = message_class(full_name(channel.msgtype))
            if kind is None or channel.encoding not in ("cdr", "ros1"):
                self.get_logger().warning(f"{channel.topic} is not played: no {channel.msgtype} installed, or not cdr")
                self._outlets[channel] = None
                return None
            try:
                self._outlets[channel] = self.create_publisher(kind, channel.topic, publisher_profile(channel.qos))
            except NameValidationException:  # names may hold anything in a bag
                self.get_logger().warning(f"{channel.topic} is not played: no name that a topic can have")
                self._outlets[channel] = None
        return self._outlets[channel]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(PlayerNode, args=args)
