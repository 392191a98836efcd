"""What the page's buttons do: services, actions and parameters of the other nodes, one order at a time, every end told."""

from __future__ import annotations

import time
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.node import Node
from tcs_friction_msgs.action import Commission, Diagnose, Identify
from tcs_friction_msgs.srv import SetMode

from tcs_friction.commissioning.setup import MODELLED
from tcs_friction.errors import JobError, TcsError
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.remote import Remotes
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.page.state import ABORT, CANCEL, JOBS, LEAVE_OUT, MODES, Job, Sink
from tcs_friction.nodes.page.switches import COMPENSATOR

LOOK_EVERY = 0.05  # s
ANSWER_LIMIT = 5.0  # s, of a service, and for a goal to be taken
ACTIONS: dict[str, tuple[Any, str]] = {
    "identify": (Identify, "identifier/identify"),
    "diagnose": (Diagnose, "diagnoser/diagnose"),
    "commission": (Commission, "commission/commission"),
}


class Orders:
    """Takes orders from the sink and carries them out."""

    def __init__(self, node: Node, waiter: Waiter, remotes: Remotes, sink: Sink) -> None:
        self._node, self._waiter, self._remotes, self._sink = node, waiter, remotes, sink
        self._job = Job()
        self._modes = node.create_client(SetMode, "set_mode")
        self._actions = {name: ActionClient(node, kind, path) for name, (kind, path) in ACTIONS.items()}
        self._cancels = {
            name: node.create_client(CancelGoal, f"{path}/_action/cancel_goal") for name, (_, path) in ACTIONS.items()
        }
        steady_timer(node, LOOK_EVERY, self._look)

    def _look(self) -> None:
        order = self._sink.next_order()
        if not order or self._node.executor is None:
            return
        if order == ABORT:
            self._node.executor.create_task(self._abort)
        elif self._job.running:
            self._tell(self._job)  # the buttons are off while it runs; somebody else's page may not know yet
        else:
            self._tell(Job(order, "asked for", 0.0, None))
            self._node.executor.create_task(self._carry_out, order)

    def _tell(self, job: Job) -> None:
        self._job = job
        self._sink.told(job)

    async def _carry_out(self, order: str) -> None:
        """Every failure becomes what the page shows."""
        try:
            if order in MODES:
                self._end(order, *await self._set_mode(order))
            elif order in ACTIONS:
                await self._act(order)
            else:
                self._end(order, True, await self._switch_effect(order))
        except TcsError as error:
            self._end(order, False, str(error))
        except Exception as error:  # one that reaches the executor would end it
            self._end(order, False, f"{type(error).__name__}: {error}")

    def _end(self, order: str, success: bool, message: str, directory: str = "") -> None:
        self._tell(Job(order, message, 1.0 if success else self._job.progress, success, directory))

    async def _set_mode(self, order: str) -> tuple[bool, str]:
        answer = await self._waiter.call(self._modes, SetMode.Request(mode=MODES.index(order)), ANSWER_LIMIT)
        return answer.success, answer.message or f"mode {order.upper()} is set"

    async def _switch_effect(self, order: str) -> str:
        """Cancel an effect of the model or leave it out, in every node that has this model. Raises JobError, nothing changed."""
        found = {node: await self._remotes.get(node, ("model", "left_out"), ANSWER_LIMIT) for node in MODELLED}
        model = found[COMPENSATOR]["model"]
        cancel = order.startswith(CANCEL)
        name = order.removeprefix(CANCEL if cancel else LEAVE_OUT)
        wanted = []
        for node, values in found.items():
            others = [other for other in values["left_out"] or () if other != name]
            if model and values["model"] == model:
                wanted.append((node, {"left_out": others if cancel else [*others, name]}))
        if not wanted:
            raise JobError(COMPENSATOR, "has no model", f"one that has {name}")
        await self._remotes.set_all_or_none(wanted, ANSWER_LIMIT)
        return f"in {', '.join(node for node, _ in wanted)}"

    async def _act(self, order: str) -> None:
        """An action from goal to result. Raises JobError when its node does not take or finish it."""
        client, (kind, path) = self._actions[order], ACTIONS[order]
        if not await self._waiter.until(client.server_is_ready, ANSWER_LIMIT):
            raise JobError(path, f"not there within {ANSWER_LIMIT:g} s", "its node to run")
        directory = f"{order}_{time.strftime('%Y%m%d_%H%M%S')}"
        sent = client.send_goal_async(kind.Goal(directory=directory), feedback_callback=self._listener(order))
        if not await self._waiter.until(sent.done, ANSWER_LIMIT):
            raise JobError(path, f"no answer within {ANSWER_LIMIT:g} s", "its node to be alive")
        if not sent.result().accepted:
            raise JobError(path, "refused", "its job before to be over or aborted")
        finished = sent.result().get_result_async()
        while not await self._waiter.until(finished.done, 1.0):
            if not client.server_is_ready():
                raise JobError(path, "its node has gone", "it to run until the end")
        result = finished.result().result
        words = getattr(result, "statement", "") or result.message
        self._end(order, result.success, words, directory)

    def _listener(self, order: str) -> Any:
        def hear(message: Any) -> None:
            if self._job.running and self._job.name == order:
                self._tell(Job(order, message.feedback.stage, float(message.feedback.progress), None))

        return hear

    async def _abort(self) -> None:
        """Cancel every goal of the axis, whoever gave it."""
        asked = [self._cancels[name].call_async(CancelGoal.Request()) for name in JOBS if self._cancels[name].service_is_ready()]
        if self._job.running:
            self._tell(Job(self._job.name, "abort asked for", self._job.progress, None))
        elif not asked:
            self._tell(Job(ABORT, "nothing there that could be aborted", 0.0, False))
        elif not await self._waiter.until(lambda: all(future.done() for future in asked), ANSWER_LIMIT):
            self._tell(Job(ABORT, f"no answer within {ANSWER_LIMIT:g} s", 0.0, False))
        else:
            count = sum(len(future.result().goals_canceling) for future in asked)
            self._tell(Job(ABORT, f"{count} jobs are being aborted" if count else "no job was running", 1.0, True))
