"""Running nodes: the executor, the main function of every node, clean ends."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from tcs_friction.errors import InputError, TcsError, refusal
from tcs_friction.nodes.core import scheduling
from tcs_friction.nodes.core.peers import ContentError

ARGUMENTS = "-p NAME:=VALUE, -r OLD:=NEW; for a single node --params-file FILE"


def make_executor() -> Any:
    """The events executor where it exists: 6 to 14 times faster than the other in one process."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def spin(executor: Any, done: Future | None = None) -> None:
    """Spin until shutdown or until `done` is complete.

    The events executor of some releases hangs in a spin without a time limit, hence the long ones; and it looks
    at the time only when it has nothing else to do.
    """
    done = done or Future()
    try:
        while rclpy.ok() and not done.done():
            executor.spin_until_future_complete(done, timeout_sec=3600.0)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except rclpy_implementation.RCLError:
        if rclpy.ok():  # otherwise a callback was publishing when the shutdown came
            raise


def close(executor: Any, nodes: Sequence[Node]) -> None:
    """Destroy nodes with their executor, which would otherwise go on to collect events for them, and shut ROS down."""
    try:
        for node in nodes:
            executor.remove_node(node)
            node.destroy_node()
    finally:
        executor.shutdown()
        rclpy.try_shutdown()


def run(*factories: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make nodes, run them on one executor until SIGINT or SIGTERM, and return the exit status.

    ROS' own signal handlers would invalidate everything while a callback may be publishing; here the spin ends between two
    callbacks. An idle executor looks at signals at the next timer, and every node has one.
    """
    try:
        _run(factories, list(sys.argv if args is None else args))
    except (TcsError, OSError) as error:
        told = refusal(error) if isinstance(error, OSError) else error
        shown = told.quoting if isinstance(told, ContentError) else told
        print(f"tcs-friction: {shown}", file=sys.stderr)
        return told.exit_status
    except KeyboardInterrupt:  # while a node was being made
        return 0
    return 0


def _run(factories: Sequence[Callable[[], Node]], args: list[str]) -> None:
    if words := scheduling.prepare():
        print(f"tcs-friction: {words}", file=sys.stderr)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise InputError("ROS arguments", str(error).partition(". Error:")[0], ARGUMENTS) from None
    stop = Future()
    nodes: list[Node] = []
    made = False

    def end(*_: object) -> None:
        if not made:
            raise KeyboardInterrupt  # in the middle of a node's making, which may read a bag for seconds
        if not stop.done():
            stop.set_result(None)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    executor = make_executor()
    try:
        for factory in factories:
            nodes.append(factory())
            executor.add_node(nodes[-1])
            if words := getattr(nodes[-1], "introduction", ""):
                nodes[-1].get_logger().info(words)
        made = True
        scheduling.keep_memory_tidy(nodes[0])
        spin(executor, stop)
    finally:
        made = True  # from here on a second signal must not stop the end
        close(executor, nodes)
