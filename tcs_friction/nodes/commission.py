"""The paper's loop on a running graph: measure, identify, compensate, measure the tracking error, keep the best parameters.

After it the axis is diagnosed and what is found is cancelled as well: `cancelling`.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.msg import LugreParameters
from tcs_friction_msgs.srv import SetMode

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch, text
from tcs_friction.control.plausible import Ranges
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.base import AxisNode, ClockConfig, control_of, derived, heard_by_all
from tcs_friction.nodes.cancelling import Base, Cancelled, Cancelling
from tcs_friction.nodes.convert import friction_of, lugre_message
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.files import config_file, reference_file
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter, create_deferred_service
from tcs_friction.nodes.journal import STATE, Journal
from tcs_friction.nodes.modes import NAMES as MODE_NAMES
from tcs_friction.nodes.modes import Setup, modelled
from tcs_friction.nodes.outcome import (
    both_directions,
    check_reversals,
    friction,
    frictionless,
    keep_identification,
    tracking,
    verdict,
    without_effects,
    write_outcome,
)
from tcs_friction.nodes.peers import ResultsConfig, new_results
from tcs_friction.nodes.qos import LATCHED
from tcs_friction.nodes.runs import Run, RunCollector
from tcs_friction.nodes.stages import Stages, Steps, Tools
from tcs_friction.report.commission import CommissionResult

MOST_ROUNDS = 100


@dataclass(frozen=True)
class CommissionConfig(ResultsConfig, Ranges, ClockConfig):
    """The run that everything is measured on."""

    reference_file: str = text("azimuth_1p2m_run.yaml", "reference to be tracked better: a path or a name in the config folder")
    measure_file: str = text("azimuth_1p2m_measure.yaml", "reference on which friction is measured")
    diagnose_file: str = text("", "reference to be diagnosed on, as far and fast as the axis may go; none: the runs made so far")
    settle: float = setting(2.0, "s", 0.0, 1e4, "beginning of the run that does not count")
    repetitions: int = setting(1, "", 1, 100, "rounds of identification and compensation when the goal names none")
    diagnoses: int = setting(3, "", 0, 20, "rounds of diagnosis and cancellation; 0: the paper's loop alone")
    trials: int = setting(2, "", 1, 20, "runs by which each way to compensate is judged")
    answer_limit: float = setting(5.0, "s", 0.1, 600.0, "a node that does not answer for so long is missing")
    stall_limit: float = setting(10.0, "s", 0.1, 600.0, "a run that does not advance for so long is given up")
    simulated: bool = switch(True, "the plant is a simulation: start it anew for every run")
    truth: bool = switch(True, "a simulated plant is what the axis file says: compare with it, tell no diagnosis of its effects")

    @property
    def known(self) -> bool:
        """Whether the axis file is the truth about the plant."""
        return self.simulated and self.truth


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
        self._latched = self.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
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

    # The loop

    async def _commission(self, goal: Any, answer: Any, progress: Progress) -> str:
        """Everything that can be refused is refused before the axis moves; after a failure the best that is verified is set."""
        config, rounds = self.config, goal.repetitions or self.config.repetitions
        if rounds > MOST_ROUNDS:
            raise InputError("goal", f"{rounds} repetitions", f"at most {MOST_ROUNDS}")
        check_reversals(config.reference_file, reference_file(config.reference_file), config.settle)
        with new_results(config.results, goal.directory, STATE) as directory:
            diagnoses = config.diagnoses if directory is not None else 0
            await self._tools.there("identifier", config.answer_limit)
            if diagnoses:
                await self._tools.there("diagnoser", config.answer_limit, ", or parameter diagnoses to be 0")
            steps = Steps(progress, 1 + 3 * rounds + diagnoses * (2 + 3 * config.trials), self._show)
            journal = Journal(directory, _settings(config, self.file, rounds))
            stages = Stages(self._tools, config, goal.directory, directory, steps, journal)
            self.runs, before = stages.runs, await stages.before()
            work = Work(stages, rounds, time.monotonic(), before)
            if journal.stages[1:]:
                self.get_logger().info(f"goes on after {', '.join(journal.stages[1:])}")
            try:
                return await self._loop(work, before, answer, diagnoses)
            except BaseException:
                await self._set_back(work.setup, before)
                raise
            finally:
                self._show("")

    async def _loop(self, work: Work, setup: Setup, answer: Any, diagnoses: int) -> str:
        stages, config = work.stages, self.config
        reference, measuring = config_file(config.reference_file), config_file(config.measure_file)
        await self._tools.modes.restore(setup.plain(), config.answer_limit)
        await stages.run("before", SetMode.Request.PLAIN, reference, "measuring the axis as it is")
        best: Round | None = None
        for number in range(work.rounds):
            suffix = f"_{number + 1}" if work.rounds > 1 else ""
            measure, identification, name = f"measure{suffix}", f"identification{suffix}", f"after{suffix}"
            await stages.run(measure, SetMode.Request.MEASURE, measuring, "measuring friction", heard_for=identification)
            parameters = await stages.identified(identification)
            await self._tools.remotes.set("lugre_compensator", friction_of(parameters), config.answer_limit)
            after = await stages.run(name, SetMode.Request.COMPENSATE, reference, "compensating")
            now = Round(measure, name, parameters, identification)
            if best is None or self._rms(after) < self._rms(self.runs[best.after]):
                best = now
        assert best is not None
        await self._tools.remotes.set("lugre_compensator", friction_of(best.parameters), config.answer_limit)
        self._latched.publish(best.parameters)
        gain = tracking(self.runs["before"]).improvement(tracking(self.runs[best.after]), config.settle)
        lugre = Setup((False, False, True), friction_of(best.parameters), modelled(""))
        base = Base("before", SetMode.Request.PLAIN, setup.plain())
        if gain.proven and self._rms(self.runs[best.after]) < self._rms(self.runs["before"]):
            work.setup, base = lugre, Base(best.after, SetMode.Request.COMPENSATE, lugre)
        cancelled = Cancelled()
        if diagnoses:
            cancelling = Cancelling(stages, self.file, best.parameters, base, work.setup)
            try:
                cancelled = await cancelling.rounds((best.measured, "before", best.after))
            finally:
                work.setup = cancelling.setup
            await self._tools.modes.restore(work.setup, config.answer_limit)
        return await self._conclude(answer, work, best, cancelled, work.setup is not setup)

    async def _set_back(self, setup: Setup, before: Setup) -> None:
        """After a failure or a cancellation: the best compensation that has been verified, else what there was before."""
        words = "as they were before commissioning" if setup is before else "the best that was verified"
        try:
            await self._tools.modes.restore(setup, self.config.answer_limit)
            now = self.get_clock().now().nanoseconds
            self._latched.publish(lugre_message(setup.compensation(), now, words))
            self.get_logger().info(f"switches and friction compensation are {words}")
        except JobError as error:
            self.get_logger().error(f"switches and friction compensation are not {words}: {error}")

    def _show(self, stage: str) -> None:
        """Say in the log and in diagnostics what is being done, "" for nothing."""
        if stage and stage != self.health.values.get("doing"):
            self.get_logger().info(stage)
        self.health.values["doing"] = stage or "nothing"

    # The result

    async def _conclude(self, answer: Any, work: Work, best: Round, cancelled: Cancelled, better: bool) -> str:
        """Fill the answer, write the files, and say in one sentence what came of it. Raises JobError when nothing is gained."""
        known, file, settle = self.config.known, self.file, self.config.settle
        reference, directory = reference_file(self.config.reference_file), work.stages.directory
        before, after = tracking(self.runs["before"]), tracking(self.runs[best.after])
        found = None if cancelled.run is None else tracking(cancelled.run)
        off = await self._waiter.in_thread(lambda: frictionless(file, reference)) if known else None
        ideal = await self._waiter.in_thread(lambda: without_effects(file, reference)) if known else None
        unchanged = () if better else ("No improvement beyond its uncertainty: the axis was left as it was before.",)
        result = CommissionResult(
            axis=file.axis.name,
            before=before,
            after=after,
            measurement=friction(self.runs[best.measured], control_of(file).observer.filter_delay),
            identified=both_directions(best.parameters),
            costs=keep_identification(directory, best.identification),
            friction_off=off,
            true=dict(file.axis.friction.values) if known else None,
            settle=settle,
            seconds=time.monotonic() - work.began,
            notes=(*unchanged, *cancelled.notes),
            found=found,
            ideal=ideal,
            judged=cancelled.judged,
            statements=cancelled.statements,
        )
        first, last = before.errors(settle), (found or after).errors(settle)
        answer.parameters = best.parameters
        answer.peak_before, answer.peak_after = _peak(first) * ARCSEC, _peak(last) * ARCSEC
        answer.rms_before, answer.rms_after = first.rms * ARCSEC, last.rms * ARCSEC
        answer.cancelled = [one.name for one in cancelled.judged if one.kept]
        error = result.dob_relative_error
        answer.dob_relative_error = float("nan") if error is None else error
        self.outcome = result
        if directory is not None:
            await self._waiter.in_thread(lambda: write_outcome(directory, result))
        work.stages.journal.finish()
        words = verdict(first, last, before.improvement(found or after, settle))
        if not better:
            raise JobError("commission", words, "less error than by chance; switches and compensation are as they were before")
        return f"{words}; cancelled: {', '.join(['friction', *answer.cancelled])}"

    def _rms(self, run: Run) -> float:
        return tracking(run).errors(self.config.settle).rms


@dataclass(frozen=True)
class Round:
    """Stages of one round: the measurement, the run that shows what it is worth, what was identified, its directory."""

    measured: str
    after: str
    parameters: LugreParameters
    identification: str


@dataclass
class Work:
    """One goal: its stages, rounds of the paper's loop, when it began (s), and how the axis is left if it fails."""

    stages: Stages
    rounds: int
    began: float
    setup: Setup


def _settings(config: CommissionConfig, file: AxisFile, rounds: int) -> dict[str, Any]:
    """What must not differ when a commissioning is gone on with: references, by their content, and what decides."""
    content = {"axis": file.axis.name, "rounds": rounds}
    for name in ("settle", "diagnoses", "trials", "simulated", "truth", "clock", "period"):
        content[name] = getattr(config, name)
    for name in ("reference_file", "measure_file", "diagnose_file"):
        path = getattr(config, name)
        content[name] = hashlib.sha256(config_file(path).read_bytes()).hexdigest() if path else ""
    return content


def _peak(errors: TrackingErrors) -> float:
    return max(abs(errors.peak_positive), abs(errors.peak_negative))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Commission, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
