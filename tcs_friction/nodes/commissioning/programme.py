"""A run's reference, begun and ended in nodes elsewhere: how the axis comes to move, and how it comes to rest."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node

from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.control.turns import beside
from tcs_friction.errors import JobError
from tcs_friction.nodes.commissioning.run_collector import RunCollector
from tcs_friction.nodes.core.base import LOCK_STEP
from tcs_friction.nodes.core.convert import SECOND
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.remote import Remotes

RESTS = 2.0  # s without a change, after which a reference that is not there has given up
MOST_STARTS = 3  # that it is asked again: an axis that cannot follow is not asked for ever
SAME = 1e-9  # rad, of a position that was turned on and back
HEARD = ("joint_states", "reference", "friction_estimate")


class Programme:
    """In lock-step the plant starts anew where the run begins and stands still after it, and time with it.

    In real time the axis goes to where the run begins and rests there first, so that every run begins alike; after a run the
    reference slows down to rest and holds its position.
    """

    def __init__(self, node: Any, waiter: Waiter, remotes: Remotes, runs: RunCollector) -> None:
        self._node: Node = node
        self._waiter, self._remotes, self._runs = waiter, remotes, runs
        self._seed: int | None = None  # the plant's own, while it has another

    async def begin(self, path: Path, config: Any, wait: Callable[[str], None], noise: int = 0) -> None:
        """Begin a run of a reference file, and to collect it. `wait` hears what is waited for, and may raise to give up.

        noise: number of the noise that a plant simulated in lock-step has in this run; 0 is that of its own seed.

        Raises JobError when a node does not do its part.
        """
        reference, limit = load_reference(path), config.answer_limit
        lock_step, joint = config.clock == LOCK_STEP, self._node.file.axis.name
        heard = [*HEARD, "true_friction"] if config.known else HEARD
        if not lock_step:
            if config.known:
                await self._remotes.set("plant", {"truth": True}, limit)
            await self._go_to_start(reference, config, wait)
            self._runs.begin(joint, reference.duration, heard)
        await self._remotes.set("reference", {"reference_file": str(path)}, limit)
        if not lock_step:
            return
        if config.simulated:  # the axis begins anew, and is answered, under the new reference
            start = {"start_position": reference.at(0.0)[0], "run_until": 0.0} | ({"truth": True} if config.known else {})
            if noise:
                self._seed = (await self._remotes.get("plant", ["seed"], limit))["seed"]
                start["seed"] = self._seed + noise
            await self._remotes.set("plant", start, limit)
        self._runs.begin(joint, reference.duration, heard)
        if config.simulated:
            await self._remotes.trigger("plant/reset", limit)
            await self._remotes.set("plant", {"run_until": reference.duration}, limit)

    async def _go_to_start(self, reference: Reference, config: Any, wait: Callable[[str], None]) -> None:
        start = reference.at(0.0)[0]

        def there() -> bool:
            heard = self._runs.reference
            return heard is not None and heard[1:] == (0.0, 0.0) and self._same(heard[0], start)

        await self._remotes.set("reference", {"reference_file": "", "kind": "hold", "hold.position": start}, config.answer_limit)
        last, since, again = self._runs.reference, time.monotonic(), 0
        while not await self._waiter.until(there, 0.1):
            wait("waiting for the axis to come to where the run begins")
            if self._runs.reference != last:
                last, since = self._runs.reference, time.monotonic()
            elif again < MOST_STARTS and time.monotonic() - since > RESTS:  # it has lost the axis for a moment
                again += 1
                await self._remotes.trigger("reference/start", config.answer_limit)
            if time.monotonic() - since > config.stall_limit:
                where = "nothing was heard of it" if last is None else f"it stays at {last[0]:.6g} with speed {last[1]:.3g}"
                wanted = f"it to go to {start:.6g}, where the run begins"
                raise JobError("reference", f"{where} for {config.stall_limit:g} s", wanted)

    def _same(self, position: float, start: float) -> bool:
        """Whether a reference stands where the run begins; of a continuous axis the travel may leave another turn."""
        axis = self._node.file.axis
        return abs(beside(position, start) - start) < SAME if axis.continuous else position == start

    async def rest(self, config: Any) -> None:
        """Bring the axis to rest after a run, whole or not; what cannot be done is logged."""
        try:
            if config.clock != LOCK_STEP:
                await self._remotes.trigger("reference/stop", config.answer_limit)
            elif config.simulated and self._runs.reached >= 0:
                stop: dict[str, Any] = {"run_until": self._runs.reached / SECOND}
                if self._seed is not None:  # another seed starts the plant anew
                    stop, self._seed = {"run_until": 0.0, "seed": self._seed}, None
                await self._remotes.set("plant", stop, config.answer_limit)
        except JobError as error:
            self._node.get_logger().error(f"the axis may still move: {error}")
