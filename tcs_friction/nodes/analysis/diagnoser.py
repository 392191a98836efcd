"""Diagnosis in the graph: what physics the axis file lacks, against bags or what was heard live."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tcs_friction_msgs.action import Diagnose as DiagnoseAction
from tcs_friction_msgs.srv import Diagnose as DiagnoseService

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.plausible import Ranges
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import JobError
from tcs_friction.nodes.analysis.heard import LiveRecording, recordings
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived, heard_by_all
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import axis_file
from tcs_friction.nodes.core.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.core.peers import ResultsConfig, new_results
from tcs_friction.nodes.core.qos import COLLECT
from tcs_friction.recording.recording import Recording
from tcs_friction.report.diagnosis_files import write_diagnosis


@dataclass(frozen=True)
class DiagnoserConfig(ResultsConfig, Ranges, ClockConfig):
    """How much is remembered."""

    listen: bool = switch(True, "remember joint states, so that a diagnosis needs no bag", fixed=True)
    memory: float = setting(600.0, "s", 1.0, 1e5, "joint states older than this are forgotten")


def defaults(file: AxisFile) -> DiagnoserConfig:
    """The settings that an axis file implies."""
    return derived(DiagnoserConfig, control_of(file).loop, heard_by_all(file))


class Diagnoser(AxisNode[DiagnoserConfig]):
    """Listens to joint_states so that a diagnosis needs no bag."""

    def __init__(self) -> None:
        super().__init__("diagnoser", defaults)
        self._live = LiveRecording(self)
        self.start()
        self._waiter = Waiter(self)
        self._jobs = Jobs(self, self._waiter, "diagnose", self._diagnose, DiagnoseAction, DiagnoseService)
        if self.config.listen:
            self.hear_driver(self._on_state, COLLECT)
        else:
            self.hears = ""

    def configure(self, config: DiagnoserConfig) -> None:
        super().configure(config)
        self._live.follow(self.file.axis.name, round(config.memory / config.period), config)

    def _on_state(self, data: bytes) -> None:
        if self._live.append(data):
            self.health.ticks += 1

    async def _diagnose(self, request: Any, answer: Any, progress: Progress) -> str:
        with new_results(self.config.results, request.directory) as directory:
            file = await self._waiter.in_thread(lambda: axis_file(request.axis)) if request.axis else self.file
            live = None if request.bags else (self._live.recording(),)
            found = await self._waiter.in_thread(lambda: diagnosed(request, live, file, progress))
            if directory is not None:
                await self._waiter.in_thread(lambda: write_diagnosis(directory, found))
        answer.verdict, answer.statement = found.verdict, found.statement
        answer.effects = [item.effect for item in found.effects]
        return found.statement


def diagnosed(request: Any, live: Sequence[Recording] | None, file: AxisFile, progress: Progress) -> Diagnosis:
    """The diagnosis asked for, of bags or of what was heard. Runs in a thread of its own."""

    def tell(share: float, stage: str) -> None:
        if progress.cancelled.is_set():
            raise JobError("diagnosis", "was cancelled")
        progress.tell(progress=float(share), stage=stage)

    return diagnose(tuple(live or recordings(request, file)), file, progress=tell)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Diagnoser, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
