"""What can be known of a controller of ros2_control by messages that every ROS installation has.

Its joints and their order come from its own parameters, its state from the diagnostics of the controller manager, and
whether somebody else commands it from its topic of commands. The services of controller_manager_msgs are not used: their
definitions differ between releases of ROS, and which controllers hold a robot is the decision of whoever stands beside it.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray

from tcs_friction.nodes.core.qos import COLLECT, LISTEN
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.core.wire import message_of

ASK_EVERY = 1.0  # s
SILENT = 5.0
"""s without an answer after which nothing is known: controllers answer in milliseconds, diagnostics come once a second."""
REMEMBERED = 1.0
"""s for which a command of somebody else counts."""
SENT = 2000
"""Own commands that are known again when they are heard."""
ACTIVITY = ": Controllers Activity"
"""How the name of the diagnostics of a controller manager ends."""
ACTIVE = "active"
NO_MANAGER = "none"


class ControllerWatch:
    """The joints of a controller and its state, asked for and listened to from the beginning on."""

    joints: tuple[str, ...] = ()
    interface = ""

    def __init__(self, node: Node, controller: str, manager: str) -> None:
        """controller: name of its node, with namespace. manager: likewise; NO_MANAGER where there are no diagnostics."""
        self.controller, self._manager = controller, manager
        self._state, self._state_at = "", -SILENT
        self._pending: Future | None = None
        self._asked_at, self._answered_at = 0.0, -SILENT
        self._client = node.create_client(GetParameters, f"{controller}/get_parameters")
        if manager != NO_MANAGER:
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, COLLECT)
        steady_timer(node, ASK_EVERY, self._ask)

    def unknown(self, now: float) -> str:
        """What keeps the joints from being known, "" when they are."""
        if self.joints and now - self._answered_at < SILENT:
            return ""
        return f"{self.controller} does not tell its joints (parameter service): is it loaded?"

    def inactive(self, now: float) -> str:
        """Why the controller cannot be relied on to be active, "" when it can, with what to do."""
        if self._manager == NO_MANAGER:
            return ""
        if now - self._state_at >= SILENT:
            return f"{self._manager} says nothing of its controllers on /diagnostics; set manager to {NO_MANAGER} where none does"
        if self._state != ACTIVE:
            name = _last(self.controller)
            where = "" if _last(self._manager) == "controller_manager" else f" -c {self._manager}"
            return f"{name} is {self._state or 'not loaded'}: ros2 control switch_controllers --activate {name}{where}"
        return ""

    def _ask(self) -> None:
        """Again and again: a controller can be unloaded, and loaded with other joints."""
        now = time.monotonic()
        if self._pending is not None and now - self._asked_at < SILENT:
            return
        if self._pending is not None:
            self._client.remove_pending_request(self._pending)
            self._pending = None
        if self._client.service_is_ready():
            self._asked_at = now
            self._pending = self._client.call_async(GetParameters.Request(names=["joints", "interface_name"]))
            self._pending.add_done_callback(self._on_answer)

    def _on_answer(self, answer: Future) -> None:
        self._pending = None
        result: Any = answer.result()
        values: Any = result.values if result is not None else []
        if len(values) == 2 and values[0].type == ParameterType.PARAMETER_STRING_ARRAY:
            self.joints = tuple(values[0].string_array_value)
            self.interface = values[1].string_value
            self._answered_at = time.monotonic()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith(ACTIVITY) and _last(status.name.removesuffix(ACTIVITY)) == _last(self._manager):
                key = f"{_last(self.controller)}.state"
                self._state = next((item.value for item in status.values if item.key == key), "")
                self._state_at = time.monotonic()


class OtherCommands:
    """Whether somebody else commands the same controller. Listens only while there is another publisher.

    A publisher that was killed is remembered by discovery for a while; it says nothing, and does not count.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self._sent: deque[bytes] = deque(maxlen=SENT)
        self._heard_at = -math.inf
        self._heard = b""
        self.replaced = False
        """Whether a command of our own has followed theirs."""
        self._subscription: Any = None

    def sent(self, data: bytes) -> None:
        """A command of our own."""
        self._sent.append(data)
        self.replaced = True

    @property
    def efforts(self) -> tuple[float, ...] | None:
        """The last command of somebody else, N m for each joint of the controller; None before the first."""
        message = message_of(self._heard, Float64MultiArray) if self._heard else None
        return None if message is None else tuple(message.data)

    def silent(self, now: float, limit: float) -> bool:
        """Whether nobody else has commanded for so many seconds."""
        return now - self._heard_at >= limit

    def look(self) -> None:
        """From time to time: listen while there are others."""
        others = self._node.count_publishers(self._topic) > 1
        if others and self._subscription is None:
            self._subscription = self._node.create_subscription(Float64MultiArray, self._topic, self._hear, LISTEN, raw=True)
        elif not others and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def objection(self, now: float) -> str:
        """That somebody else commands, "" when nobody does."""
        if now - self._heard_at >= REMEMBERED:
            return ""
        return f"somebody else commands {self._topic}: ros2 topic info --verbose {self._topic}"

    def _hear(self, data: bytes) -> None:
        if data not in self._sent:
            self._heard_at, self._heard = time.monotonic(), data
            self.replaced = False


def _last(name: str) -> str:
    """A node's name without its namespace."""
    return name.rstrip("/").rpartition("/")[2]
