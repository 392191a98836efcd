"""The paper's loop: measure, identify, compensate, measure the tracking error, keep the best parameters.

After it the axis is diagnosed and what is found is cancelled as well: `cancelling`.
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from typing import Any

from tcs_friction.commissioning.cancelling import Base, Cancelled, Cancelling, Motions
from tcs_friction.commissioning.findings import (
    both_directions,
    friction,
    frictionless,
    keep_identification,
    tracking,
    verdict,
    without_effects,
    write_outcome,
)
from tcs_friction.commissioning.run import Run
from tcs_friction.commissioning.settings import CommissioningConfig
from tcs_friction.commissioning.setup import COMPENSATE, MEASURE, PLAIN, Setup, friction_parameters, modelled
from tcs_friction.commissioning.stages import Identified, Stages
from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.reference import load_reference
from tcs_friction.report.commission import CommissionResult


@dataclass(frozen=True)
class Round:
    """Stages of one round: the measurement, the run that shows what it is worth, what was identified, its directory."""

    measured: str
    after: str
    found: Identified
    identification: str


@dataclass(frozen=True)
class Conclusion:
    """What came of a commissioning. better: whether anything is gained; else the axis is as it was."""

    result: CommissionResult
    found: Identified
    words: str
    better: bool


class PaperLoop:
    """One goal. `setup` is how the axis is left when it fails: the best that has been verified, else what there was before."""

    def __init__(self, stages: Stages, file: AxisFile, motions: Motions, rounds: int, diagnoses: int, before: Setup) -> None:
        self._stages, self._config, self._nodes = stages, stages.config, stages.nodes
        self._file, self._motions = file, motions
        self._rounds, self._diagnoses = rounds, diagnoses
        self._began = time.monotonic()
        self.before = self.setup = before

    async def conclusion(self) -> Conclusion:
        """All of it. Raises JobError when a node does not do its part or the goal is cancelled."""
        await self._nodes.restore(self.before.plain())
        await self._stages.run("before", PLAIN, self._motions.reference, "measuring the axis as it is")
        best = await self._best_round()
        await self._nodes.set_friction(best.found.friction)
        self._nodes.publish(best.found)
        runs = self._stages.runs
        gain = tracking(runs["before"]).improvement(tracking(runs[best.after]), self._config.settle)
        base = Base("before", PLAIN, self.before.plain())
        if gain.proven and self._rms(runs[best.after]) < self._rms(runs["before"]):
            self.setup = Setup((False, False, True), friction_parameters(best.found.friction), modelled(""))
            base = Base(best.after, COMPENSATE, self.setup)
        cancelled = Cancelled()
        if self._diagnoses:
            cancelling = Cancelling(self._stages, self._file, self._motions, best.found.friction, base, self.setup)
            try:
                cancelled = await cancelling.rounds((best.measured, "before", best.after))
            finally:
                self.setup = cancelling.setup
            await self._nodes.restore(self.setup)
        return await self._conclude(best, cancelled)

    async def _best_round(self) -> Round:
        stages, motions = self._stages, self._motions
        best: Round | None = None
        for number in range(self._rounds):
            suffix = f"_{number + 1}" if self._rounds > 1 else ""
            measure, identification, name = f"measure{suffix}", f"identification{suffix}", f"after{suffix}"
            await stages.run(measure, MEASURE, motions.measure, "measuring friction", heard_for=identification)
            found = await stages.identified(identification)
            await self._nodes.set_friction(found.friction)
            after = await stages.run(name, COMPENSATE, motions.reference, "compensating")
            if best is None or self._rms(after) < self._rms(stages.runs[best.after]):
                best = Round(measure, name, found, identification)
        assert best is not None
        return best

    async def _conclude(self, best: Round, cancelled: Cancelled) -> Conclusion:
        """Write the files, and say in one sentence what came of it."""
        known, file, settle, runs = self._config.known, self._file, self._config.settle, self._stages.runs
        reference, directory = load_reference(self._motions.reference), self._stages.directory
        before, after = tracking(runs["before"]), tracking(runs[best.after])
        found = None if cancelled.run is None else tracking(cancelled.run)
        off = await self._nodes.in_thread(lambda: frictionless(file, reference)) if known else None
        ideal = await self._nodes.in_thread(lambda: without_effects(file, reference)) if known else None
        better = self.setup is not self.before
        unchanged = () if better else ("No improvement beyond its uncertainty: the axis was left as it was before.",)
        result = CommissionResult(
            axis=file.axis.name,
            before=before,
            after=after,
            measurement=friction(runs[best.measured], control_of(file).observer.filter_delay),
            identified=both_directions(best.found.friction),
            costs=keep_identification(directory, best.identification),
            friction_off=off,
            true=dict(file.axis.friction.values) if known else None,
            settle=settle,
            seconds=time.monotonic() - self._began,
            notes=(*unchanged, *cancelled.notes),
            found=found,
            ideal=ideal,
            judged=cancelled.judged,
            statements=cancelled.statements,
        )
        if directory is not None:
            await self._nodes.in_thread(lambda: write_outcome(directory, result))
        self._stages.journal.finish()
        last = found or after
        words = verdict(before.errors(settle), last.errors(settle), before.improvement(last, settle))
        return Conclusion(result, best.found, words, better)

    def _rms(self, run: Run) -> float:
        return tracking(run).errors(self._config.settle).rms


def decisive(config: CommissioningConfig, motions: Motions, file: AxisFile, rounds: int, **more: Any) -> dict[str, Any]:
    """What must not differ when a commissioning is gone on with: references, by their content, and what decides."""
    content = {"axis": file.axis.name, "rounds": rounds, **more}
    for name in ("settle", "diagnoses", "trials", "simulated", "truth"):
        content[name] = getattr(config, name)
    for name, path in vars(motions).items():
        content[f"{name}_file"] = hashlib.sha256(path.read_bytes()).hexdigest() if path is not None else ""
    return content
