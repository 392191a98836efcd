"""The stages of one commissioning: runs of the axis, and what identifier and diagnoser make of them; each is done once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message, serialize_message
from tcs_friction_msgs.action import Diagnose as DiagnoseAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import LugreParameters
from tcs_friction_msgs.srv import SetMode

from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.base import LOCK_STEP, AxisNode
from tcs_friction.nodes.jobs import Progress, Waiter
from tcs_friction.nodes.journal import Journal
from tcs_friction.nodes.modes import Modes, Setup
from tcs_friction.nodes.programme import Programme
from tcs_friction.nodes.remote import Remotes
from tcs_friction.nodes.runs import Run, RunCollector


class Tools:
    """What a commissioning node asks of others: made once, used by every goal."""

    def __init__(self, node: AxisNode[Any], waiter: Waiter, runs: RunCollector) -> None:
        self.node, self.waiter, self.runs = node, waiter, runs
        self.remotes = Remotes(node, waiter)
        self.modes = Modes(self.remotes)
        self.programme = Programme(node, waiter, self.remotes, runs)
        self._identify = ActionClient(node, IdentifyAction, "identifier/identify")
        self._diagnose = ActionClient(node, DiagnoseAction, "diagnoser/diagnose")

    async def there(self, limit: float, diagnoser: bool) -> None:
        """Raises JobError when a node that is going to be asked is not there."""
        for client in (self._identify, self._diagnose) if diagnoser else (self._identify,):
            name = client._action_name.split("/")[0]
            if not await self.waiter.until(client.server_is_ready, limit):
                hint = ", or parameter diagnoses to be 0" if client is self._diagnose else ""
                raise JobError(name, f"not there within {limit:g} s", f"the node to run{hint}")

    async def identify(self, goal: Any, share: Callable[[float], None], cancelled: Callable[[], bool], limit: float) -> Any:
        """The identifier's result."""
        return await self._asked(self._identify, "identifier", goal, share, cancelled, limit)

    async def diagnose(self, goal: Any, share: Callable[[float], None], cancelled: Callable[[], bool], limit: float) -> Any:
        """The diagnoser's result."""
        return await self._asked(self._diagnose, "diagnoser", goal, share, cancelled, limit)

    async def _asked(
        self, client: Any, name: str, goal: Any, share: Callable[[float], None], cancelled: Callable[[], bool], limit: float
    ) -> Any:
        """Send a goal and wait for its result. Raises JobError when the node does not take it, goes away, or is not to go on."""
        if not await self.waiter.until(client.server_is_ready, limit):
            raise JobError(name, f"not there within {limit:g} s", "the node to run")
        sent = client.send_goal_async(goal, feedback_callback=lambda message: share(message.feedback.progress))
        if not await self.waiter.until(sent.done, limit) or not sent.result().accepted:
            raise JobError(name, "did not take the request", "it to be idle")
        handle = sent.result()
        result = handle.get_result_async()
        while not await self.waiter.until(result.done, 0.2):
            if cancelled():
                handle.cancel_goal_async()
                raise JobError("commission", "was cancelled")
            if not client.server_is_ready():
                raise JobError(name, "went away at its work", "it to stay")
        return result.result().result


class Steps:
    """Progress over the stages; their number is an estimate, since it depends on what is found."""

    def __init__(self, progress: Progress, count: int, show: Callable[[str], None]) -> None:
        self._progress, self._count, self._done = progress, count, 0
        self._show, self._share = show, 0.0

    @property
    def cancelled(self) -> bool:
        """Whether the goal is to be given up."""
        return self._progress.cancelled.is_set()

    def tell(self, share: float, stage: str) -> None:
        """Raises JobError when the goal has been cancelled."""
        if self.cancelled:
            raise JobError("commission", "was cancelled")
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
            return Setup.of(known)
        setup = await self.tools.modes.found(self.config.answer_limit)
        self.journal.note("setup", asdict(setup))
        return setup

    async def run(self, name: str, mode: int, path: Path, words: str, noise: int = 0) -> Run:
        """One run of a reference file in a mode, after which the axis rests; its bag goes to the directory.

        noise: a simulated plant's noise differs between runs with another number.
        """
        config, tools = self.config, self.tools
        self.steps.tell(0.0, words)
        if self.journal.get(name) is not None and self.directory is not None:
            bag = self.directory / name
            self.runs[name] = await tools.waiter.in_thread(
                lambda: Run.read(bag, tools.node.file.axis.name, tools.node.get_namespace())
            )
            self.steps.done()
            return self.runs[name]
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
            self.journal.note(name, True)
        return result

    async def identified(self, name: str) -> LugreParameters:
        """The parameters that the identifier finds in what it has just heard; it publishes them itself."""
        known = self.journal.get(name)
        if known is not None:
            self.steps.done()
            return deserialize_message(bytes.fromhex(known), LugreParameters)
        self.journal.clear(name)
        goal = IdentifyAction.Goal(directory=f"{self.name}/{name}" if self.directory else "")
        found = await self.tools.identify(
            goal, lambda share: self.steps.share(share, "identifying"), lambda: self.steps.cancelled, self.config.answer_limit
        )
        self.steps.done()
        if not found.success:
            raise JobError("identifier", found.message)
        self.journal.note(name, serialize_message(found.parameters).hex())
        return found.parameters

    async def diagnosed(self, name: str, axis: Path, bags: Sequence[Path]) -> str:
        """The verdict of a diagnosis of bags; its files go to the directory `name`. Raises JobError when there is none."""
        known = self.journal.get(name)
        if known is not None:
            self.steps.done()
            return str(known)
        self.journal.clear(name)
        goal = DiagnoseAction.Goal(bags=[str(bag) for bag in bags], axis=str(axis), directory=f"{self.name}/{name}")
        found = await self.tools.diagnose(
            goal, lambda share: self.steps.share(share, "diagnosing"), lambda: self.steps.cancelled, self.config.answer_limit
        )
        self.steps.done()
        if not found.success:
            raise JobError("diagnoser", found.message)
        self.journal.note(name, found.verdict)
        return str(found.verdict)

    def identifiable(self) -> bool:
        """Whether what the identifier heard of the last measuring run is still in its memory: not where the run was read back."""
        return True


def settings(config: Any, names: Sequence[str], files: Mapping[str, str]) -> dict[str, Any]:
    """What must not differ when a commissioning is gone on with: values of a configuration, and the content of files."""
    return {name: getattr(config, name) for name in names} | dict(files)
