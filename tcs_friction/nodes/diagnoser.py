"""Diagnosis in the graph: what physics the axis file lacks, against bags or what was heard live."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensor_msgs.msg import JointState
from tcs_friction_msgs.action import Diagnose as DiagnoseAction
from tcs_friction_msgs.srv import Diagnose as DiagnoseService

from tcs_friction.config import AxisFile, load_axis
from tcs_friction.control.config_field import setting
from tcs_friction.diagnose.verdict import diagnose
from tcs_friction.errors import JobError
from tcs_friction.nodes.base import AxisNode, ClockConfig, config_file, control_of, derived
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.live import LiveRecording
from tcs_friction.nodes.qos import COLLECT
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.report.diagnosis_files import write_diagnosis
from tcs_friction.writable import output_directory


@dataclass(frozen=True)
class DiagnoserConfig(ClockConfig):
    """How much is remembered."""

    memory: float = setting(600.0, "s", 1.0, 1e5, "joint states older than this are forgotten")


def defaults(file: AxisFile) -> DiagnoserConfig:
    """The settings that an axis file implies."""
    return derived(DiagnoserConfig, control_of(file).loop)


class Diagnoser(AxisNode[DiagnoserConfig]):
    """Listens to joint_states so that a diagnosis needs no bag."""

    def __init__(self) -> None:
        super().__init__("diagnoser", defaults)
        self._live = LiveRecording()
        self.start()
        self._waiter = Waiter(self)
        self._jobs = Jobs(self, self._waiter, "diagnose", DiagnoseAction, self._diagnose, DiagnoseService)
        self.create_subscription(JointState, "joint_states", self._on_state, COLLECT, raw=True)

    def configure(self, config: DiagnoserConfig) -> None:
        super().configure(config)
        self._live.follow(self.file.axis.name, round(config.memory / config.period))

    def _on_state(self, data: bytes) -> None:
        if self._live.append(data):
            self.health.ticks += 1

    async def _diagnose(self, request: Any, answer: Any, progress: Progress) -> str:
        directory = output_directory(request.directory) if request.directory else None
        file = load_axis(config_file(request.axis)) if request.axis else self.file
        recordings = self._recordings(request, file)

        def tell(share: float, stage: str) -> None:
            if progress.cancelled.is_set():
                raise JobError("diagnosis", "was cancelled")
            progress.tell(progress=float(share), stage=stage)

        found = await self._waiter.in_thread(lambda: diagnose(recordings, file, progress=tell))
        if directory is not None:
            await self._waiter.in_thread(lambda: write_diagnosis(directory, found))
        answer.verdict, answer.statement = found.verdict, found.statement
        answer.effects = [item.effect for item in found.effects]
        return found.statement

    def _recordings(self, request: Any, file: AxisFile) -> tuple[Recording, ...]:
        if request.bags:
            return read_recordings([Path(name) for name in request.bags], file.mapped(request.axis or "axis file"))
        return (self._live.recording(),)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Diagnoser, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
