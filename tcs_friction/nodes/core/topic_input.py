"""Topics that answer joint states, for nodes that keep every message: in range, in order; what is refused is reported."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from tcs_friction.control.stamps import REFUSED, REPEATED, FollowRule
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.input_settings import InputSettings
from tcs_friction.nodes.core.wire import ESTIMATE, REFERENCE, Numbers, Wire


class ReferenceSettings(InputSettings, Protocol):
    """What it says about references beside that."""

    def reference_objection(self, inertia: float, position: float, speed: float, acceleration: float) -> str: ...


class TopicInput:
    """Judges the messages of one topic. Subclasses say which, and what numbers can be."""

    wire: Wire

    def __init__(self, health: Health, lock_step: bool, name: str) -> None:
        self._health, self._lock_step, self._name = health, lock_step, name
        self._rule = FollowRule(lock_step)
        self._objection: Callable[[Numbers], str] = lambda _: "not configured"

    def follow(self, config: InputSettings, objection: Callable[[Numbers], str]) -> None:
        """Other limits."""
        self._objection = objection
        self._rule.configure(config.age_limit, config.patience, period=config.period)

    def take(self, data: bytes) -> tuple[int, Numbers] | None:
        """Stamp (ns) and numbers of a serialised message, None when it is refused or, in real time, a repetition."""
        stamp, numbers = self.wire.read(data)
        objection = self._objection(numbers)
        step = REFUSED if objection else self._rule.judge(stamp, 0.0, 0.0 if self._lock_step else time.monotonic())
        if step is REFUSED and (objection := objection or self._rule.reason):
            self._health.refuse(f"{self._name} refused: {objection}")
        repeated = step is REPEATED and not self._lock_step
        return None if step is REFUSED or repeated else (stamp, numbers)


class EstimateInput(TopicInput):
    """Friction estimates of an observer, or the true friction."""

    wire = ESTIMATE

    def __init__(self, health: Health, lock_step: bool, name: str = "friction_estimate") -> None:
        super().__init__(health, lock_step, name)

    def configure(self, config: InputSettings) -> None:
        """Other ranges."""
        torque, state = config.torque_objection, config.state_objection
        self.follow(config, lambda numbers: torque(numbers[0]) or state(0.0, numbers[1]) or torque(numbers[2]))


class ReferenceInput(TopicInput):
    """References."""

    wire = REFERENCE

    def __init__(self, health: Health, lock_step: bool) -> None:
        super().__init__(health, lock_step, "reference")

    def configure(self, config: ReferenceSettings, inertia: float) -> None:
        """Other ranges."""
        self.follow(config, lambda numbers: config.reference_objection(inertia, *numbers[:3]))
