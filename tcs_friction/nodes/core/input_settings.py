"""What the inputs of a node ask of its configuration."""

from __future__ import annotations

from typing import Protocol


class InputSettings(Protocol):
    """What a node's configuration says about any of its inputs: part of a ClockConfig with Ranges."""

    @property
    def period(self) -> float: ...
    @property
    def age_limit(self) -> float: ...
    @property
    def patience(self) -> float: ...
    def state_objection(self, position: float, speed: float) -> str: ...
    def torque_objection(self, torque: float) -> str: ...
