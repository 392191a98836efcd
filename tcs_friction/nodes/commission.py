"""The paper's loop on a running graph: measure, identify, compensate, measure the tracking error, keep the best parameters."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient
from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import LugreParameters
from tcs_friction_msgs.srv import SetMode

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch, text
from tcs_friction.control.plausible import Ranges
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.base import AxisNode, ClockConfig, control_of, derived, heard_by_all
from tcs_friction.nodes.convert import friction_of, lugre_message
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.files import config_file, reference_file
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter, create_deferred_service
from tcs_friction.nodes.modes import NAMES as MODE_NAMES
from tcs_friction.nodes.modes import Modes, Setup
from tcs_friction.nodes.outcome import (
    both_directions,
    check_reversals,
    friction,
    frictionless,
    keep_identification,
    tracking,
    verdict,
    write_outcome,
)
from tcs_friction.nodes.peers import ResultsConfig, new_results
from tcs_friction.nodes.programme import Programme
from tcs_friction.nodes.qos import LATCHED
from tcs_friction.nodes.remote import Remotes
from tcs_friction.nodes.runs import Run, RunCollector
from tcs_friction.report.commission import CommissionResult

MOST_ROUNDS = 100


@dataclass(frozen=True)
class CommissionConfig(ResultsConfig, Ranges, ClockConfig):
    """The run that everything is measured on."""

    reference_file: str = text("azimuth_1p2m_run.yaml", "reference to be tracked better: a path or a name in the config folder")
    measure_file: str = text("azimuth_1p2m_measure.yaml", "reference on which friction is measured")
    settle: float = setting(2.0, "s", 0.0, 1e4, "beginning of the run that does not count")
    repetitions: int = setting(1, "", 1, 100, "rounds of identification and compensation when the goal names none")
    answer_limit: float = setting(5.0, "s", 0.1, 600.0, "a node that does not answer for so long is missing")
    stall_limit: float = setting(10.0, "s", 0.1, 600.0, "a run that does not advance for so long is given up")
    simulated: bool = switch(True, "the plant is a simulation: start it anew for every run, compare with its true friction")


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
        self._remotes = Remotes(self, self._waiter)
        self._modes = Modes(self._remotes)
        self._programme = Programme(self, self._waiter, self._remotes, self._runs)
        self._latched = self.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
        self._identify = ActionClient(self, IdentifyAction, "identifier/identify")
        create_deferred_service(self, SetMode, "set_mode", self._on_set_mode)
        self._jobs = Jobs(self, self._waiter, "commission", self._commission, CommissionAction)

    def check(self, config: CommissionConfig, file: AxisFile) -> None:  # noqa: ARG002
        for name in (config.reference_file, config.measure_file):
            reference_file(name)

    def configure(self, config: CommissionConfig) -> None:
        super().configure(config)
        self._runs.configure(self.file.axis.name, self.file.axis.inertia, config)

    hears = ""

    async def _on_set_mode(self, request: Any, response: Any) -> Any:
        try:
            if self._jobs.busy:
                raise JobError("set_mode", f"refused while {self._jobs.busy}", "its goal to be over or cancelled")
            await self._modes.set(request.mode, self.config.answer_limit)
            response.success = True
            self.get_logger().info(f"mode {MODE_NAMES[request.mode]}")
        except (InputError, JobError) as error:
            response.success, response.message = False, str(error)
            self.get_logger().warning(str(error))
        return response

    # The loop

    async def _commission(self, goal: Any, answer: Any, progress: Progress) -> str:
        """Everything that can be refused is refused before the axis moves; what was set before is set back after a failure."""
        config, rounds = self.config, goal.repetitions or self.config.repetitions
        if rounds > MOST_ROUNDS:
            raise InputError("goal", f"{rounds} repetitions", f"at most {MOST_ROUNDS}")
        check_reversals(config.reference_file, reference_file(config.reference_file), config.settle)
        with new_results(config.results, goal.directory) as directory:
            work = Work(goal.directory, directory, rounds, _Steps(progress, 1 + 3 * rounds, self._show), time.monotonic())
            before = await self._modes.found(config.answer_limit)
            try:
                return await self._loop(work, answer)
            except BaseException:
                await self._set_back(before)
                raise
            finally:
                self._show("")

    async def _loop(self, work: Work, answer: Any) -> str:
        self.runs.clear()
        await self._run("before", SetMode.Request.PLAIN, work, "measuring the axis as it is")
        best: Round | None = None
        for number in range(work.rounds):
            suffix = f"_{number + 1}" if work.rounds > 1 else ""
            measured = await self._run(f"measure{suffix}", SetMode.Request.MEASURE, work, "measuring friction")
            parameters = await self._identified(work, f"identification{suffix}")
            after = await self._run(f"after{suffix}", SetMode.Request.COMPENSATE, work, "compensating")
            now = Round(measured, after, parameters, f"identification{suffix}")
            if best is None or self._rms(now.after) < self._rms(best.after):
                best = now
        assert best is not None
        await self._remotes.set("lugre_compensator", friction_of(best.parameters), self.config.answer_limit)
        self._latched.publish(best.parameters)
        return await self._conclude(answer, work, best)

    async def _run(self, name: str, mode: int, work: Work, stage: str) -> Run:
        """One run in a mode, after which the axis rests; its bag goes to the directory."""
        config = self.config
        path = config_file(config.measure_file if mode == SetMode.Request.MEASURE else config.reference_file)
        self._show(stage)
        await self._modes.set(mode, config.answer_limit)
        try:
            await self._programme.begin(path, config, lambda what: work.steps.tell(0.0, what))
            result = await self._runs.finished(config.stall_limit, lambda share: work.steps.tell(share, stage))
        finally:
            await self._programme.rest(config)
        await self._modes.check(mode, config.answer_limit)
        work.steps.done()
        self.runs[name] = result
        if work.directory is not None:
            target = work.directory / name
            await self._waiter.in_thread(lambda: result.write(target, self.get_namespace()))
        return result

    async def _identified(self, work: Work, name: str) -> LugreParameters:
        """The parameters that the identifier finds in what it has just heard; it publishes them itself."""
        client, limit = self._identify, self.config.answer_limit
        if not await self._waiter.until(client.server_is_ready, limit):
            raise JobError("identifier", f"not there within {limit:g} s", "the node to run")
        goal = IdentifyAction.Goal(directory=f"{work.name}/{name}" if work.directory else "")

        def hear(message: Any) -> None:
            work.steps.share(message.feedback.progress, "identifying")

        sent = client.send_goal_async(goal, feedback_callback=hear)
        if not await self._waiter.until(sent.done, limit) or not sent.result().accepted:
            raise JobError("identifier", "did not take the request", "it to be idle")
        handle = sent.result()
        result = handle.get_result_async()
        while not await self._waiter.until(result.done, 0.2):
            if work.steps.cancelled:
                handle.cancel_goal_async()
                raise JobError("commission", "was cancelled")
            if not client.server_is_ready():
                raise JobError("identifier", "went away while identifying", "it to stay")
        found = result.result().result
        work.steps.done()
        if not found.success:
            raise JobError("identifier", found.message)
        return found.parameters

    async def _set_back(self, setup: Setup) -> None:
        """After a failure, a cancellation or a run that is no better: switches and compensation as they were before."""
        try:
            await self._modes.restore(setup, self.config.answer_limit)
            now = self.get_clock().now().nanoseconds
            self._latched.publish(lugre_message(setup.compensation(), now, "before commissioning"))
            self.get_logger().info("switches and friction compensation are as they were before commissioning")
        except JobError as error:
            self.get_logger().error(f"not as before commissioning: {error}")

    def _show(self, stage: str) -> None:
        """Say in the log and in diagnostics what is being done, "" for nothing."""
        if stage and stage != self.health.values.get("doing"):
            self.get_logger().info(stage)
        self.health.values["doing"] = stage or "nothing"

    # The result

    async def _conclude(self, answer: Any, work: Work, best: Round) -> str:
        """Fill the answer, write the files, and say in one sentence what came of it. Raises JobError when nothing is gained."""
        simulated, file, settle = self.config.simulated, self.file, self.config.settle
        reference = reference_file(self.config.reference_file)
        before, after = tracking(self.runs["before"]), tracking(best.after)
        gain = before.improvement(after, settle)
        first, last = before.errors(settle), after.errors(settle)
        proven = gain.proven and last.rms < first.rms
        off = await self._waiter.in_thread(lambda: frictionless(file, reference)) if simulated else None
        result = CommissionResult(
            axis=file.axis.name,
            before=before,
            after=after,
            measurement=friction(best.measured, control_of(file).observer.filter_delay),
            identified=both_directions(best.parameters),
            costs=keep_identification(work.directory, best.identification),
            friction_off=off,
            true=dict(file.axis.friction.values) if simulated else None,
            settle=settle,
            seconds=time.monotonic() - work.began,
            notes=() if proven else ("No improvement beyond its uncertainty: the axis was left as it was before.",),
        )
        answer.parameters = best.parameters
        answer.peak_before, answer.peak_after = _peak(first) * ARCSEC, _peak(last) * ARCSEC
        answer.rms_before, answer.rms_after = first.rms * ARCSEC, last.rms * ARCSEC
        error = result.dob_relative_error
        answer.dob_relative_error = float("nan") if error is None else error
        self.outcome = result
        directory = work.directory
        if directory is not None:
            await self._waiter.in_thread(lambda: write_outcome(directory, result))
        words = verdict(first, last, gain)
        if not proven:
            raise JobError("commission", words, "less error than by chance; switches and compensation are as they were before")
        return words

    def _rms(self, run: Run) -> float:
        return tracking(run).errors(self.config.settle).rms


@dataclass(frozen=True)
class Round:
    """One measurement, what was identified from it, and the run that shows what that is worth."""

    measured: Run
    after: Run
    parameters: LugreParameters
    identification: str  # name of its directory


@dataclass(frozen=True)
class Work:
    """One goal: the name of its results, their directory (None for nowhere), rounds, progress, and when it began (s)."""

    name: str
    directory: Path | None
    rounds: int
    steps: _Steps
    began: float


class _Steps:
    """Progress over the steps of the loop."""

    def __init__(self, progress: Progress, count: int, show: Callable[[str], None]) -> None:
        self._progress, self._count, self._done = progress, count, 0
        self._show = show

    @property
    def cancelled(self) -> bool:
        return self._progress.cancelled.is_set()

    def tell(self, share: float, stage: str) -> None:
        """Raises JobError when the goal has been cancelled."""
        if self.cancelled:
            raise JobError("commission", "was cancelled")
        self.share(share, stage)

    def share(self, share: float, stage: str) -> None:
        """How much of the present step is done."""
        self._show(stage)
        self._progress.tell(progress=float((self._done + share) / self._count), stage=stage)

    def done(self) -> None:
        self._done += 1


def _peak(errors: TrackingErrors) -> float:
    return max(abs(errors.peak_positive), abs(errors.peak_negative))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Commission, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
