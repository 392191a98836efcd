"""ROS arguments of single nodes, for several axes in one process; what rclpy is initialised with goes to every node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar

from rclpy.node import Node

_OWN: ContextVar[list[str] | None] = ContextVar("own arguments", default=None)


def own_arguments() -> list[str] | None:
    """The arguments of the node that is being made beside those of the process, None for no others."""
    return _OWN.get()


def made_with(factory: Callable[[], Node], arguments: Sequence[str]) -> Node:
    """A new node with arguments of its own, which win over those of the process."""
    before = _OWN.set(list(arguments))
    try:
        return factory()
    finally:
        _OWN.reset(before)
