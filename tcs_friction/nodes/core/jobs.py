"""Long work in a node: coroutines that wait without blocking, threads that compute, jobs behind a service and an action."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from tcs_friction.errors import JobError, TcsError
from tcs_friction.nodes.core import scheduling
from tcs_friction.nodes.core.steady import steady_timer

Result = TypeVar("Result")
POLL = 0.02  # s


class Waiter:
    """Where the coroutines of one node wait. Everything is resumed by a timer, in the executor's own thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._waiting: list[tuple[Callable[[], bool], float, Future]] = []
        steady_timer(node, POLL, self._poll)

    def _poll(self) -> None:
        now = time.monotonic()
        for entry in list(self._waiting):
            ready, deadline, future = entry
            if ready() or now >= deadline:
                self._waiting.remove(entry)
                future.set_result(ready())

    async def until(self, ready: Callable[[], bool], limit: float) -> bool:
        """Wait for a condition, at most `limit` seconds of wall time; whether it holds."""
        future: Future = Future(executor=self._node.executor)
        self._waiting.append((ready, time.monotonic() + limit, future))
        return bool(await future)

    async def call(self, client: Client, request: Any, limit: float) -> Any:
        """Call a service. Raises JobError when it is not there or does not answer in time."""
        where = f"service {client.srv_name}"
        if not await self.until(client.service_is_ready, limit):
            raise JobError(where, f"not there within {limit:g} s", "its node to run")
        future = client.call_async(request)
        if not await self.until(future.done, limit):
            client.remove_pending_request(future)
            raise JobError(where, f"no answer within {limit:g} s", "its node to be alive")
        return future.result()

    async def in_thread(self, work: Callable[[], Result]) -> Result:
        """Compute in a thread; its result, or its exception raised here."""
        outcome: list[Result] = []
        failure: list[BaseException] = []

        def target() -> None:
            scheduling.ordinary()
            try:
                outcome.append(work())
            except BaseException as error:
                failure.append(error)

        thread = threading.Thread(target=target, daemon=True)
        thread.start()
        await self.until(lambda: not thread.is_alive(), float("inf"))
        if failure:
            raise failure[0]
        return outcome[0]


class _Later:
    """Stands for a response that will be sent when its job is done."""

    header: Any = None


def create_deferred_service(node: Node, kind: Any, name: str, handle: Callable[[Any, Any], Any]) -> Any:
    """A service whose handler is a coroutine function. The events executor does not await those of ordinary services.

    An exception becomes an answer: one that reaches that executor ends the process, with a segmentation fault in real time.
    """

    def start(request: Any, response: Any) -> _Later:
        later = _Later()

        async def finish() -> None:
            try:
                answer = await handle(request, response)
            except Exception as error:
                answer = response
                answer.success, answer.message = False, f"{node.get_name()}/{name}: {type(error).__name__}: {error}"
                node.get_logger().error(answer.message)
            send(answer, later.header)

        assert node.executor is not None
        node.executor.create_task(finish)
        return later

    def send_or_keep(response: Any, header: Any) -> None:
        if isinstance(response, _Later):
            response.header = header
        else:
            send(response, header)

    service = node.create_service(kind, name, start)
    send = service.send_response
    service.send_response = send_or_keep
    return service


class Progress:
    """What a job tells while it runs: called with feedback fields; says whether it should stop."""

    def __init__(self) -> None:
        self.cancelled = threading.Event()
        self.fields: dict[str, Any] = {}

    def tell(self, **fields: Any) -> None:
        """New feedback; only fields of the action's feedback."""
        self.fields = fields


Work = Callable[[Any, Any, Progress], Any]


class Jobs:
    """One job at a time behind a service, an action or both of the same name; `work(request, answer, progress)` is a coroutine.

    The node logs what came of every job, and why it takes none.
    """

    def __init__(
        self, node: Node, waiter: Waiter, name: str, work: Work, action: Any = None, service: Any = None
    ) -> None:
        self._node, self._waiter, self._work = node, waiter, work
        self._action = action
        self.name = f"{node.get_name()}/{name}" if node.get_name() != name else name
        self._since: float | None = None
        if service is not None:
            create_deferred_service(node, service, f"~/{name}", self._serve)
        if action is not None:
            self._server = ActionServer(
                node,
                action,
                f"~/{name}",
                self._act,
                goal_callback=self._on_goal,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )

    @property
    def busy(self) -> str:
        """Why no other job can begin now, "" when one can."""
        return f"{self.name}: busy with another request for {time.monotonic() - self._since:.0f} s" if self._since else ""

    def _on_goal(self, _: Any) -> GoalResponse:
        if self.busy:
            self._node.get_logger().warning(f"goal rejected: {self.busy}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    async def run(self, request: Any, answer: Any) -> Any:
        """The job as if it had been asked for over the network; the answer says how it went."""
        return await self._guarded(request, answer, Progress())

    async def _serve(self, request: Any, response: Any) -> Any:
        return await self._guarded(request, response, Progress())

    async def _guarded(self, request: Any, answer: Any, progress: Progress) -> Any:
        """Every failure becomes an answer: success false and the reason in one line."""
        if self.busy:
            answer.success, answer.message = False, self.busy
            self._node.get_logger().warning(f"request refused: {self.busy}")
            return answer
        self._since = time.monotonic()
        try:
            answer.message = str(await self._work(request, answer, progress))
            answer.success = True
        except TcsError as error:
            answer.success, answer.message = False, str(error)
        except Exception as error:  # a defect of ours must not take the node with it
            answer.success, answer.message = False, f"{self.name}: {type(error).__name__}: {error}"
        finally:
            self._since = None
        log = self._node.get_logger()
        if answer.success:
            log.info(f"{self.name}: {answer.message}")
        else:
            log.error(answer.message)
        return answer

    async def _act(self, goal: Any) -> Any:
        progress, answer = Progress(), self._action.Result()
        finished: list[bool] = []

        async def work() -> None:
            await self._guarded(goal.request, answer, progress)
            finished.append(True)

        assert self._node.executor is not None
        self._node.executor.create_task(work)
        shown: dict[str, Any] = {}
        while not await self._waiter.until(lambda: bool(finished), 0.1):
            if goal.is_cancel_requested:
                progress.cancelled.set()
            if progress.fields != shown:
                shown = progress.fields
                goal.publish_feedback(self._action.Feedback(**shown))
        if goal.is_cancel_requested:
            goal.canceled()
        elif answer.success:
            goal.succeed()
        else:
            goal.abort()
        return answer
