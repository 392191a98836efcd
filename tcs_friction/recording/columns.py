"""What decoding gives and aligning takes: the columns of one topic, in the order in which they were logged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalSource

Nanoseconds = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class TopicColumns:
    """The wanted signals of one topic, one row a message.

    log_times: (n,) ns, when the recorder got the message. stamps: (n,) ns from the header, None if the type has none.
    values: source -> (n,), already scaled; NaN where the message held NaN or no such joint.
    absent: source -> (n,) true where the message did not have the joint at all; only sources with such messages.
    """

    topic: str
    log_times: Nanoseconds
    stamps: Nanoseconds | None
    values: Mapping[SignalSource, Column]
    absent: Mapping[SignalSource, Mask] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.log_times)


def counted(number: int, what: str) -> str:
    """`1 message`, `2 messages`."""
    return f"{number} {what}{'' if number == 1 else 's'}"
