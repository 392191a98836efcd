"""What the page's node hands on of a graph, and what it is asked to do. No ROS here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

TOPICS = {
    "joint_states": 3,
    "reference": 3,
    "torque_command": 1,
    "friction_estimate": 2,
    "friction_compensation": 1,
}
"""Topics whose samples are handed on, and the numbers of a sample.

joint_states: position (rad), speed (rad/s), torque applied (N m). reference: position, speed, acceleration. torque_command and
friction_compensation: torque (N m). friction_estimate: torque, NaN while the observer is switched off, and speed.
For linear axes read m and N.
"""
MODES = ("plain", "measure", "compensate")
"""Orders that set the three switches, as the service set_mode numbers them."""
JOBS = ("identify", "diagnose", "commission")
"""Orders that take a while and can be aborted."""
MODE_OF: dict[tuple[bool | None, ...], str] = {
    (False, False, False): "plain",
    (True, True, False): "measure",
    (False, False, True): "compensate",
}
"""The mode of three switches."""
ABORT = "abort"
ORDERS = (*MODES, *JOBS, ABORT)
CANCEL, LEAVE_OUT = "cancel ", "leave out "
"""How further orders begin: then comes the name of an effect of the model."""


@dataclass(frozen=True)
class Condition:
    """What a node has said of itself on /diagnostics; `at` in steady time (s), `level` as of diagnostic_msgs."""

    at: float
    level: int
    message: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Effect:
    """An effect of the axis file or of the model, and what is done about it.

    asked: whether it is to be cancelled, None where the compensator's model does not have it.
    """

    name: str
    state: str
    asked: bool | None = None


@dataclass(frozen=True)
class Switches:
    """Switch1 to Switch3, None where the node does not answer; the model whose effects are cancelled ("": none); effects."""

    positions: tuple[bool | None, bool | None, bool | None] = (None, None, None)
    model: str = ""
    effects: tuple[Effect, ...] = ()

    @property
    def mode(self) -> str:
        """The mode by the name that orders have, "mixed" for none of them, "" while it is not known."""
        if None in self.positions:
            return ""
        return MODE_OF.get(self.positions, "mixed")


@dataclass(frozen=True)
class Job:
    """What was ordered last: how far it is, what it says, and its results' directory ("": none).

    success: None while it runs.
    """

    name: str = ""
    stage: str = ""
    progress: float = 0.0
    success: bool | None = True
    directory: str = ""

    @property
    def running(self) -> bool:
        """Whether it can be aborted."""
        return bool(self.name) and self.success is None


class Sink(Protocol):
    """Where the node puts what it heard; all of it is called from the executor's thread."""

    def writer(self, topic: str) -> Callable[..., None]:
        """What takes the samples of one of TOPICS: `write(stamp_ns, *numbers)`."""

    def report(self, name: str, condition: Condition) -> None:
        """A node's report."""

    def switched(self, switches: Switches) -> None:
        """How the switches are."""

    def told(self, job: Job) -> None:
        """How far an order is."""

    def next_order(self) -> str:
        """The next order that somebody gave, "" for none."""
