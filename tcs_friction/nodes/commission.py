"""The paper's loop on a running graph: measure, identify, compensate, measure the tracking error, keep the best parameters."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.action import ActionClient
from tcs_friction_msgs.action import Commission as CommissionAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import LugreParameters
from tcs_friction_msgs.srv import SetMode

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch, text
from tcs_friction.control.reference import load_reference
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.base import LOCK_STEP, AxisNode, ClockConfig, config_file, control_of, derived
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter, create_deferred_service
from tcs_friction.nodes.outcome import (
    both_directions,
    friction,
    frictionless,
    search_costs,
    tracking,
    write_outcome,
)
from tcs_friction.nodes.qos import LATCHED
from tcs_friction.nodes.remote import Remotes
from tcs_friction.nodes.runs import Run, RunCollector
from tcs_friction.report.commission import CommissionResult
from tcs_friction.writable import output_directory

SWITCHES = (("dob", "switch1"), ("identifier", "switch2"), ("lugre_compensator", "switch3"))
MODES = {
    SetMode.Request.PLAIN: (False, False, False),
    SetMode.Request.MEASURE: (True, True, False),
    SetMode.Request.COMPENSATE: (False, False, True),
}


@dataclass(frozen=True)
class CommissionConfig(ClockConfig):
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
    return derived(CommissionConfig, control_of(file).loop)


class Commission(AxisNode[CommissionConfig]):
    """Action ~/commission and service set_mode, which sets the three switches, all of them or none."""

    def __init__(self) -> None:
        super().__init__("commission", defaults)
        self.start()
        self.runs: dict[str, Run] = {}
        """What was measured in the last commissioning, by name."""
        self.outcome: CommissionResult | None = None
        self._waiter = Waiter(self)
        self._remotes = Remotes(self, self._waiter)
        self._runs = RunCollector(self, self._waiter)
        self._latched = self.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
        self._identify = ActionClient(self, IdentifyAction, "identifier/identify")
        create_deferred_service(self, SetMode, "set_mode", self._on_set_mode)
        self._jobs = Jobs(self, self._waiter, "commission", CommissionAction, self._commission)

    def check(self, config: CommissionConfig, file: AxisFile) -> None:  # noqa: ARG002
        for name in (config.reference_file, config.measure_file):
            load_reference(config_file(name))

    hears = ""

    async def _on_set_mode(self, request: Any, response: Any) -> Any:
        try:
            await self.set_mode(request.mode)
            response.success = True
        except (InputError, JobError) as error:
            response.success, response.message = False, str(error)
        return response

    async def set_mode(self, mode: int) -> None:
        """Set the switches. Raises JobError, all of them as they were, when one cannot be set."""
        if mode not in MODES:
            raise InputError("set_mode", f"mode {mode}", "0 (PLAIN), 1 (MEASURE) or 2 (COMPENSATE)")
        wanted = [(node, {name: value}) for (node, name), value in zip(SWITCHES, MODES[mode], strict=True)]
        await self._remotes.set_all_or_none(wanted, self.config.answer_limit)

    # The loop

    async def _commission(self, goal: Any, answer: Any, progress: Progress) -> str:
        rounds = goal.repetitions or self.config.repetitions
        directory = output_directory(goal.directory) if goal.directory else None
        steps = _Steps(progress, 1 + 3 * rounds)
        self.runs.clear()
        began = time.monotonic()
        try:
            await self._run("before", SetMode.Request.PLAIN, directory, steps, "measuring the axis as it is")
            best: tuple[Run, LugreParameters] | None = None
            for number in range(rounds):
                suffix = f"_{number + 1}" if rounds > 1 else ""
                measured = await self._run(f"measure{suffix}", SetMode.Request.MEASURE, directory, steps, "measuring friction")
                parameters = await self._identified(directory, steps)
                after = await self._run(f"after{suffix}", SetMode.Request.COMPENSATE, directory, steps, "compensating")
                if best is None or self._rms(after) < self._rms(best[0]):
                    best = (after, parameters)
        except BaseException:
            await self._calm_down()
            raise
        assert best is not None
        self._latched.publish(best[1])
        return await self._conclude(answer, measured, best, directory, time.monotonic() - began)

    async def _run(self, name: str, mode: int, directory: Path | None, steps: _Steps, stage: str) -> Run:
        """One run in a mode; its bag goes to the directory."""
        path = config_file(self.config.measure_file if mode == SetMode.Request.MEASURE else self.config.reference_file)
        reference = load_reference(path)
        limit = self.config.answer_limit
        await self.set_mode(mode)
        await self._remotes.set("reference", {"reference_file": str(path)}, limit)
        wait_for = ["joint_states", "reference", "friction_estimate"]
        if self.config.simulated and self.config.clock == LOCK_STEP:
            start = {"start_position": reference.at(0.0)[0], "run_until": 0.0, "truth": True}
            await self._remotes.set("plant", start, limit)
            self._runs.begin(self.file.axis.name, reference.duration, [*wait_for, "true_friction"])
            await self._remotes.trigger("plant/reset", limit)
            await self._remotes.set("plant", {"run_until": reference.duration}, limit)
        else:
            self._runs.begin(self.file.axis.name, reference.duration, wait_for)
        result = await self._runs.finished(self.config.stall_limit, lambda share: steps.tell(share, stage))
        steps.done()
        self.runs[name] = result
        if directory is not None:
            await self._waiter.in_thread(lambda: result.write(directory / name, self.get_namespace()))
        return result

    async def _identified(self, directory: Path | None, steps: _Steps) -> LugreParameters:
        """The parameters that the identifier finds in what it has just heard; it publishes them itself."""
        client, limit = self._identify, self.config.answer_limit
        if not await self._waiter.until(client.server_is_ready, limit):
            raise JobError("identifier", f"not there within {limit:g} s", "the node to run")
        goal = IdentifyAction.Goal(directory=str(directory) if directory else "")

        def hear(message: Any) -> None:
            steps.tell(message.feedback.progress, "identifying")

        sent = client.send_goal_async(goal, feedback_callback=hear)
        if not await self._waiter.until(sent.done, limit) or not sent.result().accepted:
            raise JobError("identifier", "did not take the request", "it to be idle")
        handle = sent.result()
        result = handle.get_result_async()
        while not await self._waiter.until(result.done, 0.2):
            if steps.cancelled:
                handle.cancel_goal_async()
                raise JobError("commission", "was cancelled")
            if not client.server_is_ready():
                raise JobError("identifier", "went away while identifying", "it to stay")
        found = result.result().result
        steps.done()
        if not found.success:
            raise JobError("identifier", found.message)
        return found.parameters

    async def _calm_down(self) -> None:
        """After a failure or a cancellation: mode PLAIN where the nodes still answer."""
        try:
            await self.set_mode(SetMode.Request.PLAIN)
        except JobError as error:
            self.get_logger().warning(f"not in mode PLAIN: {error}")

    # The result

    async def _conclude(
        self, answer: Any, measured: Run, best: tuple[Run, LugreParameters], directory: Path | None, seconds: float
    ) -> str:
        """Fill the answer, write the files, and say in one sentence what came of it."""
        simulated = self.config.simulated
        reference = load_reference(config_file(self.config.reference_file))
        result = CommissionResult(
            axis=self.file.axis.name,
            before=tracking(self.runs["before"]),
            after=tracking(best[0]),
            measurement=friction(measured, control_of(self.file).observer.filter_delay),
            identified=both_directions(best[1]),
            costs=search_costs(directory) if directory else np.zeros(0),
            friction_off=frictionless(self.file, reference) if simulated else None,
            true=dict(self.file.axis.friction.values) if simulated else None,
            settle=self.config.settle,
            seconds=seconds,
        )
        first, last = (run.errors(self.config.settle) for run in (result.before, result.after))
        answer.parameters = best[1]
        answer.peak_before, answer.peak_after = _peak(first) * ARCSEC, _peak(last) * ARCSEC
        answer.rms_before, answer.rms_after = first.rms * ARCSEC, last.rms * ARCSEC
        error = result.dob_relative_error
        answer.dob_relative_error = float("nan") if error is None else error
        self.outcome = result
        if directory is not None:
            await self._waiter.in_thread(lambda: write_outcome(directory, result))
        gain = 100.0 * (1.0 - last.rms / first.rms)
        return f"tracking error {first.rms:.4f} to {last.rms:.4f} arcsec rms ({gain:.0f} % less)"

    def _rms(self, run: Run) -> float:
        return tracking(run).errors(self.config.settle).rms


class _Steps:
    """Progress over the steps of the loop."""

    def __init__(self, progress: Progress, count: int) -> None:
        self._progress, self._count, self._done = progress, count, 0

    @property
    def cancelled(self) -> bool:
        return self._progress.cancelled.is_set()

    def tell(self, share: float, stage: str) -> None:
        """Raises JobError when the goal has been cancelled."""
        if self.cancelled:
            raise JobError("commission", "was cancelled")
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
