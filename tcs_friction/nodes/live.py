"""The live recording: joint states kept as they come, so that a job needs no bag."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from tcs_friction.config import AxisFile
from tcs_friction.errors import JobError
from tcs_friction.nodes.driver import CommandedTorque
from tcs_friction.nodes.peers import unquoted
from tcs_friction.nodes.series import Series
from tcs_friction.nodes.wire import JointWire
from tcs_friction.recording.align import align
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

TOPIC = "joint_states"


class LiveRecording:
    """The newest joint states of one joint. They become a Recording as those of a bag do, with its gaps cut."""

    def __init__(self, commanded: CommandedTorque) -> None:
        self._commanded = commanded
        self._series = Series(3)  # position, velocity, torque
        self._joint = ""

    def __len__(self) -> int:
        return len(self._series)

    def follow(self, joint: str, limit: int) -> None:
        """Keep `limit` states of this joint; those of another are forgotten."""
        if joint != self._joint:
            self._series.clear()
            self._joint, self._wire = joint, JointWire(joint)
        self._series.limit = limit

    def append(self, data: bytes) -> bool:
        """A serialised JointState; False when it repeats the last one or is about other joints."""
        stamp, position, velocity, torque = self._wire.read(data)
        if math.isnan(position):
            return False
        if math.isnan(torque):  # a driver that gives none
            torque = self._commanded.until(stamp)
        return self._series.append(stamp, position, velocity, torque)

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
