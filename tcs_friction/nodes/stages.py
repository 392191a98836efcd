"""The stages of one commissioning: runs of the axis, and what identifier and diagnoser make of them; each is done once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message, serialize_message
from tcs_friction_msgs.action import Diagnose as DiagnoseAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import LugreParameters

from tcs_friction.errors import JobError
from tcs_friction.nodes.base import AxisNode
from tcs_friction.nodes.jobs import Progress, Waiter
from tcs_friction.nodes.journal import Journal
from tcs_friction.nodes.modes import Modes, Setup
from tcs_friction.nodes.programme import Programme
from tcs_friction.nodes.remote import Remotes
from tcs_friction.nodes.runs import Run, RunCollector


class DiagnosisError(JobError):
    """The recordings cannot be diagnosed."""


class Tools:
    """What a commissioning node asks of others: made once, used by every goal."""

    def __init__(self, node: AxisNode[Any], waiter: Waiter, runs: RunCollector) -> None:
        self.node, self.waiter, self.runs = node, waiter, runs
        self.remotes = Remotes(node, waiter)
        self.modes = Modes(self.remotes)
        self.programme = Programme(node, waiter, self.remotes, runs)
        self._clients = {
            "identifier": ActionClient(node, IdentifyAction, "identifier/identify"),
            "diagnoser": ActionClient(node, DiagnoseAction, "diagnoser/diagnose"),
        }

    async def there(self, name: str, limit: float, otherwise: str = "") -> None:
        """Raises JobError when a node that is going to be asked is not there. otherwise: what would make it unnecessary."""
        if not await self.waiter.until(self._clients[name].server_is_ready, limit):
            raise JobError(name, f"not there within {limit:g} s", f"the node to run{otherwise}")

    async def ask(self, name: str, goal: Any, steps: Steps, words: str, limit: float) -> Any:
        """A node's result of a goal. Raises JobError when it does not take it, goes away or is not to go on."""
        await self.there(name, limit)
        client = self._clients[name]
        sent = client.send_goal_async(
            goal, feedback_callback=lambda message: steps.share(message.feedback.progress, words)
        )
        if not await self.waiter.until(sent.done, limit) or not sent.result().accepted:
            raise JobError(name, "did not take the request", "it to be idle")
        handle = sent.result()
        result = handle.get_result_async()
        while not await self.waiter.until(result.done, 0.2):
            if steps.cancelled:
                handle.cancel_goal_async()
                raise JobError("commission", "was cancelled")
            if not client.server_is_ready():
                raise JobError(name, f"went away while {words}", "it to stay")
        return result.result().result


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
    """One goal: where its results go (None: nowhere), what is done already, and the runs that were made."""

    def __init__(self, tools: Tools, config: Any, name: str, directory: Path | None, steps: Steps, journal: Journal) -> None:
        self.tools, self.config = tools, config
        self.name, self.directory = name, directory
        self.steps, self.journal = steps, journal
        self.runs: dict[str, Run] = {}

    async def before(self) -> Setup:
        """How the nodes were set before the goal, also where it is gone on with after a restart."""
        known = self.journal.get("setup")
        if known is not None:
            return Setup(tuple(known["switches"]), known["friction"], known["models"])
        setup = await self.tools.modes.found(self.config.answer_limit)
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
        config, tools = self.config, self.tools
        await tools.modes.set(mode, config.answer_limit)
        try:
            await tools.programme.begin(path, config, lambda what: self.steps.tell(0.0, what), noise)
            result = await tools.runs.finished(config.stall_limit, lambda share: self.steps.tell(share, words))
        finally:
            await tools.programme.rest(config)
        await tools.modes.check(mode, config.answer_limit)
        self.steps.done()
        self.runs[name] = result
        if self.directory is not None:
            self.journal.clear(name)
            target = self.directory / name
            await tools.waiter.in_thread(lambda: result.write(target, tools.node.get_namespace()))
            self.journal.note(name, list(result.topics))
        return result

    async def _read_back(self, name: str, heard_for: str) -> bool:
        topics = self.journal.get(name)
        if self.directory is None or not topics or (heard_for and self.journal.get(heard_for) is None):
            return False
        bag, joint, namespace = self.directory / name, self.tools.node.file.axis.name, self.tools.node.get_namespace()
        self.runs[name] = await self.tools.waiter.in_thread(lambda: Run.read(bag, joint, namespace, topics))
        return True

    async def identified(self, name: str) -> LugreParameters:
        """The parameters that the identifier finds in what it has just heard; it publishes them itself."""
        known = self.journal.get(name)
        if known is not None:
            self.steps.done()
            return deserialize_message(bytes.fromhex(known), LugreParameters)
        self.journal.clear(name)
        goal = IdentifyAction.Goal(directory=f"{self.name}/{name}" if self.directory else "")
        found = await self.tools.ask("identifier", goal, self.steps, "identifying", self.config.answer_limit)
        self.steps.done()
        if not found.success:
            raise JobError("identifier", found.message)
        self.journal.note(name, serialize_message(found.parameters).hex())
        return found.parameters

    async def diagnosed(self, name: str, axis: Path, bags: Sequence[Path]) -> tuple[str, str]:
        """Verdict and statement of a diagnosis of bags, whose files go to the directory `name`.

        Raises DiagnosisError where these bags cannot be diagnosed.
        """
        known = self.journal.get(name)
        if known is None:
            self.journal.clear(name)
            goal = DiagnoseAction.Goal(bags=[str(bag) for bag in bags], axis=str(axis), directory=f"{self.name}/{name}")
            found = await self.tools.ask("diagnoser", goal, self.steps, "diagnosing", self.config.answer_limit)
            if not found.success:
                raise DiagnosisError("diagnosis", found.message)
            known = [found.verdict, found.statement]
            self.journal.note(name, known)
        self.steps.done()
        return str(known[0]), str(known[1])
