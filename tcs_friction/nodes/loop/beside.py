"""Other simulated axes beside this one, which may act on it.

Plants that stand beside each other have one simulated time in lock-step: each goes on from a stamp only when the others have
reached it, and uses what they did at it, the newest of theirs that is not later. The plant that is furthest behind can always
go on, so that none waits for ever, and no value depends on when a message came. A plant that begins anew begins a new run, whose
number stands in its messages: the others begin anew with it, and nobody takes a message of the run before for one of this.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from tcs_friction.control.stamps import SECOND
from tcs_friction.nodes.core.convert import nanoseconds, set_stamp
from tcs_friction.nodes.loop.live_signals import number_in
from tcs_friction.recording.signals import SignalSource

MOTION = "simulated_motion"
"""Topic: true position and velocity and the torque applied; `frame_id` is the number of the run."""
MEASURED = "joint_states"
"""Topic of an axis that an axis file names; of an axis beside, its true motion is taken for it."""
KEPT = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""A plant that starts later gets the last ones: in lock-step it must miss none."""


class Beside:
    """The other plants' motions. `began`: one of them begins a new run, and so must this plant; `moved`: one has gone on."""

    def __init__(self, node: Node, namespaces: Sequence[str], began: Callable[[], None], moved: Callable[[], None]) -> None:
        self._node, self._began, self._moved = node, began, moved
        self._run = 0
        self._motions: dict[str, deque[tuple[int, JointState]]] = {space: deque(maxlen=2) for space in namespaces}
        self._heard = dict.fromkeys(namespaces, -1.0)  # steady time, s
        self._publisher = node.create_publisher(JointState, MOTION, KEPT) if namespaces else None
        for space in namespaces:
            node.create_subscription(JointState, f"{space}/{MOTION}", self._listener(space), KEPT)

    def begin(self) -> None:
        """A new run, which the others will join."""
        self._run += 1
        self._forget()

    def _forget(self) -> None:
        for motions in self._motions.values():
            motions.clear()

    def say(self, joint: str, stamp: int, position: float, velocity: float, torque: float) -> None:
        """Tell the others what this axis does at a stamp (ns): rad, rad/s, N m."""
        if self._publisher is not None:
            message = JointState(name=[joint], position=[position], velocity=[velocity], effort=[torque])
            set_stamp(message, stamp)
            message.header.frame_id = str(self._run)
            self._publisher.publish(message)

    def _listener(self, space: str) -> Callable[[JointState], None]:
        def listen(message: JointState) -> None:
            if message.header.frame_id.isdecimal():
                self._take(space, int(message.header.frame_id), nanoseconds(message.header.stamp), message)

        return listen

    def _take(self, space: str, run: int, stamp: int, message: JointState) -> None:
        if run < self._run:
            return
        motions = self._motions[space]
        lost = run == self._run and bool(motions) and stamp < motions[-1][0]  # it was started again, and knew of no run
        if lost or run > self._run:
            self._run = run + lost
            self._forget()
            self._began()
        if run == self._run and not (motions and stamp == motions[-1][0]):
            motions.append((stamp, message))
        self._heard[space] = time.monotonic()
        self._moved()

    def behind(self, stamp: int) -> dict[str, int]:
        """Lock-step: the axes that have not come to a stamp (ns), with how far each has come, -1 for nowhere."""
        return {
            space: motions[-1][0] if motions else -1
            for space, motions in self._motions.items()
            if not motions or motions[-1][0] < stamp or motions[0][0] > stamp
        }

    def there(self, space: str) -> bool:
        """Whether somebody tells the motion of an axis."""
        return bool(self._node.count_publishers(f"{space}/{MOTION}"))

    def holds(self, source: SignalSource) -> str:
        """The axis beside that a signal is of, "" if it is of none."""
        space, _, topic = source.topic.rpartition("/")
        return space if topic == MEASURED and space in self._motions else ""

    def value(self, source: SignalSource, stamp: int) -> float:
        """A signal of an axis beside at a stamp (ns) that none is behind. Raises what `number_in` does."""
        motions = self._motions[self.holds(source)]
        return number_in(next(message for at, message in reversed(motions) if at <= stamp), source)

    def newest(self, source: SignalSource, age: float) -> tuple[float, float]:
        """A signal's last value and its rate (1/s), 0 before it was heard; the rate of what is older than `age` seconds is 0."""
        space = self.holds(source)
        motions = self._motions[space]
        values = [number_in(message, source) for _, message in motions]
        if len(values) < 2 or time.monotonic() - self._heard[space] > age:
            return (values[-1] if values else 0.0), 0.0
        return values[1], (values[1] - values[0]) * SECOND / (motions[1][0] - motions[0][0])
