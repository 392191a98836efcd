"""What a commissioning asks of other nodes, by services, actions and parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message, serialize_message
from tcs_friction_msgs.action import Diagnose as DiagnoseAction
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import LugreParameters

from tcs_friction.commissioning.run import Run
from tcs_friction.commissioning.setup import Setup, friction_parameters
from tcs_friction.commissioning.stages import DiagnosisError, Identified, Steps
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.config_field import changed
from tcs_friction.errors import JobError
from tcs_friction.nodes.commissioning.modes import Modes
from tcs_friction.nodes.commissioning.programme import Programme
from tcs_friction.nodes.commissioning.run_collector import RunCollector
from tcs_friction.nodes.core.base import AxisNode
from tcs_friction.nodes.core.convert import friction_of
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.qos import LATCHED
from tcs_friction.nodes.core.remote import Remotes

Result = TypeVar("Result")


class Tools:
    """Clients of the other nodes: made once, used by every goal."""

    def __init__(self, node: AxisNode[Any], waiter: Waiter, runs: RunCollector) -> None:
        self.node, self.waiter, self.runs = node, waiter, runs
        self.remotes = Remotes(node, waiter)
        self.modes = Modes(self.remotes)
        self.programme = Programme(node, waiter, self.remotes, runs)
        self.latched = node.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
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


class AskedNodes:
    """The nodes of an axis as one goal asks them (`stages.Nodes`), with the settings that hold for all of it."""

    def __init__(self, tools: Tools, config: Any) -> None:
        self._tools, self._config, self._limit = tools, config, config.answer_limit
        self.joint, self.namespace = tools.node.file.axis.name, tools.node.get_namespace()

    async def found(self) -> Setup:
        return await self._tools.modes.found(self._limit)

    async def restore(self, setup: Setup) -> None:
        await self._tools.modes.restore(setup, self._limit)

    async def set_friction(self, friction: CompensatorConfig) -> None:
        await self._tools.remotes.set("lugre_compensator", friction_parameters(friction), self._limit)

    def publish(self, identified: Identified) -> None:
        self._tools.latched.publish(message_of(identified))

    async def driven(self, mode: int, path: Path, noise: int, steps: Steps, words: str) -> Run:
        tools, config = self._tools, self._config
        await tools.modes.set(mode, self._limit)
        try:
            await tools.programme.begin(path, config, lambda what: steps.tell(0.0, what), noise)
            result = await tools.runs.finished(config.stall_limit, lambda share: steps.tell(share, words))
        finally:
            await tools.programme.rest(config)
        await tools.modes.check(mode, self._limit)
        return result

    async def identified(self, directory: str, steps: Steps) -> Identified:
        goal = IdentifyAction.Goal(directory=directory)
        found = await self._tools.ask("identifier", goal, steps, "identifying", self._limit)
        if not found.success:
            raise JobError("identifier", found.message)
        return self.read(serialize_message(found.parameters).hex())

    def read(self, message: str) -> Identified:
        parameters = deserialize_message(bytes.fromhex(message), LugreParameters)
        return Identified(changed(CompensatorConfig(), friction_of(parameters)), message)

    async def diagnosed(self, axis: Path, bags: Sequence[Path], directory: str, steps: Steps) -> tuple[str, str]:
        goal = DiagnoseAction.Goal(bags=[str(bag) for bag in bags], axis=str(axis), directory=directory)
        found = await self._tools.ask("diagnoser", goal, steps, "diagnosing", self._limit)
        if not found.success:
            raise DiagnosisError("diagnosis", found.message)
        return found.verdict, found.statement

    async def in_thread(self, work: Callable[[], Result]) -> Result:
        return await self._tools.waiter.in_thread(work)

    def info(self, words: str) -> None:
        self._tools.node.get_logger().info(words)


def message_of(identified: Identified) -> LugreParameters:
    """The identifier's message."""
    return deserialize_message(bytes.fromhex(identified.message), LugreParameters)
