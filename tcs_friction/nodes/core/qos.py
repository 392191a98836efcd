"""Quality of service of the topics, and why.

Everything is reliable: in lock-step a lost message costs a repetition, and in real time a message that is late by a
retransmission is found too old by its stamp, which best effort would not make better. A publisher keeps many
messages, so that a recorder that falls behind for a moment gets every one; in real time fewer, for the middleware forgets
them together, and a thousand take 1 to 2 ms. A control node asks for few, because an old one is of no use to it.
Parameters that were identified are latched: a compensator that starts later gets them.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


PUBLISH = _profile(1000)
PUBLISH_IN_REAL_TIME = _profile(100)
LISTEN = _profile(10)
COLLECT = _profile(10_000)
"""For nodes that need every message and may have to wait for the processor: identifier, diagnoser, commission."""
NEWEST = _profile(1)
"""For a command that the next one replaces: one that has not been delivered by then is of no use."""
LATCHED = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)
