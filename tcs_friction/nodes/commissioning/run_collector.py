"""A run of the axis as a node hears it: every message of the topics that matter, until the reference is over."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from tcs_friction_msgs.msg import AxisReference, FrictionEstimate

from tcs_friction.commissioning.run import COLUMNS, Run
from tcs_friction.control.stamps import NEW_RUN, REFUSED, REPEATED
from tcs_friction.errors import JobError
from tcs_friction.nodes.core.base import AxisNode
from tcs_friction.nodes.core.convert import SECOND
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.joint_states import CommandedTorque
from tcs_friction.nodes.core.qos import COLLECT
from tcs_friction.nodes.core.series import Series
from tcs_friction.nodes.core.topic_input import EstimateInput, ReferenceInput

GRACE = 2.0  # s that the last messages of a run may take
ESTIMATES = ("friction_estimate", "true_friction")


class RunCollector:
    """Collects what is acceptable while a run lasts, and nothing otherwise. To be configured before it hears anything."""

    def __init__(self, node: AxisNode[Any], waiter: Waiter) -> None:
        self._waiter = waiter
        self._lock_step = node.lock_step
        self._state = JointInput(node.health, node.lock_step, Level.WARN)
        self._references = ReferenceInput(node.health, node.lock_step)
        self._estimates = {name: EstimateInput(node.health, node.lock_step, name) for name in ESTIMATES}
        self._series: dict[str, Series] = {}
        self._newest: dict[str, int] = {}  # stamps; a run ends between two of them where stamps are those of a real clock
        self._broken = ""
        self._end = -1
        self._from = -1
        self.reference: tuple[float, ...] | None = None
        """Position, speed and acceleration of the last reference heard, whether a run lasts or not."""
        self._commanded = CommandedTorque(node)
        node.hear_driver(self._on_state, COLLECT)
        node.create_subscription(AxisReference, "reference", self._on_reference, COLLECT, raw=True)
        for name in ESTIMATES:
            node.create_subscription(FrictionEstimate, name, self._listener(name), COLLECT, raw=True)

    def configure(self, joint: str, inertia: float, config: Any) -> None:
        """Another axis or other limits; `config` is a ClockConfig with Ranges."""
        self._state.configure(joint, config)
        self._references.configure(config, inertia)
        for estimates in self._estimates.values():
            estimates.configure(config)

    def begin(self, joint: str, duration: float, topics: Sequence[str]) -> None:
        """Collect from the next joint state on, for `duration` seconds of its stamps."""
        self._joint, self._broken = joint, ""
        self._from, self._end = -1, -1
        self._duration = round(duration * SECOND)
        self._newest = dict.fromkeys(topics, -1)
        self._series = {name: Series(len(COLUMNS[name])) for name in topics}

    @property
    def reached(self) -> int:
        """Stamp (ns) of the last joint state, -1 before the first."""
        return self._newest.get("joint_states", -1)

    def _on_state(self, data: bytes) -> None:
        step, state = self._state.take(data), self._state
        if step is REFUSED or (step is REPEATED and not self._lock_step) or "joint_states" not in self._series:
            return  # in lock-step a run may begin with a state that has been heard before
        if self._from < 0 or step is NEW_RUN:
            self._begin_at(state.stamp)
        self._keep("joint_states", state.stamp, (state.position, state.speed, state.acted(self._commanded)))

    def _begin_at(self, stamp: int) -> None:
        """In lock-step the plant may be set back to time 0, and everything with it; in real time that breaks a run."""
        if self._from >= 0 and not self._lock_step:
            at = (self.reached - self._from) / SECOND
            self._broken = f"clock or position of the axis was set anew after {at:.3f} s of it"
        self._from, self._end = stamp, stamp + self._duration

    def _on_reference(self, data: bytes) -> None:
        heard = self._references.take(data)
        if heard is not None:
            stamp, (position, *rest) = heard
            self.reference = (self._state.beside(position), *rest)
            if "reference" in self._series:
                self._keep("reference", stamp, self.reference)

    def _listener(self, name: str) -> Callable[[bytes], None]:
        def listen(data: bytes) -> None:
            if self._lock_step and name not in self._series:
                return  # in real time what comes is followed all the time
            heard = self._estimates[name].take(data)
            if heard is not None and name in self._series:
                self._keep(name, *heard)

        return listen

    def _keep(self, name: str, stamp: int, values: Sequence[float]) -> None:
        self._newest[name] = stamp
        if self._end < 0 or stamp <= self._end:
            self._series[name].append(stamp, *values)

    def _complete(self) -> bool:
        return self._end >= 0 and all(stamp >= self._end for stamp in self._newest.values())

    async def finished(self, stall_limit: float, tell: Callable[[float], None]) -> Run:
        """The run once it is over. Raises JobError naming the topic that has stopped when nothing comes any more."""
        heard, since = -1, time.monotonic()
        try:
            while not await self._waiter.until(self._complete, 0.1):
                if self._broken:
                    raise JobError("run", self._broken, "one clock and one encoder from its beginning to its end")
                if self.reached != heard:
                    heard, since = self.reached, time.monotonic()
                quiet = time.monotonic() - since
                over = 0 <= self._end <= heard
                if quiet > (GRACE if over else stall_limit):
                    raise self._stalled(quiet)
                if heard >= 0:
                    tell(min(1.0, max(0.0, (heard - self._from) / self._duration)))
            return Run(self._joint, {name: series.arrays() for name, series in self._series.items()})
        finally:
            self._series = {}

    def _stalled(self, quiet: float) -> JobError:
        last = min(self._newest, key=lambda name: self._newest[name])
        at = f"since its {self._newest[last] / SECOND:.3f} s" if self._newest[last] >= 0 else "at all"
        return JobError("run", f"stalled for {quiet:.0f} s: no {last} {at}", "every node of the loop to be alive")
