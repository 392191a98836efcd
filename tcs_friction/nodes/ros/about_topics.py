"""`topic list|type|info|echo|hz|pub`."""

from __future__ import annotations

import argparse
import math
import time
from collections import deque
from typing import Any

import numpy as np
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from tcs_friction.errors import InputError, JobError, nearest
from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.ros.asker import ANSWER_LIMIT, POLL, Asker, absolute, print_names
from tcs_friction.nodes.ros.interface_values import as_yaml, from_yaml, interface

UNNAMED = "_NODE_NAME_UNKNOWN_"
"""In place of the name of a node of which no more is known than that it publishes or hears."""
KEPT = 1000
"""Messages that wait for a terminal that is slow."""
TOLD_EVERY = 1.0  # s
LAST_WORDS = 0.1  # s that the last message has to leave


def list_topics(asker: Asker, arguments: argparse.Namespace) -> None:
    """Names, with types if wanted."""
    print_names(asker.settled(asker.topics), arguments.show_types, arguments.count)


def type_of_topic(asker: Asker, arguments: argparse.Namespace) -> None:
    """The type of its messages."""
    print(_type(asker, absolute(arguments.name)))


def about_topic(asker: Asker, arguments: argparse.Namespace) -> None:
    """Its type, and who publishes and hears it."""
    name, node = absolute(arguments.name), asker.node
    sides = {"Publisher": node.get_publishers_info_by_topic, "Subscription": node.get_subscriptions_info_by_topic}

    def ends() -> dict[str, list[str]]:
        return {side: [str(end) for end in look(name)] for side, look in sides.items()}

    kind = _type(asker, name)
    asker.settled(ends)
    asker.until(lambda: UNNAMED not in str(ends()), ANSWER_LIMIT)
    print(f"Type: {kind}\n")
    for side, found in ends().items():
        print(f"{side} count: {len(found)}")
        if arguments.verbose:
            print("\n" + "".join(f"{text}\n\n" for text in found), end="")


def echo_topic(asker: Asker, arguments: argparse.Namespace) -> None:
    """Every message as YAML, until Ctrl-C or after the first."""
    name = absolute(arguments.name)
    kind = interface(arguments.type or _type(asker, name), "msg")
    done: list[bool] = []

    def show(message: Any) -> None:
        if not (arguments.once and done):
            print(as_yaml(_field(message, arguments.field)), end="")
            print("---", flush=True)
            done.append(True)

    asker.node.create_subscription(kind, name, show, _profile(asker, name))
    asker.until(lambda: bool(arguments.once and done))


def rate_of_topic(asker: Asker, arguments: argparse.Namespace) -> None:
    """How often a message comes, every second until Ctrl-C."""
    name = absolute(arguments.name)
    came: deque[float] = deque(maxlen=arguments.window)
    kind = interface(_type(asker, name), "msg")
    asker.node.create_subscription(kind, name, lambda _: came.append(time.monotonic()), _profile(asker, name), raw=True)
    newest = -math.inf
    while True:
        end = time.monotonic() + TOLD_EVERY
        asker.until(lambda end=end: time.monotonic() > end)  # type: ignore[misc]
        if len(came) > 1 and came[-1] > newest:
            newest, gaps = came[-1], np.diff(came)
            print(f"average rate: {1.0 / gaps.mean():.3f}")
            spread = f"min: {gaps.min():.3f}s max: {gaps.max():.3f}s std dev: {gaps.std():.5f}s"
            print(f"\t{spread} window: {len(came)}", flush=True)
        else:
            print("no new messages", flush=True)


def publish(asker: Asker, arguments: argparse.Namespace) -> None:
    """Publish a message again and again, so many times, or once as soon as somebody hears it."""
    if not (math.isfinite(arguments.rate) and arguments.rate > 0.0):
        raise InputError("--rate", f"{arguments.rate:g} 1/s", "more than 0")
    message = from_yaml(interface(arguments.type, "msg"), arguments.values)
    publisher = asker.node.create_publisher(type(message), absolute(arguments.name), LISTEN)
    times = 1 if arguments.once else arguments.times
    if times and not asker.until(lambda: publisher.get_subscription_count() > 0, TOLD_EVERY):
        print("Waiting for at least 1 matching subscription(s)...", flush=True)
        asker.until(lambda: publisher.get_subscription_count() > 0)
    print("publisher: beginning loop", flush=True)
    due, count = time.monotonic(), 0
    while not times or count < times:
        count += 1
        print(f"publishing #{count}: {message!r}\n", flush=True)
        publisher.publish(message)
        due += 1.0 / arguments.rate
        while times != count and time.monotonic() < due:
            time.sleep(min(POLL, max(0.0, due - time.monotonic())))
    time.sleep(LAST_WORDS)


def _type(asker: Asker, name: str) -> str:
    """The type of a topic that somebody has. Raises JobError."""
    types = asker.types("topic", name, asker.topics)
    if len(types) > 1:
        raise JobError(f"topic {name}", f"has the types {', '.join(types)}", "one")
    return types[0]


def _profile(asker: Asker, name: str) -> QoSProfile:
    """What hears every publisher: best effort where one of them is, and latched messages where all latch."""
    asker.until(lambda: asker.node.count_publishers(name) > 0, ANSWER_LIMIT)
    ends = [end.qos_profile for end in asker.node.get_publishers_info_by_topic(name)]
    reliable = all(end.reliability == ReliabilityPolicy.RELIABLE for end in ends)
    latched = bool(ends) and all(end.durability == DurabilityPolicy.TRANSIENT_LOCAL for end in ends)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=KEPT,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _field(message: Any, path: str) -> Any:
    """A part of a message by the names of its fields; all of it without a path. Raises InputError."""
    for name in filter(None, path.split(".")):
        fields: dict[str, str] = getattr(message, "get_fields_and_field_types", dict)()
        if name not in fields:
            raise InputError(f"--field {path}", f"no field {name}", nearest(name, fields))
        message = getattr(message, name)
    return message


VERBS = {
    "list": list_topics,
    "type": type_of_topic,
    "info": about_topic,
    "echo": echo_topic,
    "hz": rate_of_topic,
    "pub": publish,
}
