"""The live recording: acceptable joint states kept as they come, so that a job needs no bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcs_friction.config import AxisFile
from tcs_friction.control.stamps import NEW_RUN, NEXT, SECOND
from tcs_friction.errors import JobError
from tcs_friction.nodes.core.base import AxisNode
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.joint_input import JointInput, JointSettings
from tcs_friction.nodes.core.joint_states import CommandedTorque
from tcs_friction.nodes.core.peers import unquoted
from tcs_friction.nodes.core.series import Series
from tcs_friction.recording.align import align
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

TOPIC = "joint_states"


class LiveRecording:
    """The newest joint states of one joint. They become a Recording as those of a bag do, with its gaps cut."""

    def __init__(self, node: AxisNode[Any]) -> None:
        self._health = node.health
        self._state = JointInput(node.health, node.lock_step, Level.WARN)
        self._commanded = CommandedTorque(node)
        self._series = Series(3)  # position, velocity, torque
        self._joint = ""

    def __len__(self) -> int:
        return len(self._series)

    def follow(self, joint: str, limit: int, config: JointSettings) -> bool:
        """Keep `limit` states of this joint. Whether it is another one: the states of the one before are forgotten."""
        another = joint != self._joint
        if another:
            self._series.clear()
            self._joint = joint
        self._state.configure(joint, config)
        self._series.limit = limit
        return another

    def clear(self) -> None:
        """Forget the states that were kept."""
        self._series.clear()

    def append(self, data: bytes, keep: bool = True) -> bool:
        """A serialised JointState; False when it repeats the last one, is refused or is about other joints."""
        step, state = self._state.take(data), self._state
        if step is not NEXT and step is not NEW_RUN:
            return False
        if step is NEW_RUN and len(self._series):
            begun = f"begun anew at {state.stamp / SECOND:.3f} s"
            self._health.values["live recording"] = f"{begun}, after {len(self._series)} states of the run before"
        if keep:
            self._series.append(state.stamp, state.position, state.speed, state.acted(self._commanded))
        return True

    def recording(self) -> Recording:
        """What was heard. Raises JobError when that is too little, InputError when no sample has a torque."""
        if len(self) < 2:
            raise JobError("live recording", f"{len(self)} joint states of {self._joint} heard", "a run before")
        stamps, columns = self._series.newest()
        sources = [SignalSource(TOPIC, field, self._joint) for field in ("position", "velocity", "effort")]
        times = stamps - stamps[0] + 1  # a simulation begins at 0, which in a bag would say that there is no stamp
        topic = TopicColumns(TOPIC, times, times, dict(zip(sources, columns, strict=True)))
        position, velocity, torque = sources
        return align({TOPIC: topic}, SignalMap(position=position, torque=torque, velocity=velocity), "live recording")


def recordings(request: Any, file: AxisFile) -> list[Recording]:
    """The recordings in the bags that a request names. Raises InputError, which quotes nothing of them."""
    signals = file.mapped(request.axis or "axis file")
    with unquoted():
        return list(read_recordings([Path(name) for name in request.bags], signals))
