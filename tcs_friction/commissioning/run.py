"""A run of the axis: what was heard of it, its bag, and the run without the errors of the encoder that a model knows."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.position_correction import PositionCorrection
from tcs_friction.control.stamps import SECOND
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.bags import Bag, read_columns
from tcs_friction.recording.encode import TopicData, encoded, joint_states
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.write import EPOCH, write_bag

Array = NDArray[np.float64]

COLUMNS = {
    "joint_states": ("position", "velocity", "effort"),
    "reference": ("position", "velocity", "acceleration"),
    "friction_estimate": ("torque", "velocity", "residual", "valid"),
    "true_friction": ("torque", "velocity", "residual", "valid"),
}


@dataclass(frozen=True)
class Run:
    """What was heard: topic -> time in s and columns as in COLUMNS, each (n,); lengths may differ between topics."""

    joint: str
    topics: dict[str, list[Array]]

    def matched(self, first: str, second: str) -> tuple[list[Array], list[Array]]:
        """The columns of two topics at the stamps that both have."""
        a, b = self.topics[first], self.topics[second]
        _, at_a, at_b = np.intersect1d(a[0], b[0], return_indices=True)
        return [column[at_a] for column in a], [column[at_b] for column in b]

    def recording(self) -> Recording:
        """The axis' motion under its torque."""
        t, position, velocity, torque = self.topics["joint_states"]
        return Recording(t - t[0], position, torque, velocity, source="run")

    def corrected(self, model: Axis, left_out: Collection[str]) -> Run:
        """The run with the errors of the encoder that a model knows taken from position and speed, but those left out."""
        t, position, velocity, torque = self.topics["joint_states"]
        correction = PositionCorrection(model, float(np.median(np.diff(t))))
        correction.configure(left_out, 0.0)
        true = np.array([correction.step(q, v) for q, v in zip(position, velocity, strict=True)])
        return replace(self, topics={**self.topics, "joint_states": [t, true[:, 0], true[:, 1], torque]})

    def write(self, path: Path, namespace: str) -> None:
        """A bag of the run. Raises InputError when the path exists."""
        write_bag(path, [self._topic(name, namespace.rstrip("/")) for name in self.topics])

    @classmethod
    def read(cls, path: Path, joint: str, namespace: str, topics: Sequence[str]) -> Run:
        """A run that `write` has written, with these topics. Raises InputError when it cannot be read."""
        place = namespace.rstrip("/")
        sources = {
            name: [
                SignalSource(f"{place}/{name}", field, joint if name == "joint_states" else None) for field in COLUMNS[name]
            ]
            for name in topics
        }
        columns, _ = read_columns(Bag(path), [source for some in sources.values() for source in some])
        found: dict[str, list[Array]] = {}
        for name, some in sources.items():
            heard = columns[f"{place}/{name}"]
            found[name] = [(heard.log_times - EPOCH).astype(np.float64) * 1e-9, *(heard.values[source] for source in some)]
        return cls(joint, found)

    def _topic(self, name: str, namespace: str) -> TopicData:
        t, *values = self.topics[name]
        times = EPOCH + np.rint(t * SECOND).astype(np.int64)
        columns = dict(zip(COLUMNS[name], values, strict=True))
        if name == "joint_states":
            return joint_states(f"{namespace}/{name}", times, {self.joint: columns})
        kind = "AxisReference" if name == "reference" else "FrictionEstimate"
        return encoded(f"{namespace}/{name}", f"tcs_friction_msgs/msg/{kind}", times, columns)
