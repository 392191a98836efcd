"""A run's reference, begun and ended in nodes elsewhere: how the axis comes to move, and how it comes to rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rclpy.node import Node

from tcs_friction.control.reference import load_reference
from tcs_friction.errors import JobError
from tcs_friction.nodes.base import LOCK_STEP
from tcs_friction.nodes.convert import SECOND
from tcs_friction.nodes.remote import Remotes
from tcs_friction.nodes.runs import RunCollector

HEARD = ("joint_states", "reference", "friction_estimate")


class Programme:
    """After a run the plant of lock-step stands still, and time with it; in real time the reference holds its position."""

    def __init__(self, node: Any, remotes: Remotes, runs: RunCollector) -> None:
        self._node: Node = node
        self._remotes, self._runs = remotes, runs

    async def begin(self, path: Path, config: Any) -> None:
        """Begin a run of a reference file, and to collect it. Raises JobError when a node does not answer."""
        reference, limit = load_reference(path), config.answer_limit
        joint, lock_step = self._node.file.axis.name, config.clock == LOCK_STEP
        heard = [*HEARD, "true_friction"] if config.simulated else HEARD
        if config.simulated:
            start = {"start_position": reference.at(0.0)[0], "run_until": 0.0} if lock_step else {}
            await self._remotes.set("plant", start | {"truth": True}, limit)
        await self._remotes.set("reference", {"reference_file": str(path)}, limit)
        self._runs.begin(joint, reference.duration, heard)
        if config.simulated and lock_step:
            await self._remotes.trigger("plant/reset", limit)
            await self._remotes.set("plant", {"run_until": reference.duration}, limit)

    async def rest(self, config: Any) -> None:
        """Bring the axis to rest after a run, whole or not; what cannot be done is logged."""
        try:
            if config.clock != LOCK_STEP:
                if self._runs.wanted is not None:
                    hold = {"reference_file": "", "kind": "hold", "hold.position": self._runs.wanted}
                    await self._remotes.set("reference", hold, config.answer_limit)
            elif config.simulated and self._runs.reached >= 0:
                await self._remotes.set("plant", {"run_until": self._runs.reached / SECOND}, config.answer_limit)
        except JobError as error:
            self._node.get_logger().error(f"the axis may still move: {error}")
