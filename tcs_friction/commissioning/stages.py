"""The stages of one commissioning: runs of the axis, and what is identified and diagnosed of them; each is done once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tcs_friction.commissioning.journal import Journal
from tcs_friction.commissioning.run import Run
from tcs_friction.commissioning.settings import CommissioningConfig
from tcs_friction.commissioning.setup import Setup
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.errors import JobError

Result = TypeVar("Result")
Tell = Callable[[float], None]
"""Hears the share of a stage that is done; raises JobError when the goal has been cancelled."""


class DiagnosisError(JobError):
    """The recordings cannot be diagnosed."""


@dataclass(frozen=True)
class Identified:
    """What was identified, and the identifier's message about it in the form in which it is kept."""

    friction: CompensatorConfig
    message: str


class Nodes(Protocol):
    """What a commissioning asks of the nodes of an axis. Everything raises JobError when a node does not do its part."""

    joint: str
    namespace: str

    async def found(self) -> Setup:
        """How everything is set now."""

    async def restore(self, setup: Setup) -> None:
        """Set everything so; the message of a SetupError says which node refuses it."""

    async def set_friction(self, friction: CompensatorConfig) -> None:
        """Give the compensator friction parameters."""

    def publish(self, identified: Identified) -> None:
        """Let everybody know what was identified."""

    async def driven(self, mode: int, path: Path, noise: int, steps: Steps, words: str) -> Run:
        """One run of a reference file in a mode, after which the axis rests."""

    async def identified(self, directory: str, steps: Steps) -> Identified:
        """What the identifier makes of what it has heard last; directory: name for its results, "" for none."""

    def read(self, message: str) -> Identified:
        """What was identified, from its kept message."""

    async def diagnosed(self, axis: Path, bags: Sequence[Path], directory: str, steps: Steps) -> tuple[str, str]:
        """Verdict and statement of a diagnosis of bags. Raises DiagnosisError where these cannot be diagnosed."""

    async def in_thread(self, work: Callable[[], Result]) -> Result:
        """Compute in a thread."""

    def info(self, words: str) -> None:
        """A line for the log."""


class Progress(Protocol):
    """Where a goal's progress goes, and whether it is to be given up."""

    cancelled: Any

    def tell(self, **fields: Any) -> None:
        """New feedback."""


class Steps:
    """Progress over the stages. Their number is an estimate, since it depends on what is found."""

    def __init__(self, progress: Progress, count: int, show: Callable[[str], None]) -> None:
        self._progress, self._count, self._done = progress, count, 0
        self._show, self._share = show, 0.0

    @property
    def cancelled(self) -> bool:
        """Whether the goal is to be given up."""
        return self._progress.cancelled.is_set()

    def begin(self, stage: str) -> None:
        """A stage begins: shown, not yet told. Raises JobError when the goal has been cancelled."""
        self._give_up_if_cancelled()
        self._show(stage)

    def _give_up_if_cancelled(self) -> None:
        if self.cancelled:
            raise JobError("commission", "was cancelled")

    def tell(self, share: float, stage: str) -> None:
        """Raises JobError when the goal has been cancelled."""
        self._give_up_if_cancelled()
        self.share(share, stage)

    def share(self, share: float, stage: str) -> None:
        """How much of the present stage is done."""
        self._show(stage)
        self._share = max(self._share, min(1.0, (self._done + share) / self._count))
        self._progress.tell(progress=float(self._share), stage=stage)

    def done(self) -> None:
        """A stage is over."""
        self._done += 1


class Stages:
    """One goal: where its results go (None: nowhere), what is done already, and the runs that were made.

    name: of the directory of results, as the goal has it.
    """

    def __init__(
        self,
        nodes: Nodes,
        config: CommissioningConfig,
        name: str,
        directory: Path | None,
        steps: Steps,
        journal: Journal,
    ) -> None:
        self.nodes, self.config = nodes, config
        self.name, self.directory = name, directory
        self.steps, self.journal = steps, journal
        self.runs: dict[str, Run] = {}

    async def before(self) -> Setup:
        """How the nodes were set before the goal, also where it is gone on with after a restart."""
        known = self.journal.get("setup")
        if known is not None:
            return Setup(tuple(known["switches"]), known["friction"], known["models"])
        setup = await self.nodes.found()
        self.journal.note("setup", asdict(setup))
        return setup

    async def run(self, name: str, mode: int, path: Path, words: str, noise: int = 0, heard_for: str = "") -> Run:
        """One run of a reference file in a mode, after which the axis rests; its bag goes to the directory.

        A run that has been made is not made again. noise: a simulated plant's noise differs between runs with another number.
        heard_for: the stage that another node makes of what it hears of this run; without that stage the run is made again.
        """
        self.steps.begin(words)
        if name in self.runs or await self._read_back(name, heard_for):
            self.steps.done()
            return self.runs[name]
        result = self.runs[name] = await self.nodes.driven(mode, path, noise, self.steps, words)
        self.steps.done()
        if self.directory is not None:
            self.journal.clear(name)
            target = self.directory / name
            await self.nodes.in_thread(lambda: result.write(target, self.nodes.namespace))
            self.journal.note(name, list(result.topics))
        return result

    async def _read_back(self, name: str, heard_for: str) -> bool:
        topics = self.journal.get(name)
        if self.directory is None or not topics or (heard_for and self.journal.get(heard_for) is None):
            return False
        bag, joint, namespace = self.directory / name, self.nodes.joint, self.nodes.namespace
        self.runs[name] = await self.nodes.in_thread(lambda: Run.read(bag, joint, namespace, topics))
        return True

    async def identified(self, name: str) -> Identified:
        """What the identifier finds in what it has just heard; it publishes it itself."""
        known = self.journal.get(name)
        if known is not None:
            self.steps.done()
            return self.nodes.read(known)
        self.journal.clear(name)
        found = await self.nodes.identified(f"{self.name}/{name}" if self.directory else "", self.steps)
        self.steps.done()
        self.journal.note(name, found.message)
        return found

    async def diagnosed(self, name: str, axis: Path, bags: Sequence[Path]) -> tuple[str, str]:
        """Verdict and statement of a diagnosis of bags, whose files go to the directory `name`.

        Raises DiagnosisError where these bags cannot be diagnosed.
        """
        known = self.journal.get(name)
        if known is None:
            self.journal.clear(name)
            known = await self.nodes.diagnosed(axis, bags, f"{self.name}/{name}", self.steps)
            self.journal.note(name, list(known))
        self.steps.done()
        return str(known[0]), str(known[1])
