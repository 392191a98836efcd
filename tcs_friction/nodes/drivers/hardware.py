"""What a driver node asks of the drive behind it. No ROS here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple


class Measured(NamedTuple):
    """What a drive says of its axis: stamp (ns of ROS time), position (rad), speed (rad/s) and torque (N m) at that time."""

    stamp: int
    position: float
    speed: float
    torque: float


class Hardware(ABC):
    """A drive, or what leads to one. Everything is called in the executor's thread and returns at once."""

    fault = ""
    """Why there may be no torque until `reset`, "" for nothing. One line; read at every period."""
    waits = ""
    """What is waited for before torque has an effect, "" when it has."""

    notes: Sequence[str] = ()
    """What the drive lacks and can do without, a line each."""

    @abstractmethod
    def open(self, heard: Callable[[Measured], None]) -> None:
        """Begin to listen. `heard` is to be called, in the executor's thread, with everything that is measured.

        What does not work becomes a `fault`.
        """

    @abstractmethod
    def apply(self, torque: float) -> None:
        """Torque (N m) that is let on: at every period, and as soon as another has been commanded. Switches the drive on."""

    @abstractmethod
    def stop(self, reason: str, exceeded: bool = False) -> None:
        """There is to be no torque, for a stated reason: at every period instead of `apply`. Switches the drive off.

        exceeded: speed or travel is beyond its limit.
        """

    @abstractmethod
    def tick(self) -> None:
        """Once a period, after `apply` or `stop`."""

    @abstractmethod
    def reset(self) -> None:
        """Forget a fault: somebody has activated the node (again). Also called before `open`."""

    @abstractmethod
    def close(self) -> None:
        """The node ends. `stop` has been called."""
