"""Other nodes of the same axis: their parameters and triggers, with a time limit on every answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import Trigger

from tcs_friction.errors import JobError
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.parameters import as_ros


class RefusalError(JobError):
    """A node has answered that it does not take a value; it has changed nothing."""


class Remotes:
    """Clients are made when they are first needed, and kept."""

    def __init__(self, node: Node, waiter: Waiter) -> None:
        self._node, self._waiter = node, waiter
        self._clients: dict[str, Any] = {}

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        return self._clients[name]

    async def set(self, node: str, values: Mapping[str, Any], limit: float) -> None:
        """Set parameters of a node, all or none. Raises RefusalError with the node's reason, JobError when it does not answer."""
        client = self._client(SetParametersAtomically, f"{node}/set_parameters_atomically")
        parameters = [Parameter(name, value=as_ros(value)).to_parameter_msg() for name, value in values.items()]
        answer = await self._waiter.call(client, SetParametersAtomically.Request(parameters=parameters), limit)
        if not answer.result.successful:
            raise RefusalError(f"node {node}", f"refused {', '.join(values)}: {answer.result.reason}")

    async def get(self, node: str, names: Sequence[str], limit: float) -> dict[str, Any]:
        """Values of parameters of a node."""
        client = self._client(GetParameters, f"{node}/get_parameters")
        answer = await self._waiter.call(client, GetParameters.Request(names=list(names)), limit)
        return {name: _plain(parameter_value_to_python(value)) for name, value in zip(names, answer.values, strict=True)}

    async def set_all_or_none(self, wanted: Sequence[tuple[str, Mapping[str, Any]]], limit: float) -> None:
        """Set parameters of several nodes. Raises JobError, with what was set already set back, when one fails."""
        before = [(node, await self.get(node, list(values), limit)) for node, values in wanted]
        done: list[tuple[str, Mapping[str, Any]]] = []
        try:
            for (node, values), old in zip(wanted, before, strict=True):
                if old[1] == values:
                    continue
                done.append(old)
                await self.set(node, values, limit)
        except JobError as error:
            if isinstance(error, RefusalError):
                done.pop()  # without an answer, it may have been set after all
            lost = [node for node, values in done if not await self._set_back(node, values, limit)]
            unsure = f" and {', '.join(lost)} could not be set back" if lost else "; nothing was changed"
            raise JobError(error.where, f"{error.found}{unsure}", error.expected) from None

    async def _set_back(self, node: str, values: Mapping[str, Any], limit: float) -> bool:
        try:
            await self.set(node, values, limit)
        except JobError:
            return False
        return True

    async def trigger(self, name: str, limit: float) -> None:
        """Call a std_srvs/Trigger. Raises JobError with its message when it fails."""
        answer = await self._waiter.call(self._client(Trigger, name), Trigger.Request(), limit)
        if not answer.success:
            raise JobError(f"service {name}", answer.message)


def _plain(value: Any) -> Any:
    """Lists of words without empty ones, which stand for none."""
    return [item for item in value if item != ""] if isinstance(value, list) else value
