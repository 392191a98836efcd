"""The action ~/commission and the service set_mode: the room `tcs_friction.commissioning` on a running graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.srv import SetMode

from tcs_friction.commissioning.cancelling import Motions
from tcs_friction.commissioning.findings import check_reversals
from tcs_friction.commissioning.journal import STATE, Journal
from tcs_friction.commissioning.paper_loop import Conclusion, PaperLoop, decisive
from tcs_friction.commissioning.run import Run
from tcs_friction.commissioning.settings import CommissioningConfig
from tcs_friction.commissioning.setup import NAMES as MODE_NAMES
from tcs_friction.commissioning.stages import Stages, Steps
from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.plausible import Ranges
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.commissioning.run_collector import RunCollector
from tcs_friction.nodes.commissioning.tools import AskedNodes, Tools, message_of
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived, heard_by_all
from tcs_friction.nodes.core.convert import lugre_message
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import config_file, reference_file
from tcs_friction.nodes.core.jobs import Jobs, Progress, Waiter, create_deferred_service
from tcs_friction.nodes.core.peers import ResultsConfig, new_results
from tcs_friction.report.commission import CommissionResult

MOST_ROUNDS = 100


@dataclass(frozen=True)
class CommissionConfig(ResultsConfig, Ranges, CommissioningConfig, ClockConfig):
    """A commissioning in the graph."""


def defaults(file: AxisFile) -> CommissionConfig:
    """The settings that an axis file implies."""
    return derived(CommissionConfig, control_of(file).loop, heard_by_all(file))


class Commission(AxisNode[CommissionConfig]):
    """Action ~/commission and service set_mode, which sets the three switches, all of them or none."""

    def __init__(self) -> None:
        super().__init__("commission", defaults)
        self._waiter = Waiter(self)
        self._runs = RunCollector(self, self._waiter)
        self.start()
        self.runs: dict[str, Run] = {}
        """What was measured in the last commissioning, by name."""
        self.outcome: CommissionResult | None = None
        self._tools = Tools(self, self._waiter, self._runs)
        create_deferred_service(self, SetMode, "set_mode", self._on_set_mode)
        self._jobs = Jobs(self, self._waiter, "commission", self._commission, CommissionAction)

    def check(self, config: CommissionConfig, file: AxisFile) -> None:  # noqa: ARG002
        for name in (config.reference_file, config.measure_file, *filter(None, [config.diagnose_file])):
            reference_file(name)

    def configure(self, config: CommissionConfig) -> None:
        super().configure(config)
        self._runs.configure(self.file.axis.name, self.file.axis.inertia, config)

    hears = ""

    async def _on_set_mode(self, request: Any, response: Any) -> Any:
        try:
            if self._jobs.busy:
                raise JobError("set_mode", f"refused while {self._jobs.busy}", "its goal to be over or cancelled")
            await self._tools.modes.set(request.mode, self.config.answer_limit)
            response.success = True
            self.get_logger().info(f"mode {MODE_NAMES[request.mode]}")
        except (InputError, JobError) as error:
            response.success, response.message = False, str(error)
            self.get_logger().warning(str(error))
        return response

    async def _commission(self, goal: Any, answer: Any, progress: Progress) -> str:
        """Everything that can be refused is refused before the axis moves; after a failure the best that is verified is set."""
        config, rounds = self.config, goal.repetitions or self.config.repetitions
        if rounds > MOST_ROUNDS:
            raise InputError("goal", f"{rounds} repetitions", f"at most {MOST_ROUNDS}")
        check_reversals(config.reference_file, reference_file(config.reference_file), config.settle)
        diagnose = config_file(config.diagnose_file) if config.diagnose_file else None
        motions = Motions(config_file(config.reference_file), config_file(config.measure_file), diagnose)
        with new_results(config.results, goal.directory, STATE) as directory:
            diagnoses = config.diagnoses if directory is not None else 0
            await self._tools.there("identifier", config.answer_limit)
            if diagnoses:
                await self._tools.there("diagnoser", config.answer_limit, ", or parameter diagnoses to be 0")
            steps = Steps(progress, 1 + 3 * rounds + diagnoses * (2 + 3 * config.trials), self._show)
            settings = decisive(config, motions, self.file, rounds, clock=config.clock, period=config.period)
            journal = Journal(directory, settings)
            stages = Stages(AskedNodes(self._tools, config), config, goal.directory, directory, steps, journal)
            self.runs = stages.runs
            loop = PaperLoop(stages, self.file, motions, rounds, diagnoses, await stages.before())
            if journal.stages[1:]:
                self.get_logger().info(f"goes on after {', '.join(journal.stages[1:])}")
            try:
                return self._told(answer, await loop.conclusion())
            except BaseException:
                await self._set_back(loop)
                raise
            finally:
                self._show("")

    async def _set_back(self, loop: PaperLoop) -> None:
        """After a failure or a cancellation: the best compensation that has been verified, else what there was before."""
        setup = loop.setup
        words = "as they were before commissioning" if setup is loop.before else "the best that was verified"
        try:
            await self._tools.modes.restore(setup, self.config.answer_limit)
            now = self.get_clock().now().nanoseconds
            self._tools.latched.publish(lugre_message(setup.compensation(), now, words))
            self.get_logger().info(f"switches and friction compensation are {words}")
        except JobError as error:
            self.get_logger().error(f"switches and friction compensation are not {words}: {error}")

    def _show(self, stage: str) -> None:
        """Say in the log and in diagnostics what is being done, "" for nothing."""
        if stage and stage != self.health.values.get("doing"):
            self.get_logger().info(stage)
        self.health.values["doing"] = stage or "nothing"

    def _told(self, answer: Any, concluded: Conclusion) -> str:
        """Fill the answer; one sentence. Raises JobError when nothing is gained."""
        self.outcome = result = concluded.result
        first, last = result.before.errors(result.settle), (result.found or result.after).errors(result.settle)
        answer.parameters = message_of(concluded.found)
        answer.peak_before, answer.peak_after = _peak(first) * ARCSEC, _peak(last) * ARCSEC
        answer.rms_before, answer.rms_after = first.rms * ARCSEC, last.rms * ARCSEC
        answer.cancelled = [one.name for one in result.judged if one.kept]
        error = result.dob_relative_error
        answer.dob_relative_error = float("nan") if error is None else error
        if not concluded.better:
            expected = "less error than by chance; switches and compensation are as they were before"
            raise JobError("commission", concluded.words, expected)
        return f"{concluded.words}; cancelled: {', '.join(['friction', *answer.cancelled])}"


def _peak(errors: TrackingErrors) -> float:
    return max(abs(errors.peak_positive), abs(errors.peak_negative))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Commission, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
