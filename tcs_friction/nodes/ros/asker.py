"""The node that asks: it sees the graph, waits, and calls services. It is hidden, and gone when the command ends."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tcs_friction.errors import JobError, nearest

Found = TypeVar("Found")
ANSWER_LIMIT = 5.0  # s, of services, and to find anybody at all; as ros2 waits for services
KNOWN = 0.1  # s that a server gets to find whoever asks: it answers nobody whom it has not found
SETTLED = 0.5  # s without news, after some; Fast DDS announces what is new within milliseconds
POLL = 0.05  # s


class _News:
    """What looks at the graph find; over when others are known, and nothing was new for a while."""

    def __init__(self, node: Node, look: Callable[[], Any]) -> None:
        self._node, self._look, self.found = node, look, look()
        self.others: list[str] = []
        self._since = time.monotonic()

    def are_over(self) -> bool:
        """Look once more."""
        now, seen, others = time.monotonic(), self._look(), _others(self._node)
        if (others, seen) != (self.others, self.found):
            self.others, self.found, self._since = others, seen, now
        return bool(others) and now - self._since > SETTLED


class Asker:
    """A node and its executor, which is spun while something is waited for."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node, self._executor = node, executor

    def until(self, ready: Callable[[], bool], limit: float = float("inf")) -> bool:
        """Spin until a condition holds; whether it did within the limit (s)."""
        deadline = time.monotonic() + limit
        while not ready():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=POLL)
        return True

    def settled(self, look: Callable[[], Found]) -> Found:
        """What a look at the graph finds once others are known."""
        news = _News(self.node, look)
        self.until(news.are_over, ANSWER_LIMIT)
        return news.found

    def types(self, what: str, name: str, look: Callable[[], Found]) -> list[str]:
        """The types of a topic or service by its name, which is waited for: a busy machine tells the graph bit by bit.

        Raises JobError where nobody has it.
        """
        found: Any = {}

        def known() -> bool:
            nonlocal found
            found = look()
            return name in found

        if not self.until(known, ANSWER_LIMIT):
            raise JobError(f"{what} {name}", "not found", nearest(name, found) if _others(self.node) else "its graph to run")
        return list(found[name])

    def services(self) -> dict[str, list[str]]:
        """Types of the services by name, without those that are hidden."""
        return {name: kinds for name, kinds in self.node.get_service_names_and_types() if not hidden(name)}

    def topics(self) -> dict[str, list[str]]:
        """The same of topics."""
        return {name: kinds for name, kinds in self.node.get_topic_names_and_types() if not hidden(name)}

    def offering(self, service: str) -> list[str]:
        """Nodes that have a service of this name below theirs."""
        ending = f"/{service}"
        names = self.settled(self.services)
        return [name.removesuffix(ending) for name in sorted(names) if name.endswith(ending)]

    def ask(self, kind: Any, node: str, service: str, request: Any, times: int = 5) -> Any:
        """The answer of a node's own service, asked for again where none comes: what is asked may be asked twice.

        Raises JobError where the node is not there or does not answer.
        """
        client = self.node.create_client(kind, f"{node}/{service}")
        try:
            if not self.ready(client, ANSWER_LIMIT):
                others = [name for name in self.offering(service) if name != node]  # it may have come or gone meanwhile
                raise JobError(f"node {node}", "not found", nearest(node, others) if others else "its graph to run")
            for _ in range(times):
                future = client.call_async(request)
                if self.until(future.done, ANSWER_LIMIT / times):
                    return future.result()
            raise JobError(f"node {node}", f"no answer of {client.srv_name} within {ANSWER_LIMIT:g} s", "it to be alive")
        finally:
            self.node.destroy_client(client)

    def ready(self, client: Any, limit: float = float("inf")) -> bool:
        """Whether a service is there within the limit (s), and has found who asks."""
        there = self.until(client.service_is_ready, limit)
        self.until(lambda: False, KNOWN)
        return there


@contextmanager
def asking() -> Iterator[Asker]:
    """An asker in a context of its own, beside whatever else of ROS runs in this process."""
    context = Context()
    rclpy.init(args=["ros"], context=context, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    node = Node(f"_tcs_ros_{os.getpid()}", context=context, enable_rosout=False, start_parameter_services=False)
    executor.add_node(node)
    try:
        yield Asker(node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def _others(node: Node) -> list[str]:
    """Names of the nodes that are there for people: there are always topics, those of the node that asks."""
    return sorted(name for name in node.get_node_names() if not hidden(name))


def hidden(name: str) -> bool:
    """Whether a name is not for people: one of its parts begins with an underscore."""
    return any(part.startswith("_") for part in name.split("/"))


def absolute(name: str) -> str:
    """A name as the graph has it; one that begins nowhere begins at the root."""
    return name if name.startswith("/") else f"/{name}"


def print_names(found: Mapping[str, Sequence[str]], types: bool, count: bool) -> None:
    """Names in their order, with their types where these are wanted, or how many there are."""
    if count:
        print(len(found))
        return
    for name, kinds in sorted(found.items()):
        print(f"{name} [{', '.join(kinds)}]" if types else name)
